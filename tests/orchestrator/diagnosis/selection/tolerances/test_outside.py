"""A base parameter outside its tolerance is named itself, not the physics that imitates it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np
import pytest

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.data.campaign_file import Tolerance
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.engine import diagnose_plant
from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import fit, fit_added
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem, one_blas_thread
from cobot_joint.diagnosis.explanation import beyond_the_list
from cobot_joint.diagnosis.findings import Estimate, Feature, Finding, Form
from cobot_joint.diagnosis.plant.correction import Factor, Product
from cobot_joint.diagnosis.plant.plant import Signals
from cobot_joint.diagnosis.selection.competition import finished
from cobot_joint.diagnosis.selection.elimination import kept_beside
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.tolerances.letting_go import held, leaves_least
from cobot_joint.diagnosis.selection.tolerances.outside import (
    Outside,
    in_place_of,
    let_go,
    look_outside,
    nearly_alone,
)
from cobot_joint.diagnosis.selection.unlisted import held_against
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled, look_at_ports
from cobot_joint.diagnosis.store import Store
from tests.orchestrator.diagnosis.axis import NOISE, NOMINAL, TERMS, Axis, Driven, campaign, weak_drive


def test_beside_it_a_form_on_no_list_is_told_from_the_term_that_patches_both() -> None:
    """A brake's torque and a drag beside it (machine 109/4) had an asymmetric friction, the brake's torque 6 % off."""
    found = diagnose_plant(weak_drive(eddy_currents=0.05), Driven())
    assert {f.term for f in found.findings} == {"drive.k", "axis.unlisted"}
    assert found.repaired["drive.k"].value == pytest.approx(0.7 * NOMINAL["axis.k"], rel=0.02)


@pytest.mark.parametrize(("name", "times"), [("axis.d", 0.5), ("axis.J", 1.6), ("axis.tau_C", 1.8)])
def test_a_parameter_outside_its_tolerance_is_the_finding_with_its_value(name: str, times: float) -> None:
    found = diagnose_plant(campaign({name: times * NOMINAL[name]}), Axis())
    first = found.findings[0]
    assert found.verdict == "explained"
    assert [f.term for f in found.findings] == [name]
    assert first.confidence > 0.9
    low, high = first.parameters[name].ci95
    assert low < times * NOMINAL[name] < high
    assert found.repaired[name].value == pytest.approx(times * NOMINAL[name], rel=0.02)
    assert found.calibrated[name].value == pytest.approx((0.9 if times < 1 else 1.1) * NOMINAL[name])


def test_a_parameter_that_takes_nearly_all_is_the_answer_before_formulas_are_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An axis whose load was 1.6 times as heavy as its data sheet says took minutes: a form imitated it."""

    def never(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(beyond_the_list, "look_for_unmodelled", never)
    found = diagnose_plant(campaign({"axis.J": 1.6 * NOMINAL["axis.J"]}), Axis())
    assert [f.term for f in found.findings] == ["axis.J"]
    assert found.findings[0].confidence > 0.9
    assert found.repaired["axis.J"].value == pytest.approx(1.6 * NOMINAL["axis.J"], rel=0.02)


def test_one_term_that_takes_no_more_does_not_keep_a_parameter_waiting() -> None:
    """It was asked for after the formulas of every port."""
    case = campaign({"axis.J": 1.6 * NOMINAL["axis.J"], "axis.windage.c": 3e-6})
    problem, base = calibrate(case, Axis(), lambda words: None, Store(None))
    best = leaves_least(problem, base, 0.5 * problem.above(base.residual))
    assert best is not None
    assert problem.stands_out(best.residual)
    alike = Selection([base, best], [Selected("axis.windage", base.cost - best.cost)])  # as if it did as well
    found = nearly_alone(problem, alike, lambda fit: Selection([fit]), lambda words: None)
    assert found is not None
    assert (found.name, found.alike) == ("axis.J", ("axis.windage",))


class TwoBodies(Axis):
    """The axis and a load on one stiff shaft. load: its inertia, of a whole that is the axis's."""

    def __init__(self, load: float = 0.4e-3) -> None:
        super().__init__()
        own = self.parameters["axis.J"]
        self.parameters["load.J"] = replace(own, name="load.J", nominal=load)
        self.parameters["axis.J"] = replace(own, nominal=own.nominal - load)

    def has(self, name: str, recording: Recording) -> bool:
        """See Plant.has."""
        return super().has(name, recording) or name.split(".")[0] == "load"

    def simulate(self, values: Mapping[str, float], recording: Recording, **others: Any) -> Signals:
        """See Plant.simulate."""
        own = {name: self.parameters[name].nominal for name in ("axis.J", "load.J")} | dict(values)
        return super().simulate({**own, "axis.J": own["axis.J"] + own.pop("load.J")}, recording, **others)


def test_another_parameter_that_would_leave_as_little_is_said_with_it() -> None:
    """A carriage 40 % too heavy was a rotor of 3.7 times its inertia, 95 %, and could also be nothing else."""
    case = campaign({"axis.J": 1.6 * NOMINAL["axis.J"]})
    case = replace(case, tolerances={**case.tolerances, "load.J": Tolerance(relative=0.1)})
    (found,) = diagnose_plant(case, TwoBodies()).findings
    assert {found.term, *found.equivalent} == {"axis.J", "load.J"}


@pytest.mark.parametrize("load", [0.4e-3, 0.0])
def test_so_is_one_that_the_campaign_gives_no_tolerance(load: float) -> None:
    """A conveyor's roller, whose viscous friction was 0 in the system, had what its motor was said to have."""
    (found,) = diagnose_plant(campaign({"axis.J": 1.6 * NOMINAL["axis.J"]}), TwoBodies(load)).findings
    assert (found.term, found.equivalent) == ("axis.J", ("load.J",))


class TwoFrictions(Axis):
    """The axis and a load on one stiff shaft, each with a friction that differs by direction."""

    def __init__(self) -> None:
        own = next(t for t in TERMS if t.name == "axis.asymmetry")
        super().__init__((*TERMS, replace(own, name="load.asymmetry", amplitude="load.asymmetry.tau_A")))

    def has(self, name: str, recording: Recording) -> bool:
        """See Plant.has."""
        return super().has(name, recording) or name.split(".")[0] == "load"

    def simulate(self, values: Mapping[str, float], recording: Recording, **others: Any) -> Signals:
        """See Plant.simulate."""
        own = {"axis.asymmetry.tau_A": 0.0, **values}
        more = own.pop("load.asymmetry.tau_A", 0.0)
        return super().simulate(own | {"axis.asymmetry.tau_A": own["axis.asymmetry.tau_A"] + more}, recording, **others)


def test_a_term_beside_it_is_said_with_the_other_unit_that_may_have_it() -> None:
    """A conveyor's gear had the friction that was claimed of its motor alone, on one shaft with it."""
    case = campaign({"axis.asymmetry.tau_A": 6e-3, "axis.d": 1.6 * NOMINAL["axis.d"]})
    said = {f.term: f.equivalent for f in diagnose_plant(case, TwoFrictions()).findings}
    assert said == {"axis.d": (), "axis.asymmetry": ("load.asymmetry",)}


@pytest.mark.parametrize("strained", [True, False])
def test_where_a_term_needs_many_parameters_at_their_ends_one_that_takes_nearly_as_much_is_found(
    strained: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gravity on a robot's link took 96.4 % with seven of them there, a wrong mass 94.8 % with three."""
    case = campaign({"axis.windage.c": 3e-5})
    problem, base = calibrate(case, Axis(), lambda words: None, Store(None))
    listed = fit_added(problem, base, [ActiveTerm(TERMS[0], {"axis.windage.c": 1e-6})], finished(2, steps=30))
    assert listed is not None
    monkeypatch.setattr(Fit, "is_strained", lambda found, _: strained and bool(found.hypothesis.terms))
    taken = Selected("axis.windage", base.cost - listed.cost)
    found = look_outside(problem, base, listed, [taken], lambda best: Selection([best]), lambda words: None)
    if strained:
        assert isinstance(found, Outside)
        assert thresholds.ABREAST * taken.gain < found.gain < taken.gain
    else:
        assert found is None


def test_a_listed_term_beside_it_is_named_as_well() -> None:
    truth = {
        "axis.d": 0.4 * NOMINAL["axis.d"],
        "axis.cogging.A": 6e-3,
        "axis.cogging.n": 5.0,
        "axis.cogging.phi_0": 0.4,
    }
    found = diagnose_plant(campaign(truth), Axis())
    assert {f.term for f in found.findings} == {"axis.d", "axis.cogging"}


def test_a_term_whose_re_fit_ends_at_a_bound_keeps_its_name_where_no_parameter_explains_it() -> None:
    found = diagnose_plant(campaign({"axis.windage.c": 2e-4}), Axis())
    assert [f.term for f in found.findings] == ["axis.windage"]


def test_beside_listed_terms_it_makes_needless_what_stood_in_for_it_and_held_again_it_leaves_more() -> None:
    """A winding's resistance beside load friction (machine 127/12) was a dead time, 74 % sure."""
    case, plant = weak_drive(windage=2e-4), Driven()
    with one_blas_thread():
        problem, base = calibrate(case, plant, lambda words: None, Store(None))
        at, selected = base, []
        for name in ("axis.windage", "axis.asymmetry"):
            term = next(t for t in plant.terms if t.name == name)
            found = fit_added(problem, at, [ActiveTerm(term, {term.amplitude: 1e-5})], finished(1))
            assert found is not None
            selected.append(Selected(name, problem.evidence))
            at = found
        free = leaves_least(problem, at, 0.0)
        assert free is not None
        fit, kept = kept_beside(problem, free, selected)
        inside = held(problem, fit)
    assert [s.term for s in kept] == ["axis.windage"]
    assert {e.name for e in fit.hypothesis.effects} == {"axis.windage", "drive.k"}
    assert inside is not None
    assert [e.name for e in inside.hypothesis.effects] == ["axis.windage"]
    assert inside.run.values["drive.k"] == pytest.approx(0.9 * NOMINAL["axis.k"])
    assert inside.cost > fit.cost + problem.evidence


@pytest.mark.parametrize("asymmetry", [0.0, 3e-3])
def test_in_place_of_the_listed_term_that_stood_in_for_it_beside_another_it_is_the_finding(asymmetry: float) -> None:
    """Beside load friction a brake's torque per ampere was a sensor's gain, 95 % sure (machine 191/13 of wrong sheets);
    a term that is there stays."""
    truth = {"axis.windage.c": 2e-4, "axis.asymmetry.tau_A": asymmetry, "axis.d": (1.0 if asymmetry else 0.4) * 2e-3}
    case, plant = campaign(truth), Axis()
    with one_blas_thread():
        problem, base = calibrate(case, plant, lambda words: None, Store(None))
        at, selected = base, []
        for name in ("axis.windage", "axis.asymmetry" if asymmetry else "axis.stribeck"):
            term = next(t for t in plant.terms if t.name == name)
            shapes = {s.name: s.values[0] for s in term.shapes}
            found = fit_added(problem, at, [ActiveTerm(term, {term.amplitude: 1e-5, **shapes})], finished(2))
            assert found is not None
            selected.append(Selected(name, at.cost - found.cost))
            at = found
        outside = look_outside(problem, base, at, selected, lambda fit: Selection([fit]), lambda words: None)
    if asymmetry:
        assert outside is None
    else:
        assert isinstance(outside, Outside)
        assert outside.name == "axis.d"
        assert [s.term for s in outside.selection.selected] == ["axis.windage"]
        assert outside.fit.run.values["axis.d"] == pytest.approx(0.4 * 2e-3, rel=0.1)


@pytest.mark.parametrize("k", [0.7, 1.0], ids=["a data sheet", "eddy currents"])
def test_a_formula_beside_a_listed_term_that_a_parameter_leaves_no_more_than_is_that_parameter(k: float) -> None:
    """A voltage of 0.134 ohm times the current, beside load friction, was on no list (machine 127/12)."""
    case, plant = weak_drive(windage=2e-4, k=k, eddy_currents=0.0 if k < 1 else 0.3), Driven()
    with one_blas_thread():
        problem, base = calibrate(case, plant, lambda words: None, Store(None))
        term = next(t for t in plant.terms if t.name == "axis.windage")
        listed = fit_added(problem, base, [ActiveTerm(term, {term.amplitude: 1e-4})], finished(1))
        assert listed is not None
        formula = look_at_ports(problem, listed, [Selected(term.name, base.cost - listed.cost)], lambda words: None)
        assert formula is not None
        found = in_place_of(problem, base, formula, lambda words: None)
        alone = in_place_of(problem, base, replace(formula, selected=[]), lambda words: None)
    assert alone is None  # of a formula alone `look_outside` asks
    assert (found is not None) == (k < 1)
    if found is not None:
        assert found.name == "drive.k"
        values = found.fit.run.values  # but for a factor that torques and inertia share
        ratio = values["drive.k"] / values["axis.windage.c"]
        assert ratio == pytest.approx(k * NOMINAL["axis.k"] / 2e-4, rel=0.01)
        assert found.fit.chi2 < 1.1 * problem.samples
        assert [s.term for s in found.selection.selected] == ["axis.windage"]


def with_windage(problem: Problem, fit: Fit) -> Selection:
    term = next(t for t in Axis().terms if t.name == "axis.windage")
    found = fit_added(problem, fit, [ActiveTerm(term, {term.amplitude: 1e-4})], finished(2))
    assert found is not None
    return Selection([fit, found], [Selected(term.name, fit.cost - found.cost)])


@pytest.mark.parametrize(("rest", "instead"), [(100.0, True), (300.0, False)])
def test_beside_it_a_form_that_leaves_less_per_feature_takes_the_place_of_several_terms(
    rest: float, instead: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A motor's drag beside a brake's torque constant was friction that warms up, and an asymmetry (machine 163/27)."""
    with one_blas_thread():
        problem, base = calibrate(weak_drive(), Driven(), lambda words: None, Store(None))
        free = leaves_least(problem, base, 0.0)
    assert free is not None
    feature = Feature(Product((Factor("w", "u3"),)), Estimate(1.0, "N.m", (0.9, 1.1)))
    finding = Finding(
        "axis.unlisted", (), 0.9, None, {}, {}, 1e3, shape=Form("axis.tau_add", "N.m", (), (feature,), 0.9)
    )
    patched = Selection([free, free, free], [Selected("axis.windage", 600.0), Selected("axis.asymmetry", 600.0)])
    monkeypatch.setattr(held_against, "look_at_ports", lambda *_, **__: Unmodelled(free, [], finding, 0.98))
    monkeypatch.setattr(held_against, "look_beside", lambda *_: None)
    monkeypatch.setattr(held_against, "remains", lambda *_: [120.0, rest])
    monkeypatch.setattr(Problem, "unexplained", lambda self, residual: True)
    found = held_against.look_beside_parameter(problem, patched, lambda words: None)
    assert (found is not None) == instead


@pytest.mark.parametrize("needed", [False, True])
def test_one_that_stood_in_for_listed_terms_goes_again_once_these_are_found_beside_it(needed: bool) -> None:
    """A supply that sags was answered with a winding's resistance out of tolerance beside it (machine 151/10)."""
    truth = {"axis.windage.c": 2e-4, "axis.d": (0.4 if needed else 1.0) * NOMINAL["axis.d"]}
    case = campaign(truth)
    with one_blas_thread():
        problem, base = calibrate(case, Axis(), lambda words: None, Store(None))
        found = look_outside(problem, base, base, [], partial(with_windage, problem), lambda words: None)
    assert found is not None
    if needed:
        assert isinstance(found, Outside)
        assert found.name == "axis.d"
    else:
        assert isinstance(found, Selection)
        assert found.fit.hypothesis.terms[0].name == "axis.windage"
        assert found.fit.run.values["axis.d"] == pytest.approx(NOMINAL["axis.d"], rel=0.02)
        assert found.fit.chi2 < 1.1 * problem.samples


@pytest.mark.parametrize(
    ("name", "times", "takes"), [("axis.d", 0.4, True), ("axis.d", 1.0, False), ("axis.k", 1.0, False)]
)
def test_a_parameter_that_is_let_go_of_from_a_value_on_has_what_is_found_beside_it(
    name: str, times: float, takes: bool
) -> None:
    """Beside a brake's torque constant, which the motion claimed, a motor's drag was missed (machine 163/27)."""
    with one_blas_thread():
        truth = {"axis.d": times * NOMINAL["axis.d"], "axis.windage.c": 2e-4 if takes else 0.0}
        problem, base = calibrate(campaign(truth), Axis(), lambda words: None, Store(None))
        value = {name: times * NOMINAL[name]}
        found = let_go(problem, base, value, ("axis.alike",), partial(with_windage, problem))
    assert (found is not None) == takes
    if found is not None:
        assert found.name == name
        assert found.alike == ("axis.alike",)
        assert [s.term for s in found.selection.selected] == ["axis.windage"]
        assert found.fit.run.values[name] == pytest.approx(times * NOMINAL[name], rel=0.05)


def test_one_that_is_let_go_of_and_not_needed_beside_what_is_found_goes_again() -> None:
    with one_blas_thread():
        problem, base = calibrate(campaign({"axis.windage.c": 2e-4}), Axis(), lambda words: None, Store(None))
        begun = {"axis.d": 1.5 * NOMINAL["axis.d"]}
        assert let_go(problem, base, begun, (), lambda fit: Selection([fit])) is not None
        assert let_go(problem, base, begun, (), partial(with_windage, problem)) is None


@pytest.mark.parametrize("quick", [0.0, 2.2])
def test_one_that_takes_half_of_what_is_slow_is_the_finding_where_something_quick_is_larger(quick: float) -> None:
    """A brake's saturation current, 12 times the background, beside impacts in a gap that grew (machine 163/42)."""
    case = campaign({"axis.d": 0.4 * NOMINAL["axis.d"]})
    for recording in case.recordings:
        size = quick * float(np.std(recording.outputs["w"] - Axis().simulate({}, recording)["w"]))
        recording.outputs["w"] = recording.outputs["w"] + size * (-1.0) ** np.arange(len(recording.time))
    with one_blas_thread():
        problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
        base = fit(
            problem, Hypothesis(tolerances(problem, {n: t.bounds(NOMINAL[n]) for n, t in case.tolerances.items()}))
        )
        assert base is not None
        free = leaves_least(problem, base, 0.0)
        assert free is not None
        patched = replace(base, residual=1.01 * free.residual)  # by terms that are no answer
        found = look_outside(problem, base, patched, [], lambda fit: Selection([fit]), lambda words: None)
        better = replace(base, residual=0.9 * free.residual)
        other = look_outside(problem, base, better, [], lambda fit: Selection([fit]), lambda words: None)
    assert isinstance(found, Outside)
    assert found.name == "axis.d"
    assert (found.gain < thresholds.HOLDS * (base.chi2 - problem.samples)) == (quick > 0)
    assert (other is None) == (quick > 0)


@pytest.mark.parametrize("at", ["lower", None])
@pytest.mark.parametrize("unexplained", [True, False])
def test_a_parameter_that_ends_at_what_its_unit_allows_and_leaves_more_than_noise_is_no_claim(
    at: Literal["lower"] | None, unexplained: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    with one_blas_thread():
        problem, base = calibrate(
            campaign({"axis.d": 0.5 * NOMINAL["axis.d"]}), Axis(), lambda words: None, Store(None)
        )
        free = leaves_least(problem, base, 0.0)
    assert free is not None
    outside = Outside(Selection([free]), base.cost - free.cost, ())
    value = Estimate(0.0, "N.m.s/rad", (0.0, 1e-4), at)
    monkeypatch.setattr(Problem, "unexplained", lambda self, residual: unexplained)
    finding = outside.finding(problem, base, {"axis.d": value})
    assert (finding.confidence < thresholds.EVEN) == (at is not None and unexplained)
