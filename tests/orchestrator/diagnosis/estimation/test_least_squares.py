"""A fit simulates what it has to, and nothing twice."""

from __future__ import annotations

import numpy as np

from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import Precision, difference, fit, fit_added, fit_on
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem
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
