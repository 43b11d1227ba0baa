"""`check`: whether an FMU can take a component's place, and what it lacks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cobot_joint.cosim.foreign.ports import Finding
from cobot_joint.cosim.foreign.standalone import examine
from cobot_joint.errors import UserError
from cobot_joint.system import load_system

MakeGear = Callable[..., Path]


def found(file: Path | str, place: str = "planetary_gear") -> dict[str, Finding]:
    return {f.what: f for f in examine(load_system("joint"), place, str(file))}


@pytest.mark.parametrize("unit", ["motor_bldc", "planetary_gear", "torque_sensor", "mr_brake_belt"])
def test_units_of_the_bench_lack_nothing_in_their_own_place(fmu: Callable[[str], Path], unit: str) -> None:
    findings = found(fmu(unit), unit)
    assert {f.verdict for f in findings.values()} == {"ok"}
    assert {"runs alone", "takes a step back", "varies its step", "makes no energy", "physics terms"} < set(findings)


def test_a_foreign_gear_can_be_used_and_lacks_what_it_does_not_declare(foreign_gear: MakeGear) -> None:
    findings = found(foreign_gear())
    assert [f.what for f in findings.values() if f.verdict == "lacks"] == [
        "takes a step back",
        "follows its inputs",
        "gives slopes of its outputs",
        "states and derivatives",
        "physics terms",
        "flanges",
    ]
    assert "no" not in {f.verdict for f in findings.values()}


def test_missing_ports_are_named_with_those_that_could_be_meant(foreign_gear: MakeGear) -> None:
    gear = foreign_gear(names={"w": "omega"}, without=("J_coupled",))
    findings = found(gear)
    assert (findings["port w"].verdict, findings["port w"].detail) == (
        "no",
        "there is none of that name; its inputs in [rad/s] are omega",
    )
    assert findings["port J_coupled"].verdict == "no"
    mapped = found(f"{gear}:w=omega,J_coupled=")
    assert mapped["port w = omega"].verdict == "ok"
    assert mapped["port J_coupled = left out"].verdict == "lacks"


@pytest.mark.parametrize(
    ("units", "verdict", "detail"),
    [
        ({"w": "rpm"}, "ok", "[rpm], converted to [rad/s]"),
        ({"w": None}, "lacks", "no unit of measure is given, it is taken as [rad/s]"),
        ({"w": "N.m"}, "no", "[N.m] is given, what converts to [rad/s] is needed"),
    ],
)
def test_units_of_measure_are_compared(
    foreign_gear: MakeGear, units: dict[str, str | None], verdict: str, detail: str
) -> None:
    finding = found(foreign_gear(units=units))["port w"]
    assert (finding.verdict, finding.detail) == (verdict, detail)


def test_an_output_in_an_inputs_place_is_refused(foreign_gear: MakeGear) -> None:
    gear = foreign_gear()
    assert found(f"{gear}:tau_s=tau_g")["port tau_s = tau_g"].detail == "output is given, input is needed"


def test_a_torque_of_the_other_sign_makes_energy(foreign_gear: MakeGear) -> None:
    finding = found(f"{foreign_gear()}:tau=-tau")["makes no energy"]
    assert finding.verdict == "no"
    assert "more than it had taken" in finding.detail


def test_a_unit_that_does_not_load_is_a_finding(foreign_gear: MakeGear) -> None:
    other = foreign_gear(library="nowhere")
    assert found(other)["runs alone"].verdict == "no"


def test_a_place_that_is_none_is_refused(foreign_gear: MakeGear) -> None:
    with pytest.raises(UserError, match="no such component of joint, it has motor_bldc"):
        found(foreign_gear(), "gear")
