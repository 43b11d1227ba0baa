"""Which units of the bench the recorded channels can tell apart, by structure alone."""

from __future__ import annotations

import numpy as np
import pytest

from cobot_joint.diagnosis.localization.isolability import (
    Equation,
    Isolability,
    equations,
    isolability,
    redundant,
    together,
)
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


@pytest.mark.parametrize("seed", range(20))
def test_structures_are_taken_apart_as_faultdiagnosistoolbox_does(seed: int) -> None:
    toolbox = pytest.importorskip("faultdiagnosistoolbox.dmperm", reason="faultdiagnosistoolbox, the peer, is not here")
    rng = np.random.default_rng(seed)
    X = (rng.random((rng.integers(4, 14), rng.integers(3, 10))) < 0.3).astype(int)
    X[X.sum(axis=1) == 0, 0] = 1  # the toolbox leaves out equations without unknown signals where nothing else is over
    model = [Equation(str(i), frozenset(f"x{k}" for k in np.flatnonzero(row))) for i, row in enumerate(X)]
    told = {int(e.unit or -1) for e in redundant(model, ())}
    assert told == set(map(int, toolbox.Mplus(X)))


@pytest.mark.parametrize("channels", [LOGGED, ["i_motor", "w_motor"], ["tau_sensor"], [*LOGGED, "w_pulley"]])
def test_units_are_told_apart_as_faultdiagnosistoolbox_does(channels: list[str]) -> None:
    toolbox = pytest.importorskip("faultdiagnosistoolbox", reason="faultdiagnosistoolbox, the peer, is not here")
    system, found = load_system("joint_logged"), told(channels)
    model = equations(system, channels, {s: x for s, x in SHOWN.items() if x.channel in channels})
    units = list(found.apart)
    unknown = sorted({name for e in model for name in e.names} - {*system.inputs, *channels})
    definition = {
        "type": "MatrixStruc",
        "x": unknown,
        "X": [[int(name in e.names) for name in unknown] for e in model],
        "f": [*units, "none"],
        "F": [[int(e.unit == unit) for unit in (*units, "none")] for e in model],
        "Z": [],
    }
    blurred = toolbox.DiagnosisModel(definition).IsolabilityAnalysis()  # 0: row can be told from column
    assert found.detectable == tuple(u for u, row in zip(units, blurred, strict=False) if row[-1] == 0)
    assert found.apart == {
        u: tuple(o for j, o in enumerate(units) if o != u and blurred[i, j] == 0) for i, u in enumerate(units)
    }


def test_equations_without_unknown_signals_are_all_redundant() -> None:
    model = [Equation("a", frozenset({"x"})), Equation("b", frozenset({"x", "y"}))]
    assert redundant(model, {"x", "y"}) == model
    assert redundant([], ()) == []


def test_of_a_simulator_that_is_no_system_the_report_says_that_it_is_not_known() -> None:
    assert words(None, "the simulator is no system of units")[0].startswith(
        "Which units the channels can tell apart at all is not known: "
    )
