"""Another FMU in a component's place: wires keep what they do, and whatever does not fit is refused."""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from pathlib import Path

import pytest

from cobot_joint.errors import UserError
from cobot_joint.system import System, load_system, with_parameters, with_units

METER = [("w", "input", "Real", 'unit="rad/s" start="0"'), ("y", "output", "Real", 'unit="rpm"')]


def test_a_wire_takes_the_new_units_unit_and_keeps_its_own_transformation(
    pair: Callable[..., System], make_fmu: Callable[..., Path], wire: Callable[..., str], line: str
) -> None:
    system = pair(wire("motor.w", "meter.w", line))  # twice, plus 5, in rpm
    (before,) = system.connections
    assert (before.factor, before.offset) == pytest.approx((2 * 60 / (2 * pi), 5.0))
    (after,) = with_units(system, {"meter": make_fmu("slow", METER)}).connections
    assert (after.factor, after.offset) == pytest.approx((2.0, 5.0))


def test_a_unit_that_lacks_a_wired_variable_is_refused(
    pair: Callable[..., System], make_fmu: Callable[..., Path], wire: Callable[..., str]
) -> None:
    system = pair(wire("motor.w", "meter.w"))
    blind = make_fmu("blind", [("v", "input", "Real", 'start="0"'), ("y", "output", "Real", "")])
    with pytest.raises(UserError, match=r"units: meter=.*blind\.fmu: meter\.w is no variable of blind\.fmu"):
        with_units(system, {"meter": blind})


def test_a_unit_that_lacks_a_parameter_which_the_system_sets_is_refused(
    pair: Callable[..., System], make_fmu: Callable[..., Path], wire: Callable[..., str]
) -> None:
    system = with_parameters(pair(wire("motor.w", "meter.w")), {"motor.R": 2.0})
    plain = make_fmu("plain", [("w", "output", "Real", 'unit="rad/s"')])
    with pytest.raises(UserError, match=r"motor=.*plain\.fmu: R: no variable of plain\.fmu"):
        with_units(system, {"motor": plain})


def test_an_unknown_component_is_refused_with_those_there_are(fmu: Callable[[str], Path]) -> None:
    with pytest.raises(UserError, match="no such component of joint, it has motor_bldc, planetary_gear"):
        with_units(load_system("joint"), {"gear": fmu("planetary_gear")})


def test_a_unit_in_its_own_place_changes_no_wire(fmu: Callable[[str], Path]) -> None:
    system = load_system("joint")
    swapped = with_units(system, {"planetary_gear": fmu("planetary_gear")})
    assert swapped.connections == system.connections
