"""The score test predicts what a fit takes, and knows what cannot be told apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cobot_joint.diagnosis.candidates.scan import Scan
from cobot_joint.diagnosis.candidates.score_test import ScoreTest, scores
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import Precision, fit, fit_added
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.port_response import respond
from cobot_joint.diagnosis.estimation.problem import Problem, Run
from cobot_joint.diagnosis.estimation.projection import Projection
from cobot_joint.diagnosis.selection.elimination import loss_without
from tests.orchestrator.diagnosis.axis import NOISE, NOMINAL, TERMS, Axis, campaign

WINDAGE = {"axis.windage.c": 2e-7}


def refitted() -> tuple[Problem, Fit]:
    case = campaign(WINDAGE)
    problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
    bounds = {name: t.bounds(NOMINAL[name]) for name, t in case.tolerances.items()}
    base = fit(problem, Hypothesis(tolerances(problem, bounds)))
    assert base is not None
    return problem, base


def test_the_predicted_gain_is_about_what_the_fit_takes() -> None:
    problem, base = refitted()
    ranked = scores(problem, base, Scan(problem, TERMS).columns(base))
    assert ranked[0].term.name == "axis.windage"
    found = fit_added(problem, base, [ranked[0].active], Precision())
    assert found is not None
    assert ranked[0].gain == pytest.approx(base.cost - found.cost, rel=0.1)
    assert loss_without(found, "axis.windage") == pytest.approx(base.cost - found.cost, rel=0.1)


def test_a_signal_at_a_port_takes_what_the_term_that_it_imitates_does() -> None:
    problem, base = refitted()
    speeds = [o["axis.w"] for o in problem.outputs(base.run)]
    drag = {r.name: -w * np.abs(w) for r, w in zip(problem.recordings, speeds, strict=True)}
    (column,) = respond(problem, base, Axis.ports[0], {"drag": drag})
    gain, (c,) = Projection(base, [column.vector]).gain([0])
    assert c == pytest.approx(WINDAGE["axis.windage.c"], rel=0.1)
    windage = next(
        s for s in scores(problem, base, Scan(problem, TERMS).columns(base)) if s.term.name == "axis.windage"
    )
    assert gain == pytest.approx(windage.gain, rel=0.05)


def test_a_term_that_sets_in_does_nothing_before() -> None:
    problem, base = refitted()
    scan = Scan(problem, [t for t in TERMS if t.phase])  # the axis has these alone with an onset
    scan.columns(base)
    columns = scan.setting_in(base, 2.2)
    assert {c.term.name for c in columns} == {"axis.cogging"}
    assert scan.setting_in(base, 2.2, skip={"axis.cogging"}) == []
    for vector in (v for c in columns for v in c.vectors):
        assert np.all(vector[problem.times() < 2.2] == 0)
        assert np.any(vector[problem.times() > 2.3] != 0)


@pytest.mark.parametrize(("background", "onset"), [(0.0, 3.0), (30.0, None)])
def test_beside_a_background_a_late_onset_must_take_a_share_of_what_it_leaves(
    background: float, onset: float | None
) -> None:
    """background: chi-square over that of a term which is off for the first half of the runs."""
    problem, base = refitted()
    columns = [c for c in Scan(problem, TERMS).columns(base) if c.term.name == "axis.windage"]
    effect = np.where(problem.times() < 3.0, 0.0, columns[0].vectors[0])
    effect *= 100 / np.sqrt(effect @ effect)
    noise = np.random.default_rng(1).normal(size=problem.rows)
    noise *= np.sqrt(problem.samples + background * (effect @ effect)) / np.sqrt(noise @ noise)
    (score,) = ScoreTest(problem, base, columns).rank(effect + noise)
    assert score.onset == (None if onset is None else pytest.approx(onset, abs=0.4))


def test_a_secant_goes_no_farther_than_the_term_may(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small ones may lead beyond, which a unit refuses to simulate."""
    problem, base = refitted()
    scan = Scan(problem, [t for t in TERMS if t.phase])
    scan.columns(base)
    (score,) = scores(problem, base, scan.setting_in(base, 2.2))
    term = score.term
    beyond = replace(score, values={**score.values, term.amplitude: 20 * term.upper})
    simulate, tried = problem.simulate, list[float]()

    def watched(runs: Sequence[Run], *more: Any, **named: Any) -> Any:
        tried.extend(run.values[term.amplitude] for run in runs)
        return simulate(runs, *more, **named)

    monkeypatch.setattr(problem, "simulate", watched)
    assert [c.term for c in scan.secants(base, [beyond], 2.2, 0.3)] == [term]
    assert tried == pytest.approx([0.3 * term.upper] * 2)
