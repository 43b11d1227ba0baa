"""Many recordings: some of them tell what a search asks first, and no effect sets in at the same time in each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cobot_joint.diagnosis.candidates.formulas import Dictionary
from cobot_joint.diagnosis.candidates.scan import Scan
from cobot_joint.diagnosis.candidates.score_test import scores
from cobot_joint.diagnosis.candidates.tables import COARSE, look_for_table, over_motion
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.estimation.problem import FEW
from cobot_joint.diagnosis.selection.some_recordings import some_of
from cobot_joint.diagnosis.selection.unlisted.places import first_forms
from cobot_joint.diagnosis.store import Store
from tests.orchestrator.diagnosis.axis import NOISE, OFF, SAMPLES, Axis, campaign


def many(copies: int, **cogging: float) -> Campaign:
    """The axis' two runs several times over, its cogging from 3 s on."""
    runs = [campaign({**OFF, **cogging}, onsets={"axis.cogging.A": 3.0}, seed=n) for n in range(copies)]
    every = [replace(r, name=f"{r.name} {n}") for n, case in enumerate(runs) for r in case.recordings]
    return replace(runs[0], recordings=every)


@pytest.mark.parametrize(("copies", "sets_in"), [(FEW // 2, True), (FEW // 2 + 1, False)])
def test_no_term_sets_in_at_the_same_time_in_each_of_many_recordings(copies: int, sets_in: bool) -> None:
    case = many(copies, **{"axis.cogging.A": 4e-3, "axis.cogging.n": 3.0})
    problem, calibrated = calibrate(case, Axis(), lambda words: None, Store(None))
    scan = Scan(problem, Axis().terms)
    (cogging,) = [s for s in scores(problem, calibrated, scan.columns(calibrated)) if s.term.name == "axis.cogging"]
    assert (cogging.onset is not None) == sets_in


def test_of_many_recordings_some_of_every_kind_are_asked_and_the_fit_is_that_of_all() -> None:
    case = many(FEW)
    case.recordings[1].initial["axis.k"] = 0.1  # a kind of its own, with hardly more than noise
    case.recordings[5].outputs["w"] = case.recordings[5].outputs["w"] + 1.0  # most above noise
    problem, calibrated = calibrate(case, Axis(), lambda words: None, Store(None))
    some, there = some_of(problem, calibrated)
    names = [r.name for r in some.recordings]
    assert len(names) == FEW
    assert {case.recordings[1].name, case.recordings[5].name} <= set(names)
    (simulated,) = some.simulate([there.run])
    assert simulated is not None
    assert there.chi2 == pytest.approx(float(np.sum((some.recorded - simulated.white) ** 2)), rel=1e-9)
    assert there.jacobian.shape == (some.rows, len(calibrated.x))


def test_few_recordings_are_all_asked() -> None:
    problem, calibrated = calibrate(campaign(OFF), Axis(), lambda words: None, Store(None))
    assert some_of(problem, calibrated) == (problem, calibrated)


@pytest.mark.parametrize(("together", "kept"), [(0.0, True), (0.8, False)])
def test_beside_a_background_forms_have_to_fit_all_recordings_that_are_asked(together: float, kept: bool) -> None:
    """A torque that a form follows in either run, but by another size in each."""
    case, rng = campaign(OFF), np.random.default_rng(1)
    for recording, size in zip(case.recordings, (2e-3, -3e-3), strict=True):
        clean = Axis().simulate(OFF, recording)
        for _ in range(8):
            tau = size * (clean["axis.w"] / 60) ** 3
            clean = Axis().simulate(OFF, recording, added={"axis.tau_add": tau})
        recording.outputs["w"] = clean["w"] + rng.normal(0, NOISE, SAMPLES)
    problem, calibrated = calibrate(case, Axis(), lambda words: None, Store(None))
    columns = first_forms(problem, calibrated, Dictionary(problem, calibrated, Axis.ports[0]), together)
    assert bool(columns) == kept


def test_a_table_over_a_speed_that_falls_short_in_one_recording_is_not_simulated_in_the_others() -> None:
    """Of thirteen recordings all were, at nine ports: twenty seconds of XL330's two minutes, for nothing."""
    case = many(FEW)
    for recording in case.recordings:  # what no table over a speed follows
        recording.outputs["w"] = recording.outputs["w"] + np.sin(7 * recording.time)
    problem, calibrated = calibrate(case, Axis(), lambda words: None, Store(None))
    before = problem.runs
    assert look_for_table(problem, calibrated, Axis.ports, lambda words: None, over_motion, 0.5) is None
    outputs, tables = len(case.recordings), COARSE * len(Axis.ports)
    assert problem.runs - before <= outputs + tables
