"""A machine's own values, in any unit of measure that converts, in the set-ups that have the component."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.parameters import with_values
from cobot_joint.diagnosis.data.quantity import convert
from cobot_joint.diagnosis.estimation.hypothesis import tolerances
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.errors import UserError
from cobot_joint.system.read import load_system

SETUPS = {"loaded": "joint_logged", "no_load": "joint_no_load_logged"}


@pytest.mark.parametrize(
    ("name", "given", "value"),
    [
        ("planetary_gear.ratio.N", 66, 66.0),
        ("planetary_gear.ratio.N", "66", 66.0),
        ("motor_bldc.friction.d", "9 uN.m.s/rad", 9e-6),
        ("motor_bldc.friction.d", "-0.0e-6 N.m.s/rad", 0.0),
        ("motor_bldc.winding.R", "215 mohm", 0.215),
        ("motor_bldc.drive.w_max", "6000rpm", 200 * np.pi),
        ("planetary_gear.mesh.eta", "72 %", 0.72),
        ("motor_bldc.drive.mode", "current", 2),
    ],
)
def test_a_value_is_taken_in_any_unit_that_converts(name: str, given: float | str, value: float) -> None:
    system = with_values({"default": load_system("joint")}, {name: given}, "here")["default"]
    component, variable = name.split(".", 1)
    assert system.component(component).parameters[variable] == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "given", "told"),
    [
        ("motor_bldc.winding.R", "3 V", "unit 'V' is given, one that converts to 'Ohm' is needed"),
        ("motor_bldc.winding.R", "-1 Ohm", "-1 Ohm is given, 1e-06 to 10000 Ohm is allowed"),
        ("motor_bldc.winding.R", "thick", "'thick' is given, a number is allowed"),
        ("motor_bldc.winding.RR", 1.0, "no variable of motor_bldc.fmu, allowed are"),
        ("motor_bldc.w", 1.0, "output of motor_bldc.fmu; a start value belongs to a recording's initial"),
        ("motor.winding.R", 1.0, "no such component, there are motor_bldc"),
        ("motor_bldc.drive.mode", "curent", "'curent' is given, voltage, current is allowed"),
    ],
)
def test_a_value_that_is_none_is_refused_with_its_place(name: str, given: float | str, told: str) -> None:
    with pytest.raises(UserError) as refused:
        with_values({"default": load_system("joint")}, {name: given}, "campaign.toml: [parameters]")
    assert str(refused.value).startswith(f"campaign.toml: [parameters]: {name}: ")
    assert told in str(refused.value)


def test_set_ups_without_the_component_stay_as_they_are() -> None:
    systems = {setup: load_system(name) for setup, name in SETUPS.items()}
    found = with_values(systems, {"mr_brake_belt.brake.tau_off": 0.1}, "here")
    assert found["loaded"].component("mr_brake_belt").parameters["brake.tau_off"] == 0.1
    assert found["no_load"] is systems["no_load"]


def campaign(folder: Path, settings: str, entry: str = "") -> Path:
    t = np.arange(50) * 1e-3
    rows = "\n".join(f"{a},{a},{a},{a}" for a in t)
    (folder / "run.csv").write_text(f"time,v_command,i_motor,w_motor\n{rows}\n")
    text = f'system = "joint"\n{settings}[[recording]]\nfile = "run.csv"\nsetup = "no_load"\n{entry}'
    (folder / "campaign.toml").write_text(text)
    return folder / "campaign.toml"


def test_a_recording_s_parameters_hold_in_its_run(tmp_path: Path) -> None:
    loaded = load_campaign(campaign(tmp_path, "", 'parameters = { "motor_bldc.drive.k_v" = "50 %" }\n'))
    assert loaded.recordings[0].initial == {"motor_bldc.drive.k_v": 0.5}


def test_a_tolerance_is_around_this_machine_s_value_and_inside_what_its_unit_allows(tmp_path: Path) -> None:
    """An efficiency of 0.97 +- 6 % ends at 1, and a backlash of 0 +- 20 % is no parameter to fit."""
    given = (
        '[parameters]\n"planetary_gear.mesh.eta" = 0.97\n"planetary_gear.mesh.b" = 0\n"motor_bldc.winding.R" = 0.4\n'
    )
    loaded = load_campaign(campaign(tmp_path, given))
    with FmuPlant(loaded.systems()) as plant:
        problem = Problem(plant, loaded.train, {"w_motor": Noise(0.3), "i_motor": Noise(4e-3)}, jobs=1)
        bounds = {name: t.bounds(plant.parameters[name].nominal) for name, t in loaded.tolerances.items()}
        free = {f.parameter.name: (f.lower, f.upper) for f in tolerances(problem, bounds)}
    assert free["planetary_gear.mesh.eta"] == pytest.approx((0.97 * 0.94, 1.0))
    assert free["motor_bldc.winding.R"] == pytest.approx((0.38, 0.42))
    assert "planetary_gear.mesh.b" not in free


@pytest.mark.parametrize("unit", ["mNm/1000rpm", "mNm/1000 rpm", "mN.m per 1000 rpm", "mNm/1000 min-1", "mNm/krpm"])
def test_a_viscous_friction_per_thousand_turns_a_minute_is_read(unit: str) -> None:
    assert convert(np.ones(1), unit, "N.m.s/rad", "here")[0][0] == pytest.approx(1e-3 / (1000 * 2 * np.pi / 60))


@pytest.mark.parametrize(
    ("unit", "value"),
    [("oz-in", 7.0615518e-3), ("lb-in", 0.11298483), ("ft-lb", 1.3558179), ("kg-cm", 0.0980665), ("kgcm", 0.0980665)],
)
def test_a_torque_is_read_as_servos_and_american_data_sheets_write_it(unit: str, value: float) -> None:
    assert convert(np.ones(1), unit, "N.m", "here")[0][0] == pytest.approx(value, rel=1e-7)
    assert convert(np.ones(1), f"{unit}/A", "N.m/A", "here")[0][0] == pytest.approx(value, rel=1e-7)
    assert convert(np.ones(1), "kgcm2", "kg.m2", "here")[0][0] == pytest.approx(1e-4)
    assert convert(np.ones(1), "mNms/rad", "N.m.s/rad", "here")[0][0] == pytest.approx(1e-3)


def test_a_lead_without_its_angle_is_refused_since_it_may_be_per_turn_or_per_radian() -> None:
    per_turn, unit = convert(np.ones(1), "mm/rev", "m/rad", "here")
    assert (per_turn[0], unit) == (pytest.approx(1e-3 / (2 * np.pi)), "m/rad")
    with pytest.raises(UserError, match="here: unit 'mm' is given, a length per angle is needed: 'mm/rev' or 'mm/rad'"):
        convert(np.ones(1), "mm", "m/rad", "here")
    assert convert(np.ones(1), "N.m", "N.m/rad", "here")[0][0] == 1.0
