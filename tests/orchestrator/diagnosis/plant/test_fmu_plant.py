"""A plant of FMUs that threads share."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.system import load_system


def test_units_are_not_freed_under_a_thread_that_works(monkeypatch: pytest.MonkeyPatch) -> None:
    """As after an interruption, which does not wait for those that are at work."""
    t = np.arange(20_001) * 1e-3
    recording = Recording("r", "train", "no_load", t, {"v_command": np.sin(t)}, {"w_motor": t}, {"w_motor": "rad/s"})
    plant, freed, results = FmuPlant({"no_load": load_system("joint_no_load")}), [], []
    running = threading.Event()
    step = plant._simulation

    def started(*of: object) -> object:
        running.set()
        return step(*of)

    def work() -> None:
        results.append((plant.simulate({}, recording)["w_motor"], list(freed)))

    monkeypatch.setattr(plant, "_simulation", started)
    with plant:
        plant.simulate({}, recording)
        running.clear()
        thread = threading.Thread(target=work)
        thread.start()
        assert running.wait(60)
        while not plant._workers and not results:
            time.sleep(0.001)
    freed.append(True)
    thread.join()
    assert np.isfinite(results[0][0]).all()
    assert results[0][1] == []
    with pytest.raises(SimulationError, match="the simulation is over"):
        plant.simulate({}, recording)


def test_no_effect_at_a_port_goes_by_a_load_that_the_port_shows_in_at_once() -> None:
    """A formula for a sensor's reading that took the reading itself made a loop without a solution, and the diagnosis
    ended without an answer."""
    systems = {"": load_system("joint_logged")}
    with FmuPlant(systems) as plant:
        ports = {port.name: port.loads for port in plant.ports}
    assert ports["torque_sensor.y_add"] == ("torque_sensor.tau_s",)
    assert "planetary_gear.tau" not in ports["planetary_gear.tau_add"]
    assert "planetary_gear.tau" in ports["planetary_gear.tau_o_add"]
