"""The order in which initial values are passed on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cobot_joint.system import System, initial_order, load_system

ROWS = [("u", "input", "Real", 'start="0"'), ("y", "output", "Real", "")]
THROUGH = '<Unknown index="2" dependencies="1"/>'
APART = '<Unknown index="2" dependencies=""/>'
SILENT = '<Unknown index="2"/>'
Make = Callable[..., Path]


@pytest.fixture
def ring(make_fmu: Make, make_system: Make, wire: Callable[..., str]) -> Callable[[dict[str, str]], System]:
    """Units a, b, c with a.y -> b.u -> c.u -> a.u; each with its InitialUnknowns."""

    def make(unknowns: dict[str, str]) -> System:
        for name, initial in unknowns.items():
            make_fmu(name, ROWS, initial=initial)
        components = "".join(f'<ssd:Component name="{n}" source="{n}.fmu"/>' for n in unknowns)
        wires = wire("c.y", "a.u") + wire("b.y", "c.u") + wire("a.y", "b.u")
        return load_system(make_system(components, wires))

    return make


def names(system: System) -> list[set[str]]:
    return [{wire.name for wire in group} for group in initial_order(system)]


def test_value_is_passed_on_after_all_that_it_depends_on(ring: Callable[..., System]) -> None:
    system = ring({"a": APART, "b": THROUGH, "c": THROUGH})
    assert names(system) == [{"a.y -> b.u"}, {"b.y -> c.u"}, {"c.y -> a.u"}]


def test_output_that_is_no_unknown_depends_on_nothing(ring: Callable[..., System]) -> None:
    system = ring({"a": "", "b": THROUGH, "c": THROUGH})
    assert names(system) == [{"a.y -> b.u"}, {"b.y -> c.u"}, {"c.y -> a.u"}]


def test_algebraic_loop_is_one_group(ring: Callable[..., System]) -> None:
    assert names(ring({"a": THROUGH, "b": THROUGH, "c": THROUGH})) == [{"a.y -> b.u", "b.y -> c.u", "c.y -> a.u"}]


def test_unit_that_says_nothing_is_taken_to_depend_on_all_inputs(ring: Callable[..., System]) -> None:
    assert len(names(ring({"a": SILENT, "b": SILENT, "c": SILENT}))) == 1
    assert len(names(ring({"a": APART, "b": SILENT, "c": SILENT}))) == 3


def test_gearheads_inertia_reaches_the_motor_without_a_loop() -> None:
    groups = initial_order(load_system("joint"))
    assert all(len(group) == 1 for group in groups)
    assert "planetary_gear.J_coupled -> motor_bldc.J_coupled" in {group[0].name for group in groups}
