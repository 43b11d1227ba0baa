"""What listed terms leave: the recorded motion is asked, then formulas and data sheets, and each has its place."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.signal import lfilter

from cobot_joint.diagnosis import engine, thresholds
from cobot_joint.diagnosis.anchored.search import Named, Search
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.engine import diagnose_plant
from cobot_joint.diagnosis.estimation.effects import ActiveTerm, FreeParameter
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.explanation import beyond_the_list as beyond
from cobot_joint.diagnosis.findings import Diagnosis, Estimate, Feature, Finding, Form
from cobot_joint.diagnosis.plant.correction import Factor, Product
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.tolerances import outside
from cobot_joint.diagnosis.selection.tolerances.outside import Outside
from cobot_joint.diagnosis.selection.unlisted.together import Pair
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled
from tests.orchestrator.diagnosis.axis import NOMINAL, OFF, Axis, campaign

FORMULA = "axis.unlisted"


def drifting(truth: dict[str, float] = OFF, size: float = 2e-4) -> Campaign:
    """A torque that wanders over the time of each run: no term has it, and no formula of the motion. size: of its
    steps, N.m"""
    case = campaign(truth)
    for seed, recording in enumerate(case.recordings):
        wander = lfilter([1.0], [1.0, -0.995], np.random.default_rng(seed).normal(0, size, len(recording.time)))
        clean = Axis().simulate(truth, recording, added={"axis.tau_add": wander})
        recording.outputs["w"] = recording.outputs["w"] - Axis().simulate(truth, recording)["w"] + clean["w"]
    return case


def test_where_terms_leave_more_than_noise_and_the_motion_gives_none_a_name_a_background_is_stated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stated = [{"port": "axis.tau_add", "variable": "time", "rms": 2e-3, "unit": "N.m"}]
    monkeypatch.setattr(beyond, "can_follow", lambda campaign, plant: True)
    monkeypatch.setattr(beyond, "follow", lambda campaign, plant, say, in_runs, start: Search(background=stated))
    found = diagnose_plant(drifting(), Axis())
    assert found.verdict == "undecided"  # it stands out
    assert found.findings == []
    assert found.to_json()["discrepancy"] == stated


@pytest.mark.parametrize(("takes", "said"), [(0.6, True), (0.4, False)])
def test_a_term_that_takes_half_of_what_is_left_is_the_closest_and_no_claim_where_the_motion_names_nothing(
    takes: float, said: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A gear's error that took 68 % was said to be diffuse (machine 227/9)."""
    drag = [{"port": "axis.tau_add", "variable": "w", "rms": 2e-3, "unit": "N.m"}]
    monkeypatch.setattr(beyond, "can_follow", lambda campaign, plant: True)
    monkeypatch.setattr(beyond, "follow", lambda campaign, plant, say, in_runs, start: Search(background=drag))
    monkeypatch.setattr(beyond, "look_for_unmodelled", lambda *_: None)
    monkeypatch.setattr(beyond, "look_together", lambda *_: None)
    monkeypatch.setattr(Selection, "taken", lambda self, problem: {s.term: takes for s in self.selected})
    monkeypatch.setattr(engine, "look_outside", lambda *_: None)
    case = drifting(OFF | {"axis.windage.c": 6e-5}, 8e-3)
    found = diagnose_plant(case, Axis())
    assert found.verdict == "undecided"
    assert [f.term for f in found.findings] == ["axis.windage"] * said
    assert all(f.confidence <= thresholds.WITHHELD for f in found.findings)
    assert found.to_json()["discrepancy"] == drag


def damping_outside(problem: Problem, calibrated: Fit, *_: object) -> Outside:
    """The damping outside its tolerance, whatever the recordings are."""
    base = next(b for b in calibrated.hypothesis.base if b.parameter.name == "axis.d")
    free = calibrated.hypothesis.with_effects(FreeParameter(base, NOMINAL["axis.d"]))
    fit = replace(calibrated, hypothesis=free, x=np.append(calibrated.x, 0.0))
    wider = replace(fit, jacobian=np.column_stack([fit.jacobian, np.ones(len(fit.residual))]))
    return Outside(Selection([wider]), 1e3, ())


