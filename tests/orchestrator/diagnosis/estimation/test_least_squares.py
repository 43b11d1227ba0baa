"""A fit simulates what it has to, and nothing twice."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import Precision, difference, fit, fit_added, fit_on
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.plant.plant import Parameter, Signals, SimulationError
from cobot_joint.diagnosis.store import Store
from tests.orchestrator.diagnosis.axis import NOISE, NOMINAL, TERMS, Axis, campaign

COGGING = ActiveTerm(TERMS[2], {"axis.cogging.A": 0.01, "axis.cogging.phi_0": 0.4, "axis.cogging.n": 3.0})
NO_STEP = Precision(steps=0)


def fitted() -> tuple[Problem, Fit]:
    """The base model on recordings of a machine that is somewhat off."""
    case = campaign({"axis.d": 2e-3})
    problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
    bounds = {name: t.bounds(NOMINAL[name]) for name, t in case.tolerances.items()}
    found = fit(problem, Hypothesis(tolerances(problem, bounds)))
    assert found is not None
    return problem, found


def test_a_fit_that_goes_on_simulates_nothing_before_its_first_step() -> None:
    problem, found = fitted()
    before = problem.runs
    assert fit_on(problem, found, NO_STEP) is not None
    assert problem.runs == before
    assert fit_on(problem, found, Precision(steps=1)) is not None
    assert problem.runs == before + len(problem.recordings)


def test_an_added_effect_costs_its_own_run_and_one_per_coordinate() -> None:
    problem, found = fitted()
    before = problem.runs
    added = fit_added(problem, found, [COGGING], NO_STEP)
    assert added is not None
    assert problem.runs == before + (1 + len(COGGING.coordinates)) * len(problem.recordings)
    base = problem.simulate([added.run])[0]
    assert base is not None
    np.testing.assert_allclose(added.residual, problem.recorded - base.white, rtol=0, atol=1e-9)
    own = range(len(found.x), len(added.x))
    columns = difference(problem, added.hypothesis, added.x, base, own)
    np.testing.assert_allclose(added.jacobian[:, own.start :], columns, rtol=0, atol=1e-6)


def test_with_nothing_to_fit_the_nominal_model_is_the_fit() -> None:
    case = campaign({"axis.d": 2e-3})
    problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
    found = fit(problem, Hypothesis(()))
    assert found is not None
    assert found.jacobian.shape == (problem.rows, 0)
    assert found.run.values == {}


class Brittle(Axis):
    """Runs with its nominal inertia or less."""

    fails = 1.0  # times the nominal inertia, above which it cannot be simulated

    def simulate(self, values, recording, **how):  # type: ignore[no-untyped-def, override]
        if values.get("axis.J", 0.0) > self.fails * NOMINAL["axis.J"]:
            raise SimulationError("the inertia is too much")
        return super().simulate(values, recording, **how)


def test_where_one_step_cannot_be_simulated_the_opposite_one_is_taken() -> None:
    case = campaign({"axis.d": 2e-3})
    whole, brittle = (Problem(plant, case.train, {"w": Noise(NOISE)}) for plant in (Axis(), Brittle()))
    bounds = {name: t.bounds(NOMINAL[name]) for name, t in case.tolerances.items()}
    base = Hypothesis(tolerances(whole, bounds))
    (at,) = whole.simulate([base.run(base.start())])
    assert at is not None
    there, other = (difference(problem, base, base.start(), at) for problem in (whole, brittle))
    np.testing.assert_allclose(other, there, rtol=0, atol=0.05 * np.abs(there).max())


def test_what_can_be_simulated_at_its_nominal_value_alone_is_told_by_its_parameter() -> None:
    class Narrow(Brittle):
        def simulate(self, values, recording, **how):  # type: ignore[no-untyped-def, override]
            if values.get("axis.J", NOMINAL["axis.J"]) < NOMINAL["axis.J"] * (1 - 1e-9):
                raise SimulationError("the inertia is too little")
            return super().simulate(values, recording, **how)

    with pytest.raises(SimulationError, match=r"beside the nominal value of axis\.J: the inertia is too much"):
        calibrate(campaign({}), Narrow(), lambda words: None, Store(None))


class Ringing:
    """A resonance that rings for three seconds, undamped."""

    terms = ports = inputs = ()
    parameters = {"spring.f": Parameter("spring.f", 40.0, "Hz", 1.0, 100.0)}  # noqa: RUF012 - never written to

    def has(self, name: str, recording: Recording) -> bool:
        """There is one component."""
        return True

    def simulate(self, values: Mapping[str, float], recording: Recording, **_: object) -> Signals:
        """See Plant.simulate."""
        return {"y": np.sin(2 * np.pi * values.get("spring.f", 40.0) * recording.time)}


def test_a_fit_whose_differences_span_a_period_takes_finer_ones() -> None:
    """15 % of a tolerance of 2 Hz are nine tenths of a period at the end of the run, and point the other way."""
    time = np.arange(3000) * 1e-3
    silent = Recording("run", "train", "default", time, {}, {"y": np.zeros(3000)}, {"y": "1"})
    y = Ringing().simulate({"spring.f": 39.95}, silent)["y"] + np.random.default_rng(1).normal(0, 0.02, 3000)
    recording = Recording("run", "train", "default", time, {}, {"y": y}, {"y": "1"})
    problem = Problem(Ringing(), [recording], {"y": Noise(0.02)}, jobs=1)
    found = fit(problem, Hypothesis(tolerances(problem, {"spring.f": (38.0, 42.0)})))
    assert found is not None
    assert found.run.values["spring.f"] == pytest.approx(39.95, abs=1e-3)
    assert not problem.unexplained(found.residual)


class Rough(Ringing):
    """Whose answer is another one wherever it is asked, and nowhere better than at its nominal value."""

    def simulate(self, values: Mapping[str, float], recording: Recording, **_: object) -> Signals:
        """See Plant.simulate."""
        f = values.get("spring.f", 40.0)
        off = np.random.default_rng(int(1e9 * f)).normal(0, 1.0, len(recording.time))
        return {"y": 0.5 + (off if f != 40.0 else 0 * off)}


def test_finer_differences_that_do_not_lead_on_are_not_kept() -> None:
    """They show what is rough, and what follows would take it for a slope."""
    time = np.arange(3000) * 1e-3
    recording = Recording("run", "train", "default", time, {}, {"y": np.zeros(3000)}, {"y": "1"})
    problem = Problem(Rough(), [recording], {"y": Noise(0.02)}, jobs=1)
    found = fit(problem, Hypothesis(tolerances(problem, {"spring.f": (38.0, 42.0)})))
    assert found is not None
    coarse = difference(problem, found.hypothesis, found.x, found.simulated)
    np.testing.assert_array_equal(found.jacobian, coarse)
