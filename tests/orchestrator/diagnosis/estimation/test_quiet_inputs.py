"""The noise of a measured input is not simulated sample by sample where what is compared stays the same or closer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.drafts.chain import CURRENT_MODE, chain
from cobot_joint.diagnosis.estimation.calibrate import UNSEEN, noises, with_long_steps, with_quiet_inputs
from cobot_joint.diagnosis.estimation.problem import Problem, Run
from cobot_joint.diagnosis.plant.knots import on_fewer_knots
from cobot_joint.diagnosis.plant.plant import Signals
from cobot_joint.diagnosis.plant.simulator import COARSE, FASTEST
from cobot_joint.system.model import Inputs
from tests.orchestrator.diagnosis.axis import NOISE, OFF, Axis, campaign


def measured(sigma: float, plant: Axis, *, felt: bool = False) -> Problem:
    """Two runs of the axis whose current is recorded with noise. felt: it went in with it, else without."""
    case, rng = campaign(OFF), np.random.default_rng(3)
    noisy = [replace(r, inputs={"u": r.inputs["u"] + rng.normal(0, sigma, len(r.time))}) for r in case.recordings]
    if felt:
        noisy = [
            replace(r, outputs={"w": plant.simulate(OFF, r)["w"] + rng.normal(0, NOISE, len(r.time))}) for r in noisy
        ]
    return Problem(plant, noisy, noises(case))


class Coarse(Axis):
    """An axis whose speed is off by so many sigma where it is simulated with long steps."""

    def __init__(self, off: float) -> None:
        super().__init__()
        self.off = off

    def simulate(self, values: Mapping[str, float], recording: Recording, **others: Any) -> Signals:
        """See Plant.simulate."""
        found = super().simulate(values, recording, **others)
        return {name: x + self.off * NOISE * recording.coarse for name, x in found.items()}


class Derivative(Axis):
    """What is compared is the slope of what goes in, as a torque is that of an imposed speed."""

    def simulate(self, values: Mapping[str, float], recording: Recording, **others: Any) -> Signals:
        """See Plant.simulate."""
        return {"w": np.gradient(recording.inputs["u"], recording.time)}


@pytest.mark.parametrize(("sigma", "off", "coarse"), [(0.02, 1e-3, True), (0.02, 0.5, False), (0.0, 0.0, False)])
def test_steps_are_long_where_inputs_have_noise_and_what_is_compared_stays_the_same(
    sigma: float, off: float, coarse: bool
) -> None:
    problem = with_long_steps(measured(sigma, Coarse(off)), Run())
    assert [r.coarse for r in problem.recordings] == [coarse, coarse]


def test_long_steps_of_a_current_driven_motor_are_a_third_fewer_and_what_is_read_a_hundredth_of_its_noise_off() -> None:
    t = 1e-3 * np.arange(2001)
    noisy = 5 * np.sin(2 * np.pi * t) + np.random.default_rng(1).normal(0, 0.05, len(t))
    steps, w = [], []
    with Simulation(chain(["motor", "load"]).system) as simulation:
        for scheme in (FASTEST, COARSE):
            inputs = Inputs(t, {"v_command": noisy})
            parameters = {"motor.drive.mode": CURRENT_MODE}
            experiment = Experiment(
                inputs, 2.0, parameters=parameters, output_step=1e-3, record=["w_motor"], scheme=scheme
            )
            found = simulation.run(experiment)
            w.append(found.signals["w_motor"])
            steps.append(simulation.counters["steps"])
    assert steps[1] < 0.7 * steps[0], steps
    assert np.sqrt(np.mean((w[1] - w[0]) ** 2)) < 3e-3  # rad/s; an encoder's log has 0.3


@pytest.mark.parametrize("values", [OFF, {}], ids=["re-fitted", "far off"])
def test_an_input_has_fewer_knots_and_what_is_compared_is_the_same(values: dict[str, float]) -> None:
    """To a tenth of what a term must take, or a hundred-thousandth of what is left."""
    problem, run = measured(0.02, Axis(), felt=True), Run(values)
    quiet = with_quiet_inputs(problem, run)
    (whole,), (less,) = problem.simulate([run]), quiet.simulate([run])
    assert whole is not None
    assert less is not None
    left = problem.above(problem.recorded - whole.white)
    assert float(np.sum((whole.white - less.white) ** 2)) < max(thresholds.EVIDENCE / 10, UNSEEN * left)
    for before, after in zip(problem.recordings, quiet.recordings, strict=True):
        assert np.mean(np.abs(np.diff(after.inputs["u"], 2)) > 1e-9) < 0.3
        assert after.outputs is before.outputs


def test_noise_that_the_machine_did_not_feel_is_taken_off() -> None:
    """By what is between the two simulations, and not by chance."""
    problem, run = measured(0.1, Axis()), Run(OFF)
    quiet = with_quiet_inputs(problem, run)
    (whole,), (less,) = problem.simulate([run]), quiet.simulate([run])
    assert whole is not None
    assert less is not None
    before, after = (float(np.sum((problem.recorded - found.white) ** 2)) for found in (whole, less))
    assert before - after > float(np.sum((whole.white - less.white) ** 2)) / 2 > 500


@pytest.mark.parametrize("plant", [Axis, Derivative])
def test_noise_that_the_machine_did_feel_stays(plant: type[Axis]) -> None:
    problem = measured(0.1, plant(), felt=True)
    assert with_quiet_inputs(problem, Run(OFF)) is problem


def test_set_values_without_noise_stay_as_recorded() -> None:
    problem = measured(0.0, Axis())
    assert with_quiet_inputs(problem, Run()) is problem


def test_a_motor_that_is_driven_by_a_noisy_signal_is_simulated_in_a_third_of_the_steps() -> None:
    t = 1e-3 * np.arange(2001)
    noisy = 5 * np.sin(2 * np.pi * t) + np.random.default_rng(1).normal(0, 0.05, len(t))
    steps = []
    with Simulation(chain(["motor", "load"]).system) as simulation:
        for x in (noisy, on_fewer_knots(t, noisy, 16)):
            inputs = Inputs(t, {"v_command": x})
            simulation.run(Experiment(inputs, 2.0, output_step=1e-3, record=["w_motor"], scheme="monolithic"))
            steps.append(simulation.counters["steps"])
    assert steps[1] < steps[0] / 3, steps