def never(*_: object) -> None:
    raise AssertionError


def test_where_terms_explain_down_to_the_noise_the_motion_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beyond, "can_follow", lambda campaign, plant: True)
    monkeypatch.setattr(beyond, "follow", never)
    assert [f.term for f in diagnose_plant(campaign(OFF | {"axis.windage.c": 6e-5}), Axis()).findings] == [
        "axis.windage"
    ]


@pytest.mark.parametrize(("named", "leaves", "better"), [
    ("axis.cogging", 0.5, True), ("axis.cogging", 2.0, False), ("axis.windage", 0.5, False),
])  # fmt: skip
def test_a_listed_term_that_free_runs_fit_worse_than_from_where_the_motion_has_it_is_fitted_from_there(
    named: str, leaves: float, better: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A motor's cogging of order 24 was one of order 22 where its angle was logged, and free runs drift."""
    fit = cast(Fit, SimpleNamespace(cost=1e6 * leaves))
    monkeypatch.setattr(beyond, "freely", lambda problem, found, refit: fit)
    before = cast(Fit, SimpleNamespace(cost=1e6))
    listed = Selection([cast(Fit, SimpleNamespace(cost=9e6)), before], [Selected("axis.cogging", 8e6, {"other": 1.0})])
    asked = SimpleNamespace(listed=listed, calibrated=listed.history[0], problem=SimpleNamespace(evidence=500.0))
    asked.takes_most = True
    search = cast(Search, SimpleNamespace(named=[SimpleNamespace(name=named)]))
    found = beyond.BeyondTheList._from_the_motion(cast(beyond.BeyondTheList, asked), search, None)
    assert (found is not None) == better
    if found is not None:
        assert (found.fit, found.selected) == (fit, [Selected("axis.cogging", 8.5e6)])


@pytest.mark.parametrize("claimed", [True, False])
def test_a_claim_along_the_recorded_motion_is_not_held_against_a_data_sheet(
    claimed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Letting go of a parameter follows a background; only where nothing is claimed may it be the answer"""
    asked: list[bool] = []
    monkeypatch.setattr(beyond, "can_follow", lambda campaign, plant: True)
    monkeypatch.setattr(beyond, "follow", lambda campaign, plant, say, in_runs, start: Search())
    monkeypatch.setattr(Search, "claims", property(lambda self: claimed))
    monkeypatch.setattr(engine, "look_outside", lambda *_: asked.append(True))
    diagnose_plant(drifting(), Axis())
    assert bool(asked) != claimed


@pytest.mark.parametrize(
    ("name", "takes", "named"),
    [("axis.d", 0.9, ["axis.d"]), ("axis.d", 0.3, []), ("axis.J", 0.9, []), ("axis.windage", 0.9, [])],
)
def test_a_parameter_that_the_motion_claims_is_let_go_of_in_free_runs_which_may_show_what_is_beside_it(
    name: str, takes: float, named: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A brake's hysteresis, eleven times the background, was missed beside a rotor's inertia (machine 53/23)."""
    search = Search(named=[cast(Named, SimpleNamespace(name=name, alike=(), shows=True))])
    search.repaired = {name: Estimate(1.0, "1", (1.0, 1.0))}

    def let_go(problem: Problem, calibrated: Fit, value: dict[str, float], *_: object) -> Outside | None:
        fit = damping_outside(problem, calibrated).fit
        chi2 = calibrated.chi2 - takes * (calibrated.chi2 - problem.samples)
        return Outside(Selection([replace(fit, chi2=chi2)]), 1e3, ()) if "axis.d" in value else None

    monkeypatch.setattr(beyond, "can_follow", lambda campaign, plant: True)
    monkeypatch.setattr(beyond, "follow", lambda campaign, plant, say, in_runs, start: search)
    monkeypatch.setattr(beyond, "felt", lambda problem, base, listed, search: search)
    monkeypatch.setattr(beyond, "beside_listed", lambda *_: None)
    monkeypatch.setattr(beyond, "look_for_unmodelled", lambda *_: None)
    monkeypatch.setattr(Search, "claims", property(lambda self: True))
    monkeypatch.setattr(engine, "anchored_diagnosis", lambda search, units: Diagnosis("explained", [], {}, {}))
    monkeypatch.setattr(engine, "in_free_runs", lambda problem, found, *_: found)
    monkeypatch.setattr(engine, "let_go", let_go)
    monkeypatch.setattr(engine, "look_beside_parameter", lambda *_: None)
    assert [f.term for f in diagnose_plant(drifting(), Axis()).findings] == named


@pytest.mark.parametrize(
    ("function", "claimed", "named"), [("sin", True, []), ("sin", False, [FORMULA]), ("u3", True, [FORMULA])]
)
@pytest.mark.parametrize("takes_most", [False, True])
def test_a_formula_over_an_angle_gives_way_to_what_the_recorded_motion_claims(
    function: str, claimed: bool, named: list[str], takes_most: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """field/open case04: in free runs cogging has lost its angle, a formula along the recorded motion has not"""
    feature = Feature(Product((Factor("x", function),)), Estimate(1.0, "N.m", (0.9, 1.1)))
    shape = Form("axis.tau_add", "N.m", ("axis.x",), (feature,), 0.9)
    finding = Finding(FORMULA, (), 0.9, None, {}, {}, 1e3, shape=shape)

    def formula(problem: Problem, calibrated: Fit, *_: object) -> Unmodelled:
        return Unmodelled(calibrated, [], finding, 0.9)

    monkeypatch.setattr(beyond, "can_follow", lambda campaign, plant: True)
    monkeypatch.setattr(beyond, "follow", lambda campaign, plant, say, in_runs, start: Search())
    monkeypatch.setattr(beyond, "look_for_unmodelled", formula)
    monkeypatch.setattr(engine, "look_outside", lambda *_: None)
    monkeypatch.setattr(beyond, "takes_most", lambda problem, listed: takes_most)
    monkeypatch.setattr(Search, "claims", property(lambda self: claimed))
    monkeypatch.setattr(Unmodelled, "outdoes", lambda self, problem, other: True)
    assert [f.term for f in diagnose_plant(drifting(), Axis()).findings] == named


def test_a_drag_that_outdoes_listed_terms_is_the_answer_without_asking_the_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nothing that the motion says would change it; to be told that takes half a minute."""
    feature = Feature(Product((Factor("x", "u3"),)), Estimate(1.0, "N.m", (0.9, 1.1)))
    finding = Finding(FORMULA, (), 0.9, None, {}, {}, 1e3, shape=Form("axis.tau_add", "N.m", (), (feature,), 0.9))
    monkeypatch.setattr(beyond, "can_follow", lambda campaign, plant: True)
    monkeypatch.setattr(beyond, "follow", never)
    monkeypatch.setattr(beyond, "look_for_unmodelled", lambda problem, fit, *_: Unmodelled(fit, [], finding, 0.9))
    monkeypatch.setattr(engine, "look_outside", lambda *_: None)
    monkeypatch.setattr(Unmodelled, "outdoes", lambda self, problem, other: True)
    assert [f.term for f in diagnose_plant(drifting(), Axis()).findings] == [FORMULA]


@pytest.mark.parametrize(("sure", "named"), [(0.05, FORMULA), (0.8, "axis.d")])
def test_a_formula_that_leaves_less_gives_way_to_a_parameter_outside_its_tolerance_only_where_that_is_a_claim(
    sure: float, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rough places, 7 times the background, were answered with viscous friction outside its tolerance, 5 % sure."""
    feature = Feature(Product((Factor("x", "u3"),)), Estimate(1.0, "N.m", (0.9, 1.1)))
    finding = Finding(FORMULA, (), 0.9, None, {}, {}, 1e3, shape=Form("axis.tau_add", "N.m", (), (feature,), 0.9))

    monkeypatch.setattr(beyond, "look_for_unmodelled", lambda problem, fit, *_: Unmodelled(fit, [], finding, 0.9))
    monkeypatch.setattr(engine, "look_outside", damping_outside)
    monkeypatch.setattr(engine, "look_beside_parameter", lambda *_: None)
    monkeypatch.setattr(outside, "remains", lambda *_: [10.0, 1.0])
    monkeypatch.setattr(Unmodelled, "outdoes", lambda self, problem, other: False)
    monkeypatch.setattr(Outside, "confidence", lambda self, problem: sure)
    assert [f.term for f in diagnose_plant(drifting(), Axis()).findings] == [named]


@pytest.mark.parametrize("stands_out", [True, False])
def test_where_a_term_that_takes_most_leaves_what_stands_out_the_motion_is_asked_for_others(
    stands_out: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A drawn drag hid cogging of its own size from free runs"""
    both = Selected("axis.windage", 1e4)

    def beside(problem: Problem, listed: Selection, search: Search) -> tuple[Fit, list[Selected]]:
        active = ActiveTerm(next(t for t in Axis().terms if t.name == both.term), {"axis.windage.c": 1e-6})
        on = listed.fit.hypothesis.with_effects(active)
        fit = replace(listed.fit, hypothesis=on, x=np.append(listed.fit.x, active.start()))
        return replace(fit, jacobian=np.ones((len(fit.residual), len(fit.x)))), [both]

    monkeypatch.setattr(beyond, "can_follow", lambda campaign, plant: True)
    monkeypatch.setattr(beyond, "follow", lambda campaign, plant, say, in_runs, start: Search())
    monkeypatch.setattr(beyond, "look_for_unmodelled", lambda *_: None)
    monkeypatch.setattr(engine, "look_outside", lambda *_: None)
    monkeypatch.setattr(beyond, "takes_most", lambda problem, listed: True)
    monkeypatch.setattr(Problem, "stands_out", lambda self, residual: stands_out)
    monkeypatch.setattr(beyond, "beside_listed", beside)
    found = diagnose_plant(drifting(), Axis())
    assert (both.term in [f.term for f in found.findings]) == stands_out


@pytest.mark.parametrize(
    ("function", "claimed", "named"), [("u3", True, [FORMULA]), ("sin", True, []), ("sin", False, [FORMULA])]
)
def test_a_form_found_together_with_a_term_is_the_answer_but_over_an_angle_where_the_motion_claims_another(
    function: str, claimed: bool, named: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    feature = Feature(Product((Factor("x", function),)), Estimate(1.0, "N.m", (0.9, 1.1)))
    finding = Finding(FORMULA, (), 0.9, None, {}, {}, 1e3, shape=Form("axis.tau_add", "N.m", (), (feature,), 0.9))
    monkeypatch.setattr(beyond, "can_follow", lambda campaign, plant: True)
    monkeypatch.setattr(beyond, "follow", lambda campaign, plant, say, in_runs, start: Search())
    monkeypatch.setattr(beyond, "look_for_unmodelled", lambda *_: None)
    monkeypatch.setattr(
        beyond, "look_together", lambda problem, listed, *_: Pair(Unmodelled(listed.fit, [], finding, 0.9))
    )
    monkeypatch.setattr(engine, "look_outside", lambda *_: None)
    monkeypatch.setattr(Search, "claims", property(lambda self: claimed))
    assert [f.term for f in diagnose_plant(drifting(), Axis()).findings] == named


@pytest.mark.parametrize("claimed", [True, False])
def test_a_form_over_an_angle_that_leaves_what_stands_out_has_a_term_beside_it_where_the_motion_claims_nothing(
    claimed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside a motor's rough places, 16 times the background, a sensor's ripple was missed (machine 127/7)."""
    feature = Feature(Product((Factor("x", "sin"),)), Estimate(1.0, "N.m", (0.9, 1.1)))
    finding = Finding(FORMULA, (), 0.9, None, {}, {}, 1e3, shape=Form("axis.tau_add", "N.m", (), (feature,), 0.9))

    def together(problem: Problem, listed: Selection, formula: Unmodelled, *_: object) -> Pair:
        assert formula.finding is finding
        return Pair(replace(formula, finding=replace(finding, equivalent=("beside.unlisted",))))

    monkeypatch.setattr(beyond, "can_follow", lambda campaign, plant: True)
    monkeypatch.setattr(beyond, "follow", lambda campaign, plant, say, in_runs, start: Search())
    monkeypatch.setattr(beyond, "look_for_unmodelled", lambda problem, fit, *_: Unmodelled(fit, [], finding, 0.9))
    monkeypatch.setattr(beyond, "look_together", together)
    monkeypatch.setattr(engine, "look_outside", lambda *_: None)
    monkeypatch.setattr(Search, "claims", property(lambda self: claimed))
    found = diagnose_plant(drifting(), Axis()).findings
    assert [f.equivalent for f in found] == ([] if claimed else [("beside.unlisted",)])


@pytest.mark.parametrize("why", ["little is left", "it does not stand out"])
def test_a_term_and_a_form_are_not_looked_for_together_where(why: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What such a search costs is the time of all others."""
    monkeypatch.setattr(beyond, "look_together", never)
    if why == "little is left":
        monkeypatch.setattr(thresholds, "TERMS_STAND", 1.1)
    else:
        monkeypatch.setattr(Problem, "stands_out", lambda self, residual: False)
    found = diagnose_plant(drifting(), Axis())
    assert "a formula and something beside it" not in found.left_out


@pytest.mark.parametrize(
    ("names", "stands_out", "takes", "both"),
    [
        (["axis.windage"], True, 0.5, True),
        (["axis.windage"], False, 0.5, False),
        (["axis.windage", "axis.d"], True, 0.5, False),
        (["axis.windage"], True, 0.05, False),
    ],
    ids=["all that it names", "nothing stands out", "more than free runs have", "free runs have lost its angle"],
)
def test_beside_what_the_motion_names_a_formula_is_looked_for_where_free_runs_with_it_leave_what_stands_out(
    names: list[str], stands_out: bool, takes: float, both: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rough places of a motor beside a sensor's ripple (machine 127/7), 16 and 19 times the background, were missed."""
    claimed = Selected("axis.windage", 1e4)
    feature = Feature(Product((Factor("x", "u3"),)), Estimate(1.0, "N.m", (0.9, 1.1)))
    finding = Finding(FORMULA, (), 0.9, None, {}, {}, 1e3, shape=Form("axis.tau_add", "N.m", (), (feature,), 0.9))

    def with_windage(problem: Problem, listed: Selection, search: Search) -> tuple[Fit, list[Selected]]:
        active = ActiveTerm(next(t for t in Axis().terms if t.name == claimed.term), {"axis.windage.c": 1e-6})
        on = listed.fit.hypothesis.with_effects(active)
        fit = replace(listed.fit, hypothesis=on, x=np.append(listed.fit.x, active.start()))
        chi2 = listed.fit.chi2 - takes * (listed.fit.chi2 - problem.samples)
        return replace(fit, chi2=chi2, jacobian=np.ones((len(fit.residual), len(fit.x)))), [claimed]

    search = Search(named=[cast(Named, SimpleNamespace(name=name, alike=(), shows=True)) for name in names])
    monkeypatch.setattr(beyond, "can_follow", lambda campaign, plant: True)
    monkeypatch.setattr(beyond, "follow", lambda campaign, plant, say, in_runs, start: search)
    monkeypatch.setattr(beyond, "felt", lambda problem, base, listed, search: search)
    monkeypatch.setattr(engine, "anchored_diagnosis", lambda search, units: Diagnosis("explained", [], {}, {}))
    monkeypatch.setattr(engine, "in_free_runs", lambda problem, found, *_: found)
    monkeypatch.setattr(beyond, "look_for_unmodelled", lambda *_: None)
    monkeypatch.setattr(beyond, "beside_listed", with_windage)
    monkeypatch.setattr(beyond, "look_beside", lambda problem, at, say: Unmodelled(at.fit, at.selected, finding, 0.9))
    monkeypatch.setattr(Search, "claims", property(lambda self: True))
    monkeypatch.setattr(Search, "supports", lambda self, name: 0.9)
    monkeypatch.setattr(Problem, "stands_out", lambda self, residual: stands_out)
    found = diagnose_plant(drifting(), Axis())
    assert {f.term for f in found.findings} == ({claimed.term, FORMULA} if both else set())
