"""What was found along the recorded motion is held against free runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cobot_joint.diagnosis import engine, thresholds
from cobot_joint.diagnosis.anchored import free_runs
from cobot_joint.diagnosis.anchored.search import Named, Search, confidence
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.estimation.problem import Run
from cobot_joint.diagnosis.explanation.explanation import Explanation
from cobot_joint.diagnosis.findings import Diagnosis, Estimate, Finding
from cobot_joint.diagnosis.plant.plant import TermCandidate
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from tests.orchestrator.diagnosis.made_up import CONCEALED, ONSET

ALONG, FREE, REPAIRED = 5.0, 2.0, 7.0


def neither(*_: free_runs.Values) -> bool:
    """The motion's values predict no better."""
    return False


def estimates(value: float) -> dict[str, Estimate]:
    return {"a.b": Estimate(value, "1", (value, value))}


def problem(left_along: float, stands_out: bool = False) -> Any:
    """Free runs leave so much with what was found along the recorded motion, squared."""
    return SimpleNamespace(
        recorded=np.array([left_along, 0.0]),
        simulate=lambda runs: [SimpleNamespace(white=np.zeros(2))],
        stretches=lambda residual: None,
        stands_out=lambda residual: stands_out,
        plant=SimpleNamespace(parameters={}, terms=()),
    )


def refit(chi2: float) -> Any:
    return SimpleNamespace(
        chi2=chi2, residual=np.zeros(2), run=Run({}), estimates=lambda units, stretches: estimates(FREE)
    )


def found(*terms: str) -> Diagnosis:
    findings = [Finding(term, (), 0.9, None, {}, {}, 50.0) for term in terms]
    return Diagnosis("explained", findings, calibrated=estimates(ALONG), repaired=estimates(REPAIRED))


@pytest.mark.parametrize(("left_along", "kept"), [(3.0, FREE), (1.0, ALONG)])
def test_calibrated_is_the_base_model_that_leaves_less_of_free_runs(left_along: float, kept: float) -> None:
    """field/open case09: re-fitted along the recorded motion it left much more, and a false repair beat that"""
    after = free_runs.in_free_runs(problem(left_along), found(), Search(), refit(4.0), {}, neither)
    assert after.calibrated["a.b"].value == kept


def test_where_nothing_has_a_name_nothing_is_repaired() -> None:
    """field/open case01 and case08: what the last look along the motion left behind was offered as a repair, and
    predicted the held-out run 4.6 and 1.05 times worse"""
    after = free_runs.in_free_runs(problem(3.0), found(), Search(), refit(4.0), {}, neither)
    assert after.repaired == after.calibrated


@pytest.mark.parametrize(("stands_out", "verdict"), [(False, "nothing_missing"), (True, "undecided")])
def test_what_stands_out_and_has_no_name_is_not_called_nothing(stands_out: bool, verdict: str) -> None:
    """A drawn machine whose base model was eleven times the noise off was told that nothing is worth a name"""
    after = free_runs.in_free_runs(problem(3.0, stands_out), found(), Search(), refit(4.0), {}, neither)
    assert after.verdict == verdict


