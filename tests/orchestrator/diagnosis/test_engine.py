"""What the diagnosis claims, on an axis whose truth is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.signal import lfilter
from threadpoolctl import threadpool_info, threadpool_limits

from cobot_joint.diagnosis.candidates.scan import Scan
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.engine import diagnose_plant, identify, verdict
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import Precision, bounded_step, fit
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.explanation import explanation
from cobot_joint.diagnosis.findings import Diagnosis, Estimate, Finding, Verdict
from cobot_joint.diagnosis.plant.plant import Plant, Signals
from cobot_joint.diagnosis.repair.repair import onsets
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.stepwise import Selector
from cobot_joint.diagnosis.store import Store
from cobot_joint.diagnosis.thresholds import EVEN, EVIDENCE
from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.axis import (
    NOISE,
    NOMINAL,
    OFF,
    OFFSET,
    ORDERS,
    PUSH,
    TERMS,
    Axis,
    Driven,
    campaign,
    weak_drive,
)
from tests.orchestrator.diagnosis.bench import calibrated


def problem(case, axis=None):  # type: ignore[no-untyped-def]
    return Problem(axis or Axis(), case.train, {"w": Noise(NOISE)})


def bounds(case):  # type: ignore[no-untyped-def]
    return {name: t.bounds(NOMINAL[name]) for name, t in case.tolerances.items()}


@pytest.mark.parametrize("colour", [0.0, 0.5, 0.8])
def test_whitening_leaves_white_noise_of_unit_variance(colour: float) -> None:
    rng = np.random.default_rng(3)
    y = lfilter([np.sqrt(1 - colour**2)], [1, -colour], rng.normal(0, 1.0, 3000))
    rounded = 0.5 * np.round(y / 0.5)
    seen = float(np.mean(rounded[1:] * rounded[:-1]) / np.var(rounded))
    p = Problem(Axis(), campaign({}).train[:1], {"w": Noise(float(np.std(rounded)), seen, 0.5)})
    white = p.whiten([{"w": rounded}])
    assert np.var(white) == pytest.approx(1.0, rel=0.06)
    assert abs(np.mean(white[1:] * white[:-1])) < 4 / np.sqrt(3000)


@pytest.mark.parametrize("ask", [diagnose_plant, identify])
def test_linear_algebra_takes_one_thread_beside_the_simulations_and_gives_back_the_others(
    ask: Callable[[Campaign, Plant], Diagnosis],
) -> None:
    def threads() -> list[int]:
        return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

    class Watched(Axis):
        def simulate(self, *arguments: Any, **more: Any) -> Signals:
            during.extend(threads())
            return super().simulate(*arguments, **more)

    during: list[int] = []
    with threadpool_limits(2, "blas"):
        before = threads()
        assert set(before) == {2}
        ask(campaign(OFF), Watched())
        assert threads() == before
    assert set(during) == {1}


def test_a_bounded_step_is_that_of_the_textbook_solver() -> None:
    rng = np.random.default_rng(5)
    J, r = rng.normal(size=(50, 4)), rng.normal(size=50)
    lower, upper = -0.1 * np.ones(4), 0.1 * np.ones(4)
    step, decrease = bounded_step(J.T @ J, J.T @ r, lower, upper)
    assert step == pytest.approx(lsq_linear(J, r, (lower, upper), method="bvls").x, abs=1e-8)
    assert decrease == pytest.approx(r @ r - np.sum((r - J @ step) ** 2))


def test_a_refit_finds_the_parameters_and_its_intervals_hold_them() -> None:
    case = campaign(OFF)
    p = problem(case)
    found = fit(p, Hypothesis(tolerances(p, bounds(case))))
    assert found is not None
    estimates = found.estimates({})
    for name, value in OFF.items():
        low, high = estimates[name].ci95
        assert low - 0.5 * (high - low) < value < high + 0.5 * (high - low), name
    assert found.chi2 == pytest.approx(p.samples, rel=0.05)


def test_a_jacobian_by_differences_that_brought_little_was_the_last() -> None:
    case = campaign(OFF)
    p = problem(case)
    best = fit(p, Hypothesis(tolerances(p, bounds(case))))
    assert best is not None
    near, column = best.x.copy(), best.jacobian[:, 0]
    near[0] += np.sqrt(200 / (column @ column))  # two steps' worth of chi-square away
    before, one = p.runs, len(p.recordings)
    again = fit(p, best.hypothesis, near, precision=Precision(settled=100.0, roughly=1e-6))
    assert again is not None
    assert again.cost < best.cost + 1
    assert p.runs - before == one * (1 + len(best.x) + again.steps)  # the start, the differences once, a run per step


def test_a_refit_stays_inside_the_tolerances_and_says_where_it_ends_at_one() -> None:
    case = campaign({"axis.d": 3e-3})
    p = problem(case)
    found = fit(p, Hypothesis(tolerances(p, bounds(case))))
    assert found is not None
    assert found.estimates({})["axis.d"].value == pytest.approx(1.1 * NOMINAL["axis.d"])
    assert found.estimates({})["axis.d"].at == "upper"


@pytest.mark.parametrize("colour", [0.0, 0.8])
def test_a_healthy_campaign_yields_nothing_missing_whatever_the_colour_of_its_noise(colour: float) -> None:
    found = diagnose_plant(campaign(OFF, colour), Axis())
    assert found.verdict == "nothing_missing"
    assert found.findings == []


@pytest.mark.parametrize(
    "effect",
    [
        {"axis.windage.c": 4e-5},
        {"axis.asymmetry.tau_A": 4e-3},
        {"axis.cogging.A": 4e-3, "axis.cogging.n": 5.0, "axis.cogging.phi_0": 0.7},
    ],
    ids=["windage", "asymmetry", "cogging"],
)
def test_a_concealed_term_is_named_with_its_parameters(effect: dict[str, float]) -> None:
    found = diagnose_plant(campaign(OFF | effect), Axis())
    name = next(iter(effect)).rsplit(".", 1)[0]
    assert found.verdict == "explained"
    assert [f.term for f in found.findings] == [name]
    for parameter, value in effect.items():
        assert found.findings[0].parameters[parameter].value == pytest.approx(value, rel=0.15), parameter


def test_a_refit_that_ended_early_is_gone_on_with_and_nothing_is_named() -> None:
    case = campaign(OFF)
    p = problem(case)
    hypothesis = Hypothesis(tolerances(p, bounds(case)))
    early, whole = fit(p, hypothesis, precision=Precision(steps=1)), fit(p, hypothesis)
    assert early is not None
    assert whole is not None
    assert early.cost > whole.cost + EVIDENCE
    selection = Selector(p, Scan(p, TERMS), lambda words: None).select(early)
    assert selection.selected == []
    assert selection.history[0].cost == pytest.approx(whole.cost, abs=10)


def test_two_concealed_terms_are_both_named() -> None:
    found = diagnose_plant(
        campaign(OFF | {"axis.asymmetry.tau_A": 4e-3, "axis.cogging.A": 4e-3, "axis.cogging.n": 3.0}), Axis()
    )
    assert {f.term for f in found.findings} == {"axis.asymmetry", "axis.cogging"}


def test_an_effect_that_sets_in_during_the_run_is_dated() -> None:
    effect = {"axis.cogging.A": 6e-3, "axis.cogging.n": 5.0}
    found = diagnose_plant(campaign(OFF | effect, onsets={"axis.cogging.A": 2.6}), Axis())
    assert [f.term for f in found.findings] == ["axis.cogging"]
    assert found.findings[0].onset == pytest.approx(2.6, abs=0.1)


def test_where_a_campaign_says_that_nothing_sets_in_no_onset_is_looked_for() -> None:
    case = campaign(OFF | {"axis.cogging.A": 6e-3, "axis.cogging.n": 5.0}, onsets={"axis.cogging.A": 2.6})
    late, fixed = (diagnose_plant(replace(case, onsets=onsets), Axis()) for onsets in (True, False))
    assert late.findings[0].onset == pytest.approx(2.6, abs=0.1)
    assert all(f.onset is None for f in fixed.findings)


@pytest.mark.parametrize(("true", "guess"), [(2.6, 2.4), (None, 0.7)])
def test_an_onset_that_was_found_while_a_later_term_was_off_is_looked_at_again(
    true: float | None, guess: float
) -> None:
    cogging, windage = (next(t for t in TERMS if t.name == name) for name in ("axis.cogging", "axis.windage"))
    values = {"axis.cogging.A": 6e-3, "axis.cogging.n": 5.0, "axis.cogging.phi_0": 0.4}
    effect = values | {"axis.windage.c": 2e-4}
    case = campaign(OFF | effect, onsets={"axis.cogging.A": true} if true else None)
    p = problem(case)
    active = ActiveTerm(cogging, values, guess), ActiveTerm(windage, {"axis.windage.c": 1e-4})
    before = fit(p, Hypothesis(tolerances(p, bounds(case)), active))
    assert before is not None
    assert p.unexplained(before.residual)
    found = Selector(p, Scan(p, TERMS), lambda words: None).with_onsets(before)
    assert not p.unexplained(found.residual)
    assert found.hypothesis.terms[0].onset == (true and pytest.approx(true, abs=0.01))


def test_a_term_of_a_unit_whose_parameters_are_all_known_is_named() -> None:
    found = diagnose_plant(campaign({"sensor.offset.y_0": 0.3}), Axis((*TERMS, OFFSET)))
    assert [f.term for f in found.findings] == ["sensor.offset"]
    assert found.findings[0].parameters["sensor.offset.y_0"].value == pytest.approx(0.3, rel=0.02)


@pytest.mark.parametrize(("begin", "length", "T"), [(2.13, 0.15, -0.03), (4.0, 1.2, -0.006)])
def test_a_push_is_found_wherever_it_begins_and_however_short_it_is(begin: float, length: float, T: float) -> None:
    truth = {"axis.push.t_0": begin, "axis.push.T_d": length, "axis.push.T": T}
    found = diagnose_plant(campaign(truth), Axis((*TERMS, PUSH)))
    assert [f.term for f in found.findings] == ["axis.push"]
    values = {n.split(".")[-1]: p.value for n, p in found.findings[0].parameters.items()}
    assert values["t_0"] == pytest.approx(begin, abs=2e-3)
    assert values["T_d"] == pytest.approx(length, abs=2e-3)
    assert values["T"] == pytest.approx(T, rel=0.02)


def test_an_effect_that_no_term_has_is_called_unlisted_and_given_its_form() -> None:
    found = diagnose_plant(campaign(OFF, extra="sin(3 phi) sgn(w)"), Axis())
    assert found.verdict == "unlisted"
    assert [f.term for f in found.findings] == ["axis.unlisted"]
    form = found.findings[0].shape
    assert form is not None
    assert form.port == "axis.tau_add"
    assert str(form.features[0].form) == "sin(3*phi)*sgn(w)"
    assert form.features[0].coefficient.value == pytest.approx(-6e-3, rel=0.15)


def test_without_the_true_term_in_the_catalogue_none_of_the_others_is_dressed_as_it() -> None:
    effect = {"axis.cogging.A": 6e-3, "axis.cogging.n": 5.0, "axis.cogging.phi_0": 1.0}
    found = diagnose_plant(campaign(OFF | effect), Axis([t for t in TERMS if t.phase is None]))
    assert [f.term for f in found.findings] == ["axis.unlisted"]


def test_orders_are_found_without_simulating_each_of_them() -> None:
    axis = Axis()
    diagnose_plant(campaign(OFF | {"axis.cogging.A": 4e-3, "axis.cogging.n": 7.0}), axis)
    cogging_scanned_in_full = 2 * 2 * len(ORDERS.values)
    one_scan = cogging_scanned_in_full + 2 * 2 * 4
    assert axis.runs < 10 * one_scan


@pytest.mark.parametrize(
    ("effect", "words", "share"),
    [
        ({"axis.windage.c": 4e-5}, "round 1", 1.0),
        ({"axis.asymmetry.tau_A": 4e-3, "axis.cogging.A": 4e-3, "axis.cogging.n": 3.0}, "round 2", 0.6),
    ],
    ids=["after the re-fit", "after the first term"],
)
def test_an_interrupted_diagnosis_goes_on_and_gives_the_same_answer(
    tmp_path: Path, effect: dict[str, float], words: str, share: float
) -> None:
    case, fresh = campaign(OFF | effect), Axis()
    whole = diagnose_plant(case, fresh)

    def interrupt(said: str) -> None:
        if said.startswith(words):
            raise KeyboardInterrupt

    store = Store(tmp_path, "axis")
    with pytest.raises(KeyboardInterrupt):
        diagnose_plant(case, Axis(), progress=interrupt, store=store)
    resumed, third = Axis(), Axis()
    again = diagnose_plant(case, resumed, store=store)
    assert {**again.to_json(), "seconds": 0} == {**whole.to_json(), "seconds": 0}
    assert resumed.runs < share * fresh.runs
    diagnose_plant(case, third, store=store)
    assert third.runs < 0.1 * resumed.runs


def test_what_was_found_beyond_listed_terms_is_gone_on_from(tmp_path: Path) -> None:
    """An axis that was stopped after nine minutes needed seven to get there again."""
    case, fresh, resumed = weak_drive(eddy_currents=0.05), Driven(), Driven()
    whole = diagnose_plant(case, fresh)

    def interrupt(said: str) -> None:
        if said.startswith("a signal at"):
            raise KeyboardInterrupt

    store = Store(tmp_path, "drive")
    with pytest.raises(KeyboardInterrupt):
        diagnose_plant(case, Driven(), progress=interrupt, store=store)
    again = diagnose_plant(case, resumed, store=store)
    assert {**again.to_json(), "seconds": 0} == {**whole.to_json(), "seconds": 0}
    assert resumed.runs < 0.5 * fresh.runs


def test_at_its_bounds_nothing_is_rounded_beyond_them() -> None:
    for scale in np.random.default_rng(0).uniform(1e-3, 1, 200):
        active = ActiveTerm(
            TERMS[2], {"axis.cogging.A": 0.05 * scale, "axis.cogging.phi_0": 0.3, "axis.cogging.n": 3.0}
        )
        hypothesis = Hypothesis((), (active,))
        most = [c.upper for c in hypothesis.coordinates]
        assert abs(hypothesis.run(most).values["axis.cogging.A"]) <= TERMS[2].upper


def test_bristles_under_all_of_a_shafts_friction_are_found_in_both_units_and_named_once() -> None:
    units = ("motor_bldc", "planetary_gear")
    concealed = {f"{u}.presliding.{name}": value for u in units for name, value in (("share", 1.0), ("phi_s", 0.1))}
    with calibrated(concealed) as (bench, base):
        terms = [t for t in bench.plant.terms if t.name.endswith(".presliding")]
        selection = Selector(bench, Scan(bench, terms), lambda words: None).select(base)
        assert [n.term for n in selection.selected] == ["motor_bldc.presliding"]
        assert {a.term.component for a in selection.fit.hypothesis.terms} == set(units)
        assert not bench.unexplained(selection.fit.residual)


def test_an_effect_in_two_units_sets_in_at_the_same_time_in_the_repaired_system() -> None:
    finding = {"term": "motor_bldc.presliding", "equivalent": ["planetary_gear.presliding"], "onset": 2.5}
    found = onsets([finding], {"loaded": load_system("joint_logged")})
    assert found == {"motor_bldc.presliding.share": 2.5, "planetary_gear.presliding.share": 2.5}


def test_what_a_shaft_feels_in_either_unit_is_one_answer() -> None:
    """Both units of the shaft list these; their columns stand out of a simulation's roughness far enough to tell."""
    alike = ["stribeck", "sublinear_viscous", "windage", "friction_asymmetry", "viscous_warmup"]
    with calibrated({}) as (p, fitted):
        scan = Scan(p, [t for t in p.plant.terms if t.name.split(".")[1] in alike])
        scan.columns(fitted)
        assert scan.indistinguishable == {f"planetary_gear.{name}": f"motor_bldc.{name}" for name in alike}


