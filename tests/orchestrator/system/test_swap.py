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
    with pytest.raises(
        UserError, match=r"units: meter=.*blind\.fmu: w is no variable of blind\.fmu, it has v \[no unit\]"
    ):
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


def test_ports_of_other_names_are_mapped(
    pair: Callable[..., System], make_fmu: Callable[..., Path], wire: Callable[..., str]
) -> None:
    system = pair(wire("motor.w", "meter.w"))
    other = make_fmu("other", [("speed", "input", "Real", 'unit="rad/s" start="0"'), ("y", "output", "Real", "")])
    (mapped,) = with_units(system, {"meter": f"{other}:w=speed"}).connections
    assert (mapped.sink, mapped.factor) == ("speed", pytest.approx(1.0))
    (flipped,) = with_units(system, {"meter": f"{other}: w = -speed"}).connections
    assert (flipped.sink, flipped.factor) == ("speed", pytest.approx(-1.0))


@pytest.mark.parametrize("flipped", ["motor", "meter"])
def test_the_other_sign_holds_for_either_end_of_a_wire_with_an_offset(
    pair: Callable[..., System],
    make_fmu: Callable[..., Path],
    wire: Callable[..., str],
    line: str,
    flipped: str,
) -> None:
    system = pair(wire("motor.w", "meter.w", line))  # twice, plus 5, in rpm
    (before,) = system.connections
    place = {c.name: c.unit.path for c in system.components}[flipped]
    (after,) = with_units(system, {flipped: f"{place}:w=-w"}).connections
    sign = 1 if flipped == "motor" else -1
    assert (after.factor, after.offset) == pytest.approx((-before.factor, sign * before.offset))


def test_a_port_that_is_left_out_takes_its_wires_and_outputs_along(
    foreign_gear: Callable[..., Path], fmu: Callable[[str], Path]
) -> None:
    gear = foreign_gear(without=("J_coupled", "tau_g"))
    swapped = with_units(load_system("joint"), {"planetary_gear": f"{gear}:J_coupled=,tau_g="})
    assert "tau_gear" not in swapped.outputs
    assert not [c for c in swapped.connections if "J_coupled" in (c.source, c.sink)]
    assert len(swapped.connections) == len(load_system("joint").connections) - 2


def test_all_that_a_unit_lacks_is_said_at_once_with_what_it_has_and_how_to_map(
    foreign_gear: Callable[..., Path],
) -> None:
    gear = foreign_gear(names={"tau": "tau_m", "w": "omega"}, without=("J_coupled",))
    with pytest.raises(UserError) as refused:
        with_units(load_system("joint"), {"planetary_gear": gear})
    assert "w, tau, J_coupled is no variable of foreign_gear.fmu" in str(refused.value)
    assert "tau_m [N.m]" in str(refused.value)
    assert "my.fmu:tau=tau_m" in str(refused.value)


@pytest.mark.parametrize(("mapping", "said"), [("tau", "'tau' is given"), ("torque=tau", "torque: planetary_gear has")])
def test_a_mapping_that_is_none_is_refused(foreign_gear: Callable[..., Path], mapping: str, said: str) -> None:
    with pytest.raises(UserError, match=said):
        with_units(load_system("joint"), {"planetary_gear": f"{foreign_gear()}:{mapping}"})
