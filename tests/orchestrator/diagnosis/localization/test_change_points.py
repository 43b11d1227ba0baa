"""Changes of level and of variance are dated."""

from __future__ import annotations

import numpy as np
import pytest

from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.localization.change_points import changes
from tests.orchestrator.diagnosis.axis import NOISE, Axis, campaign


@pytest.mark.parametrize("kind", ["level", "variance"])
def test_a_change_is_dated_to_a_window(kind: str) -> None:
    problem = Problem(Axis(), campaign({}).train, {"w": Noise(NOISE)})
    residual = np.random.default_rng(4).standard_normal(problem.rows)
    late = problem.times() >= 3.4
    residual = np.where(late, residual + 1.0 if kind == "level" else 2 * residual, residual)
    found = changes(problem, residual)
    assert {c.recording for c in found} == {"run0", "run1"}
    assert all(abs(c.time - 3.4) < 0.15 and c.after > c.before for c in found)


def test_noise_alone_does_not_change() -> None:
    problem = Problem(Axis(), campaign({}).train, {"w": Noise(NOISE)})
    for seed in range(20):
        assert changes(problem, np.random.default_rng(seed).standard_normal(problem.rows)) == []
