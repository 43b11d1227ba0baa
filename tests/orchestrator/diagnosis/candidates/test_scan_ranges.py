"""Shapes that are speeds are scanned over what was driven."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cobot_joint.diagnosis.candidates.scan_ranges import FAST, SLOW, driven
from cobot_joint.diagnosis.plant.plant import TermCandidate
from tests.orchestrator.diagnosis.bench import calibrated


def stribeck(terms: list[TermCandidate]) -> TermCandidate:
    return next(t for t in terms if t.name == "motor_bldc.stribeck")


def test_a_scan_that_the_recordings_reach_stays_and_one_far_below_moves_to_the_speeds_driven() -> None:
    with calibrated({}) as (problem, base):
        terms = list(problem.plant.terms)
        kept = driven(problem, base, terms)
        assert [[s.values for s in t.shapes] for t in kept] == [[s.values for s in t.shapes] for t in terms]
        own = stribeck(terms)
        (shape,) = own.shapes
        slow = replace(own, shapes=(replace(shape, values=tuple(1e-4 * v for v in shape.values)),))
        (moved,) = stribeck(driven(problem, base, [slow])).shapes
        fastest = max(abs(run["motor_bldc.w"]).max() for run in problem.outputs(base.run, ["motor_bldc.w"]))
        assert stribeck(kept).shapes[0].reached == moved.reached == pytest.approx(fastest, rel=0.01)
        assert moved.values[0] == pytest.approx(SLOW * fastest, rel=0.01)
        assert moved.values[-1] == pytest.approx(FAST * fastest, rel=0.01)
        assert moved.lower <= moved.values[0] < moved.values[-1] <= moved.upper