def test_probing_amplitudes_answer_far_above_roughness_and_need_no_second_try() -> None:
    with calibrated({}) as (p, fitted):
        scan, before = Scan(p, p.plant.terms), p.runs
        probes = scan.probes(fitted)
        assert p.runs - before <= 1.3 * len(p.plant.terms)
        columns = scan.columns(fitted)
        sizes = {c.term.name: float(np.sqrt(np.mean((c.vectors[0] * probes[c.term.name]) ** 2))) for c in columns}
    small = {name: size for name, size in sizes.items() if size < 0.02}
    assert set(small) <= {t.name for t in p.plant.terms if probes[t.name] >= 0.4 * (t.upper - t.neutral)}, small


@pytest.mark.parametrize(("share", "counts"), [(0.92, False), (0.99, True)])
def test_a_load_that_comes_and_goes_must_take_nearly_all_to_count_beside_a_background(
    share: float, counts: bool
) -> None:
    p = problem(campaign({}), Axis((*TERMS, PUSH)))
    above, quick = 1e5, (-1.0) ** np.arange(p.rows)
    fits = [
        SimpleNamespace(residual=quick * np.sqrt((p.samples + left) / p.rows)) for left in (above, (1 - share) * above)
    ]
    for name in ("axis.push", "axis.windage"):
        selection = Selection(fits, [Selected(name, share * above)])  # type: ignore[arg-type]
        believed = explanation.sure_beside_background(p, selection).get(name, 0.0) >= EVEN
        assert believed == (counts or name == "axis.windage")


