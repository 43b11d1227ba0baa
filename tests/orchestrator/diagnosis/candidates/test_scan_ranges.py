"""Shapes that are speeds are scanned over what was driven, orders up to what the samples resolve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cobot_joint.diagnosis.candidates.scan_ranges import FAST, SLOW, driven
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.given_ranges import with_ranges
from cobot_joint.diagnosis.plant.plant import TermCandidate
from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.bench import calibrated


def stribeck(terms: list[TermCandidate]) -> TermCandidate:
    return next(t for t in terms if t.name == "motor_bldc.stribeck")


def test_a_scan_that_the_recordings_reach_stays_and_one_far_below_moves_to_the_speeds_driven() -> None:
    with calibrated({}) as (problem, base):
        terms = list(problem.plant.terms)
        kept = driven(problem, base, terms)
        before, after = (
            {s.name: s.values for t in every for s in t.shapes if not s.is_any_order} for every in (terms, kept)
        )
        assert after == before
        own = stribeck(terms)
        (shape,) = own.shapes
        slow = replace(own, shapes=(replace(shape, values=tuple(1e-4 * v for v in shape.values)),))
        (moved,) = stribeck(driven(problem, base, [slow])).shapes
        fastest = max(abs(run["motor_bldc.w"]).max() for run in problem.outputs(base.run, ["motor_bldc.w"]))
        assert stribeck(kept).shapes[0].reached == moved.reached == pytest.approx(fastest, rel=0.01)
        assert moved.values[0] == pytest.approx(SLOW * fastest, rel=0.01)
        assert moved.values[-1] == pytest.approx(FAST * fastest, rel=0.01)
        assert moved.lower <= moved.values[0] < moved.values[-1] <= moved.upper


def test_of_a_shaft_whose_samples_resolve_them_a_motors_waves_are_scanned_at_all_orders(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A motor of 12 slots and 14 poles has cogging of order 84; a misalignment keeps its one or two periods."""
    with calibrated({}) as (problem, base):
        names = ("motor_bldc.cogging", "motor_bldc.torque_ripple", "torque_sensor.misalignment_ripple")
        terms = [t for t in problem.plant.terms if t.name in names]
        t = np.arange(0, 4, 1e-3)
        shafts = {angle: 30 * t for port in problem.plant.ports for angle in port.angles}
        monkeypatch.setattr(problem, "outputs", lambda run, names: [{n: shafts.get(n, 0 * t) for n in names}])
        found = {t.name.split(".")[1]: t.shapes[0].values for t in driven(problem, base, terms)}
    assert found["cogging"] == found["torque_ripple"] == tuple(float(n) for n in range(1, 84))
    assert found["misalignment_ripple"] == (1.0, 2.0)


def test_a_range_that_a_campaign_gives_is_scanned_and_fitted_and_not_what_was_driven() -> None:
    ranges = {"motor_bldc.cogging.n": (36.0, 40.5), "motor_bldc.stribeck.w_S": (1e-3, 2e-3)}
    with FmuPlant({"": load_system("joint_logged")}, ranges) as plant:
        found = {s.name: s for t in plant.terms for s in t.shapes}
    orders, speeds = (found[name] for name in ranges)
    assert orders.values == (36.0, 37.0, 38.0, 39.0, 40.0)
    assert (speeds.values[0], speeds.values[-1]) == pytest.approx((1e-3, 2e-3))
    assert (speeds.lower, speeds.upper) == (1e-3, 2e-3)
    with calibrated({}) as (problem, base):
        given = list(with_ranges(problem.plant.terms, ranges))
        kept = {s.name: s.values for t in driven(problem, base, given) for s in t.shapes}
    assert kept["motor_bldc.cogging.n"] == orders.values
    assert kept["motor_bldc.stribeck.w_S"] == pytest.approx(speeds.values)
