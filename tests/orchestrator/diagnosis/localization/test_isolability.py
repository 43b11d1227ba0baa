"""Which units of the bench the recorded channels can tell apart, by structure alone."""

from __future__ import annotations

import sys

import pytest

from cobot_joint.diagnosis.localization.isolability import Isolability, NoToolbox, equations, isolability, together
from cobot_joint.diagnosis.localization.replay import Shown
from cobot_joint.diagnosis.report.localization_words import isolability as words
from cobot_joint.system.read import load_system

SHOWN = {
    "motor_bldc.i": Shown("i_motor", "read"),
    "motor_bldc.w": Shown("w_motor", "read"),
    "motor_bldc.phi": Shown("w_motor", "integral"),
    "torque_sensor.tau_reading": Shown("tau_sensor", "read"),
    "torque_sensor.tau_s": Shown("tau_sensor", "equal"),
}
LOGGED = ["i_motor", "w_motor", "tau_sensor"]


def told(channels: list[str], system: str = "joint_logged") -> Isolability:
    pytest.importorskip("faultdiagnosistoolbox")
    return isolability(load_system(system), channels, {s: x for s, x in SHOWN.items() if x.channel in channels})


def test_the_benchs_channels_tell_the_brake_from_the_motor_and_not_motor_from_gear() -> None:
    found = told(LOGGED)
    assert "motor_bldc" in found.apart["mr_brake_belt"]
    assert "mr_brake_belt" in found.apart["motor_bldc"]
    assert "planetary_gear" in found.confused["motor_bldc"]


def test_without_the_torque_sensors_channel_what_lies_behind_the_gear_is_one_class() -> None:
    found = told(["i_motor", "w_motor"])
    assert ("torque_sensor", "mr_brake_belt") in found.classes


def test_one_channel_tells_nothing_apart() -> None:
    assert len(told(["w_motor"]).classes) == 1


def test_a_speed_at_the_brake_tells_more_apart() -> None:
    fewer, more = told(LOGGED), told([*LOGGED, "w_pulley", "w_brake"])
    assert sum(map(len, more.apart.values())) > sum(map(len, fewer.apart.values()))


def test_a_set_up_without_the_brake_tells_the_motor_from_it() -> None:
    loaded, alone = told(["i_motor"]), told(["i_motor", "w_motor"], "joint_no_load_logged")
    assert "mr_brake_belt" not in loaded.apart["motor_bldc"]
    assert "mr_brake_belt" in together([loaded, alone]).apart["motor_bldc"]


def test_equations_are_those_of_the_units_model_structures() -> None:
    found = equations(load_system("joint_logged"), LOGGED, SHOWN)
    gear = [e.names for e in found if e.unit == "planetary_gear"]
    assert any({"planetary_gear.tau", "motor_bldc.phi", "motor_bldc.w"} <= names for names in gear)
    assert any({"planetary_gear.w_o", "torque_sensor.tau_s"} <= names for names in gear)
    assert [e.names for e in found if e.unit is None and "motor_bldc.phi" in e.names] == [
        frozenset({"motor_bldc.phi", "motor_bldc.w"})
    ]


def test_without_the_toolbox_the_report_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "faultdiagnosistoolbox", None)
    with pytest.raises(NoToolbox, match=r"pip install 'cobot-joint\[structural\]' brings it") as error:
        isolability(load_system("joint_logged"), LOGGED, SHOWN)
    assert words(None, str(error.value))[0].startswith("Which units the channels can tell apart at all is not known: ")
