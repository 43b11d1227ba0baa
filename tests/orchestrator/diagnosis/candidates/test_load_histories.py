"""Loads and offsets are proposed with about their size, and fitted with their times."""

from __future__ import annotations

import numpy as np
import pytest

from cobot_joint.diagnosis.candidates.load_histories import acting, fitted, outline, pulses, step_offset
from cobot_joint.diagnosis.estimation.effects import LoadPulse
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import fit
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from tests.orchestrator.diagnosis.axis import NOISE, NOMINAL, SAMPLES, STEP, Axis, campaign

PORT = Axis.ports[0]
TIME = STEP * np.arange(SAMPLES)


def loaded(load: Vector, in_every_run: bool = False) -> tuple[Problem, Fit]:
    """The axis with a torque added in its first run (or in both), and the base model re-fitted to it."""
    case, rng = campaign({}), np.random.default_rng(3)
    for recording in case.recordings if in_every_run else case.recordings[:1]:
        clean = Axis().simulate({}, recording, added={PORT.name: load})
        recording.outputs["w"] = clean["w"] + rng.normal(0, NOISE, SAMPLES)
    problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
    bounds = {name: t.bounds(NOMINAL[name]) for name, t in case.tolerances.items()}
    base = fit(problem, Hypothesis(tolerances(problem, bounds)))
    assert base is not None
    return problem, base


def test_a_load_is_found_with_its_height_and_its_corners() -> None:
    corners = [2.0, 2.1, 2.5, 2.7]
    problem, base = loaded(np.interp(TIME, corners, [0.0, -0.05, -0.05, 0.0]))
    proposal = pulses(problem, base, PORT, {0: [(1.95, 2.8)]})
    assert proposal is not None
    assert proposal.gain > 0.5 * (base.chi2 - problem.samples)
    found = fitted(problem, base, proposal.effects)
    assert found is not None
    (load,) = acting(found)
    assert isinstance(load, LoadPulse)
    assert pytest.approx(-0.05, rel=0.03) == load.T
    assert load.t == pytest.approx(corners, abs=0.02)
    assert not problem.unexplained(found.residual)
    t, value = outline([load])
    assert t == pytest.approx(load.t)
    assert value == pytest.approx([0.0, load.T, load.T, 0.0], abs=1e-9)


def test_an_offset_is_found_with_its_height_and_its_moment() -> None:
    problem, base = loaded(np.where(TIME >= 3.3, 0.01, 0.0), in_every_run=True)
    proposal = step_offset(problem, base, PORT, {0: [(3.2, 6.0)], 1: [(3.2, 6.0)]})
    assert proposal is not None
    found = fitted(problem, base, proposal.effects)
    assert found is not None
    (offset,) = acting(found)
    assert offset.start()[0] * offset.coordinates[0].scale == pytest.approx(0.01, rel=0.05)
    assert offset.coordinates[1].start == pytest.approx(3.3, abs=0.01)


def test_where_a_port_is_not_there_nothing_is_proposed() -> None:
    problem, base = loaded(np.zeros(SAMPLES))
    assert pulses(problem, base, PORT, {}) is None
    assert step_offset(problem, base, PORT, {}) is None
