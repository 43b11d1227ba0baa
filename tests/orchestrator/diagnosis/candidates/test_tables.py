"""Tables over the places that an axis passes to and fro."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cobot_joint.diagnosis.candidates.tables import look_for_table, over_motion
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.store import Store
from tests.orchestrator.diagnosis.axis import NOISE, OFF, SAMPLES, Axis, campaign

WORN = 0.02  # N.m more friction on half of the way


def worn() -> tuple[Recording, float]:
    """An axis that goes to and fro twice, with friction that is larger beyond its middle, rad."""
    recording = campaign(OFF).recordings[0]
    clean = Axis().simulate(OFF, recording)
    middle = float(np.mean([clean["axis.phi"].min(), clean["axis.phi"].max()]))
    for _ in range(20):
        tau = -WORN * (clean["axis.phi"] > middle) * np.tanh(clean["axis.w"] / 0.5)
        clean = Axis().simulate(OFF, recording, added={"axis.tau_add": tau})
    w = clean["w"] + np.random.default_rng(1).normal(0, NOISE, SAMPLES)
    return replace(recording, outputs={"w": w}), middle


def test_friction_that_is_larger_on_half_of_the_way_is_a_table_over_the_place() -> None:
    """A ball screw's nut, worn on one side: over speed a table took 15 % of what was left, over the place 69 %."""
    recording, middle = worn()
    case = replace(campaign(OFF), recordings=[recording])
    problem, calibrated = calibrate(case, Axis(), lambda words: None, Store(None))
    found = look_for_table(problem, calibrated, Axis.ports, lambda words: None, over_motion, 0.5)
    assert found is not None
    assert (found.argument.signal, found.argument.direction) == ("phi", "w")
    near, far = (found.values[side].mean() for side in (found.argument.knots < middle, found.argument.knots > middle))
    assert far - near == pytest.approx(-WORN, rel=0.3)


def test_a_table_that_takes_less_than_it_has_to_is_none() -> None:
    case = replace(campaign(OFF), recordings=[worn()[0]])
    problem, calibrated = calibrate(case, Axis(), lambda words: None, Store(None))
    found = look_for_table(problem, calibrated, Axis.ports, lambda words: None, over_motion)
    assert found is not None
    more = 1.01 * found.choice.gain / problem.above(calibrated.residual)
    assert look_for_table(problem, calibrated, Axis.ports, lambda words: None, over_motion, more) is None


def test_a_place_that_is_passed_once_is_no_argument() -> None:
    """It would be a time: a drift follows it."""
    case = campaign(OFF)
    case = replace(case, recordings=case.recordings[1:])
    case.recordings[0].outputs["w"] = case.recordings[0].outputs["w"] + np.sin(7 * case.recordings[0].time)
    problem, calibrated = calibrate(case, Axis(), lambda words: None, Store(None))
    found = look_for_table(problem, calibrated, Axis.ports, lambda words: None, over_motion)
    assert found is not None
    assert found.argument.signal == "w"
