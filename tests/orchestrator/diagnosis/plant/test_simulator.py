"""A system beside a recording."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.simulator import Simulator, summed
from cobot_joint.system.read import load_system
from cobot_joint.system.shafts import position_behind
from cobot_joint.units import Unit

LATE = {"motor_bldc.cogging.A": 3e-3, "motor_bldc.viscous_warmup.fade": 0.5}
ONSETS = {"motor_bldc.cogging.A": 0.4}


def spun(begin: float) -> dict[str, np.ndarray]:
    """1 s without load, by a clock that starts at `begin`."""
    t = begin + 1e-3 * np.arange(1001)
    inputs = {"v_command": np.interp(t - begin, [0.0, 0.3], [0.0, 6.0])}
    outputs = {"i_motor": np.zeros(len(t)), "w_motor": np.zeros(len(t))}
    recording = Recording("spun", "train", "no_load", t, inputs, outputs, {})
    with Simulator({"no_load": load_system("joint_no_load_logged")}, LATE, ONSETS) as simulate:
        return dict(simulate(recording))


def test_a_run_is_the_same_whatever_its_clock_begins_with() -> None:
    here, there = spun(0.0), spun(1000.0)
    for name in here:
        assert there[name] == pytest.approx(here[name], rel=1e-6, abs=2e-5), name


def test_checks_and_search_simulate_alike() -> None:
    """A stiff sensor behind a light output shaft: stepped by themselves the units gave up, and the checks before
    the search ended with that, though the search could simulate it."""
    t = 1e-3 * np.arange(301)
    inputs = {"v_command": np.where(t < 0.05, 0.0, 6.0)}
    recording = Recording("run", "train", "load", t, inputs, {"tau_sensor": np.zeros(len(t))}, {})
    systems, stiff = {"load": load_system("joint")}, {"torque_sensor.shaft.c_s": 1e5}
    with FmuPlant(systems) as plant, Simulator(systems, stiff) as simulate:
        searched, checked = plant.simulate(stiff, recording), simulate(recording)
    np.testing.assert_array_equal(checked["tau_sensor"], searched["tau_sensor"])


@pytest.mark.parametrize("how", ["backward", "central"])
def test_a_speed_that_was_made_of_a_position_is_simulated_as_one(how: Literal["backward", "central"]) -> None:
    """Where a voltage jumps, a motor's mean speed since the sample before is 2 rad/s off what it is in between."""
    t = 0.01 * np.arange(60)
    inputs, outputs = {"v_command": np.where(t < 0.1, 0.0, 6.0)}, {"w_motor": np.zeros(60)}
    recording = Recording("run", "train", "no_load", t, inputs, outputs, {}, held={"v_command"})
    systems = {"no_load": load_system("joint_no_load")}
    with FmuPlant(systems) as plant:
        found = plant.simulate({}, replace(recording, differences={"w_motor": how}), signals=["motor_bldc.phi"])
        instant = plant.simulate({}, recording)["w_motor"]
    phi = found["motor_bldc.phi"]
    expected = np.gradient(phi, 0.01) if how == "central" else np.diff(phi, prepend=phi[0]) / 0.01
    np.testing.assert_allclose(found["w_motor"], expected, atol=1e-9)
    assert np.abs(found["w_motor"] - instant).max() > 2.0


def test_a_position_in_degrees_is_not_what_a_speed_in_radians_is_the_rate_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """A unit of others may call an angle phi and have it in whatever it likes."""
    system = load_system("joint_no_load")
    assert position_behind(system, "w_motor") == ("motor_bldc.phi", 1.0)
    monkeypatch.setattr(Unit, "unit_of", lambda self, name: {"phi": "deg", "w": "rad/s"}.get(name))
    assert position_behind(system, "w_motor") is None


def test_what_is_added_at_a_recorded_input_does_not_replace_it() -> None:
    """A formula at `load.tau_add` was tried without the torque that was recorded there."""
    recorded, more = {"load.tau_add": np.array([1.0, 2.0]), "u": np.ones(2)}, {"load.tau_add": np.array([0.5, 0.5])}
    found = summed(recorded, {**more, "load.y_add": np.zeros(2)})
    assert {name: list(x) for name, x in found.items()} == {
        "load.tau_add": [1.5, 2.5], "u": [1.0, 1.0], "load.y_add": [0.0, 0.0]
    }  # fmt: skip