@pytest.mark.parametrize(("at", "component", "sure"), [("upper", "a", 0.45), (None, "a", 0.9), ("upper", "b", 0.9)])
def test_two_terms_of_one_unit_of_which_one_ends_at_a_bound_are_no_claim(
    at: Literal["upper"] | None, component: str, sure: float
) -> None:
    """proof/sealed case18: eddy currents were imitated by friction that saturates, all of it, and by windage"""
    at_its_end = Estimate(1.0, "1", (1.0, 1.0), at)
    first = Finding("a.first", (), 0.9, None, {"a.first.x": at_its_end}, {}, 50.0)
    second = Finding(f"{component}.second", (), 0.9, None, {}, {}, 40.0)
    assert explanation._together(second, [first, second]).confidence == sure


@pytest.mark.parametrize(
    ("given", "sure", "left_out", "said"),
    [
        ("explained", [0.9, 0.2], [], "explained"),
        ("explained", [0.45, 0.2], [], "undecided"),
        ("unlisted", [0.3], [], "undecided"),
        ("nothing_missing", [], [], "nothing_missing"),
        ("nothing_missing", [], ["formulas"], "undecided"),
    ],
)
def test_a_verdict_claims_no_more_than_its_findings(
    given: Verdict, sure: list[float], left_out: list[str], said: Verdict
) -> None:
    """A healthy axis was `explained` by a term that was 20 % sure."""
    findings = [Finding("axis.windage", (), c, None, {}, {}, 1.0) for c in sure]
    assert verdict(Diagnosis(given, findings, {}, {}, left_out=left_out)) == said
