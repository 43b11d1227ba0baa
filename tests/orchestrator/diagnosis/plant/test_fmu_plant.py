"""A plant of FMUs that threads share."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cobot_joint.cosim import Feedback, SimulationError
from cobot_joint.diagnosis.data.parameters import with_values
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.engine import _terms
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant, _angle
from cobot_joint.system import Component, System, load_system
from cobot_joint.units import find_fmu, load_unit


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


@pytest.mark.parametrize("mode", ["voltage", "current"])
def test_what_a_current_loop_makes_up_for_is_asked_of_a_drive_in_voltage_mode_alone(mode: str) -> None:
    """A stage that conceals nothing, driven by its current, had a supply that sags, 85 % sure."""
    made = with_values({"": load_system("joint")}, {"motor_bldc.drive.mode": mode}, "parameters")
    with FmuPlant(made) as plant:
        problem: Any = SimpleNamespace(plant=plant, is_table=False)
        asked = {term.name for term in _terms(problem, ())}
        left = {"motor_bldc.dead_time", "motor_bldc.supply_sag"} if mode == "current" else set()
        assert {term.name for term in plant.terms} - asked == left
        assert [term.name for term in _terms(problem, ["motor_bldc.dead_time"])] == ["motor_bldc.dead_time"]


def test_a_wave_s_angle_is_the_one_in_its_equation() -> None:
    with FmuPlant({"": load_system("joint_logged")}) as plant:
        angles = {term.name: term.angle for term in plant.terms if term.phase}
    assert angles == {
        "motor_bldc.cogging": "motor_bldc.phi",
        "motor_bldc.torque_ripple": "motor_bldc.phi",
        "planetary_gear.transmission_error": "planetary_gear.phi_o",
        "torque_sensor.misalignment_ripple": "torque_sensor.phi_p",
        "mr_brake_belt.pulley_eccentricity": "mr_brake_belt.phi_p",
        "mr_brake_belt.imbalance": "mr_brake_belt.phi_p",
        "mr_brake_belt.position_friction": "mr_brake_belt.phi_p",
    }


def test_a_wave_without_an_order_has_the_periods_of_its_equation() -> None:
    """2*phi of a harmonic drive's kinematic error"""
    gear = Component("gear", "harmonic_drive.fmu", load_unit(find_fmu("harmonic_drive.fmu")))
    with FmuPlant({"": System("gear", (gear,), ())}) as plant:
        (term,) = (t for t in plant.terms if t.name == "gear.kinematic_error")
    assert term.periods({}) == 2
    assert term.angle == "gear.phi"


@pytest.mark.parametrize(
    ("name", "attribute", "value"),
    [("cogging.phi_0", "variability", "fixed"), ("phi", "causality", "local")],
    ids=["its phase may not change while time runs", "its angle is shown nowhere"],
)
def test_a_wave_that_cannot_go_by_a_recorded_angle_has_none(
    monkeypatch: pytest.MonkeyPatch, name: str, attribute: str, value: str
) -> None:
    """A unit of other people's making would have ended the diagnosis with an error."""
    motor = Component("motor", "motor_bldc.fmu", load_unit(find_fmu("motor_bldc.fmu")))
    (term,) = (term for term in motor.unit.terms if term.name == "cogging")
    assert _angle(motor, term) == ("motor.phi", 1.0)
    monkeypatch.setattr(motor.unit.variables[name], attribute, value)
    assert _angle(motor, term) == (None, 1.0)


def test_a_tooth_whose_phase_goes_back_as_the_shaft_turns_is_a_constant_torque() -> None:
    """A sin(n phi + phi_0) with phi_0 = pi/2 - n phi is A."""
    t = np.arange(2001) * 1e-3
    recording = Recording(
        "r", "train", "", t, {"v_command": np.full(len(t), 6.0)}, {"w_motor": t}, {"w_motor": "rad/s"}
    )
    A, n, phase = 1e-2, 1.0, "motor_bldc.cogging.phi_0"

    def back(phi: float) -> float:
        return float(np.remainder(np.pi / 2 - n * phi, 2 * np.pi))

    with FmuPlant({"": load_system("joint_no_load")}) as plant:
        courses = {phase: [(float(s), Feedback("motor_bldc.phi", back)) for s in t[:-1]]}
        on = {"motor_bldc.cogging.A": A, "motor_bldc.cogging.n": n, phase: np.pi / 2}
        held = plant.simulate(on, recording, courses=courses)["w_motor"]
        pushed = plant.simulate({}, recording, added={"motor_bldc.tau_add": np.full(len(t), -A)})["w_motor"]
        free = plant.simulate(on, recording)["w_motor"]
    assert np.abs(free - pushed).max() > 5  # rad/s
    assert np.abs(held - pushed).max() < 0.5