@pytest.mark.parametrize(
    ("left_free", "predicts", "kept"), [(8.0, False, FREE), (10.0, False, REPAIRED), (8.0, True, REPAIRED)]
)
def test_a_repair_is_the_fit_that_leaves_less_of_free_runs_unless_the_motion_s_predicts_better(
    left_free: float, predicts: bool, kept: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cogging of 3.07 mN.m along the motion, 3 in truth, became 0.96 in free runs, which lose its angle."""
    monkeypatch.setattr(free_runs, "freely", lambda *_: refit(left_free))
    after = free_runs.in_free_runs(problem(3.0), found("a.term"), Search(), refit(4.0), {}, lambda *_: predicts)
    assert after.repaired["a.b"].value == kept


@pytest.mark.parametrize(("left_of_it", "claimed"), [(0.05, False), (0.3, True)])
def test_what_free_runs_have_next_to_none_of_is_no_claim(
    left_of_it: float, claimed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A conveyor whose current sensor was 0.35 A off had a friction of 1.4e-6 N.m that differs by direction, 90 %."""

    def size(value: float) -> dict[str, Estimate]:
        return {"a.b": Estimate(value, "N.m", (value, value))}

    free: Any = SimpleNamespace(**vars(refit(8.0)) | {"estimates": lambda *_: size(0.01 + left_of_it * 0.02)})
    monkeypatch.setattr(free_runs, "freely", lambda *_: free)
    along = found("a.term")
    along.repaired = size(0.03)
    along.findings = [replace(f, parameters=size(0.03)) for f in along.findings]
    term = SimpleNamespace(name="a.term", amplitude="a.b", neutral=0.01)
    named: Any = [SimpleNamespace(candidate=SimpleNamespace(term=term, onset=None))]
    after = free_runs.in_free_runs(problem(3.0), along, Search(named=named), refit(4.0), {}, neither)
    (finding,) = after.findings
    assert (finding.confidence >= thresholds.EVEN) == claimed
    assert ("next to none of it" in finding.limited_by) != claimed


@pytest.mark.parametrize(
    ("moves", "without", "named", "listed", "shows"),
    [
        (3.0, 100.0, 100.0, 100.0, False),  # 9 of 99 that are left without it
        (4.0, 100.0, 100.0, 100.0, True),
        (4.0, 1000.0, 3.0, 1000.0, True),  # little of what is left without any, but of what all names leave
        (4.0, 1000.0, 1000.0, 3.0, True),  # or listed terms
        (None, 100.0, 100.0, 100.0, True),  # cannot be simulated: free runs say nothing
    ],
)
def test_a_name_that_free_runs_hardly_feel_is_no_claim(
    moves: float | None, without: float, named: float, listed: float, shows: bool
) -> None:
    """A background's wave of 0.08 mN.m over a motor's angle was cogging, 74 and 86 % sure (machines 151/1, 127/5)."""
    residual = np.array([np.sqrt(without)])
    base: Any = SimpleNamespace(
        residual=residual, run=Run({"axis.d": 1.0}), simulated=SimpleNamespace(white=np.zeros(2))
    )
    terms: Any = SimpleNamespace(chi2=listed)

    def simulate(runs: list[Run]) -> Any:
        assert [sorted(run.values) for run in runs] == [["axis.cogging.A", "axis.d"]] * 2
        one = None if moves is None else SimpleNamespace(white=np.array([moves, 0.0]))
        return [one, SimpleNamespace(white=np.array([0.0, np.sqrt(named + 1)]))]

    at: Any = SimpleNamespace(
        recorded=np.zeros(2), samples=1, simulate=simulate, above=lambda rows: float(rows @ rows) - 1
    )
    term: Any = SimpleNamespace(name="axis.cogging", amplitude="axis.cogging.A")
    candidate: Any = SimpleNamespace(term=term, values={"axis.cogging.A": 1.0}, onset=None, evidence=231.0)
    search = Search(named=[Named(candidate, (), 0.0, 161.0, {}, 200.0)])
    (found,) = free_runs.felt(at, base, terms, search).named
    assert found.shows == shows
    assert (confidence(found) >= thresholds.EVEN) == shows


@pytest.mark.parametrize(
    ("name", "in_all", "gain", "beside"),
    [("a.teeth", 900.0, 1e4, True), ("a.drag", 900.0, 1e4, False), ("a.teeth", 90.0, 1e4, False),
     ("a.teeth", 900.0, 100.0, False)],
    ids=["claimed", "listed already", "no claim", "free runs are no better for it"],
)  # fmt: skip
def test_what_the_recorded_motion_claims_beside_listed_terms_is_fitted_with_them(
    name: str, in_all: float, gain: float, beside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A drawn viscous friction that warms up and cogging, each ten times the background: cogging had no name"""
    term = TermCandidate(name, f"{name}.A", 0.0, -1.0, 1.0, "N.m")
    candidate: Any = SimpleNamespace(term=term, values={f"{name}.A": 0.1}, onset=None, evidence=900.0)
    search = Search(named=[Named(candidate, (), 0.0, 900.0, {}, in_all)])
    listed: Any = Selection([SimpleNamespace(cost=5e4, run=Run())], [Selected("a.drag", 1e6)])  # type: ignore[list-item]
    both = SimpleNamespace(cost=5e4 - gain)
    monkeypatch.setattr(free_runs, "fit_added", lambda problem, at, effects, precision: both)
    plant = SimpleNamespace(terms=[term])
    found = free_runs.beside_listed(SimpleNamespace(plant=plant, evidence=500.0), listed, search)  # type: ignore[arg-type]
    assert (found is not None) == beside
    if found is not None:
        assert found[0] is both
        assert [s.term for s in found[1]] == ["a.drag", "a.teeth"]


def test_a_term_with_its_onset_predicts_better_than_none_and_none_no_better_than_it(campaign_file: Path) -> None:
    case = load_campaign(campaign_file)
    late = {name: ONSET for name in CONCEALED if "cogging" in name}
    assert free_runs.predicts_better(case, CONCEALED, {}, late)
    assert not free_runs.predicts_better(case, {}, CONCEALED, late)


@pytest.mark.parametrize(
    ("listed_takes", "off", "answered"), [(0.65, 3.0, "listed"), (0.65, 1.2, "motion"), (0.3, 3.0, "motion")]
)
def test_where_what_the_motion_names_spoils_free_runs_listed_terms_that_take_half_come_closest_and_claim_nothing(
    listed_takes: float, off: float, answered: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wheel's Stribeck friction and weight took 65 %, and were a gap and an angle error that made the runs worse."""
    samples, before = 10, 100.0
    rest: Any = SimpleNamespace(
        samples=samples,
        recorded=np.array([np.sqrt(off * before + samples)]),
        simulate=lambda runs: [SimpleNamespace(white=np.zeros(1))],
        above=lambda residual: residual,
        budget=SimpleNamespace(kept=lambda name, look: look()),
    )
    calibrated: Any = SimpleNamespace(residual=before, chi2=before + samples)
    listed: Any = SimpleNamespace(residual=(1 - listed_takes) * before)
    selection = Selection([calibrated, listed], [Selected("motor.stribeck", 65.0)])
    told = Explanation(calibrated, listed, selection, [], anchored=Search())
    monkeypatch.setattr(engine, "_select", lambda *_: told)
    monkeypatch.setattr(engine, "units_of", lambda problem: {})
    monkeypatch.setattr(engine, "anchored_diagnosis", lambda search, units: found("gear.backlash"))
    monkeypatch.setattr(engine, "in_free_runs", lambda problem, along, *_: along)
    monkeypatch.setattr(engine, "answer", lambda problem, explanation: found(*(s.term for s in explanation.selected)))
    nothing: Any = None
    diagnosis, _ = engine.explain(nothing, rest, calibrated, lambda words: None, nothing)
    (finding,) = diagnosis.findings
    assert finding.term == {"listed": "motor.stribeck", "motion": "gear.backlash"}[answered]
    assert (finding.confidence < thresholds.EVEN) == (answered == "listed")
