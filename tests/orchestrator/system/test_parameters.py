"""Values that are set on units."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from cobot_joint.errors import UserError
from cobot_joint.system import System, with_parameters

Pair = Callable[..., System]


def test_value_is_set_in_the_variables_own_type(pair: Pair) -> None:
    given = {"motor.R": "2.5", "motor.mode": "on", "motor.count": "4", "motor.enabled": "false", "meter.free": 1}
    system = with_parameters(pair(""), given)
    assert system.component("motor").parameters == {"R": 2.5, "mode": 2, "count": 4, "enabled": False}
    assert system.component("meter").parameters == {"free": 1.0}  # an input's start value


def test_later_value_wins_and_the_first_system_stays_as_it_was(pair: Pair) -> None:
    first = with_parameters(pair(""), {"motor.R": 2})
    second = with_parameters(first, {"motor.R": 3})
    assert (first.component("motor").parameters["R"], second.component("motor").parameters["R"]) == (2, 3)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("motor.R", 11, "11 rpm is given, 0 to 10 rpm is allowed (motor.fmu)"),
        ("motor.R", -1, "-1 rpm is given, 0 to 10 rpm is allowed"),
        ("motor.R", "nan", "a finite number is allowed"),
        ("motor.R", "much", "'much' is given, a number is allowed"),
        ("motor.count", 2.5, "a whole number is allowed"),
        ("motor.mode", "half", "'half' is given, off, on is allowed"),
        ("motor.mode", 3, "3 is given, 1 to 2 is allowed"),
        ("motor.enabled", "maybe", "true or false is allowed"),
        ("motor.cuont", 1, "no variable of motor.fmu, allowed are count"),
        ("motor.w", 1, "not a parameter of motor.fmu"),
        ("rotor.R", 1, "no such component of system, it has motor, meter"),
    ],
)
def test_value_that_is_not_allowed_is_refused_with_what_is(
    pair: Pair, name: str, value: float | str, words: str
) -> None:
    with pytest.raises(UserError) as refused:
        with_parameters(pair(""), {name: value}, "--set")
    assert words in str(refused.value)
    assert str(refused.value).startswith(f"--set: {name}")
