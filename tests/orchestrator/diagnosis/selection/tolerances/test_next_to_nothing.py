"""Beside a parameter that leaves next to nothing of what is above noise, leaving less proves nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem, one_blas_thread
from cobot_joint.diagnosis.findings import Estimate, Feature, Finding, Form
from cobot_joint.diagnosis.plant.correction import Factor, Product
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.tolerances import outside
from cobot_joint.diagnosis.selection.tolerances.letting_go import leaves_least
from cobot_joint.diagnosis.selection.tolerances.outside import Outside, look_outside
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled
from cobot_joint.diagnosis.store import Store
from tests.orchestrator.diagnosis.axis import NOMINAL, Axis, campaign


@cache
def heavy() -> tuple[Problem, Fit, Fit]:
    """(problem, calibrated, with the inertia free) of an axis of 1.6 times its inertia, and a little windage."""
    case = campaign({"axis.J": 1.6 * NOMINAL["axis.J"], "axis.windage.c": 3e-6})
    with one_blas_thread():
        problem, base = calibrate(case, Axis(), lambda words: None, Store(None))
        best = leaves_least(problem, base, 0.5 * problem.above(base.residual))
    assert best is not None
    share = problem.above(best.residual) / problem.above(base.residual)
    assert 0.002 < share < 0.02
    assert problem.unexplained(best.residual)
    return problem, base, best


def leaving(share: float, fit: Fit) -> Fit:
    """A fit, as if it left that share of its chi-square."""
    return replace(fit, residual=share**0.5 * fit.residual, chi2=share * fit.chi2)


def formula(fit: Fit) -> Unmodelled:
    feature = Feature(Product((Factor("w", "u3"),)), Estimate(1.0, "N.m", (0.9, 1.1)))
    shape = Form("axis.tau_add", "N.m", (), (feature,), 0.9)
    return Unmodelled(fit, [], Finding("axis.unlisted", (), 0.9, None, {}, {}, 1e3, shape=shape), 0.99)


@pytest.mark.parametrize(("times", "instead"), [(0.99, True), (1.01, False)])
def test_a_parameter_that_takes_more_than_the_first_of_several_terms_is_the_finding_though_they_leave_less(
    times: float, instead: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hoist's load, 30 % too heavy, left 1 %, and two frictions half of that."""
    problem, base, best = heavy()
    gain = base.cost - best.cost
    two = [Selected("axis.asymmetry", times * gain), Selected("axis.windage", 600.0)]
    monkeypatch.setattr(outside, "_in_place_of_one", lambda *_: None)  # these terms are in no fit
    monkeypatch.setattr(outside, "_beside", lambda *_: None)
    with one_blas_thread():
        found = look_outside(
            problem, base, leaving(0.4, best), two, lambda fit: Selection([base, fit]), lambda words: None
        )
    assert isinstance(found, Outside) == instead
    assert found is None or found.name == "axis.J"


@pytest.mark.parametrize(("share", "stays"), [(0.45, True), (0.6, False)])
def test_terms_beside_it_stay_where_they_take_half_of_that(share: float, stays: bool) -> None:
    """A friction by direction took 40 % of the hundredth that a load leaves that was too heavy, and 2 kg of it."""
    problem, base, best = heavy()
    above = problem.above(best.residual)
    rest = leaving((share * above + problem.samples) / best.chi2, best)
    found = outside._with_terms(
        problem, base, best, lambda fit: Selection([fit, rest], [Selected("axis.windage", 600.0)])
    )
    assert [s.term for s in found.selected] == (["axis.windage"] if stays else [])


@pytest.mark.parametrize(
    ("share", "beside", "stands"), [(0.6, (), True), (0.2, (), False), (0.6, ("axis.windage",), False)]
)
def test_alone_it_stands_beside_a_formula_that_leaves_not_so_much_less(
    share: float, beside: tuple[str, ...], stands: bool
) -> None:
    """A motor's viscous friction beside windage, which left 0.2 % together, was no answer to a cubic drag (21/6)."""
    problem, base, best = heavy()
    found = Outside(Selection([base, best], [Selected(term, 600.0) for term in beside]), base.cost - best.cost, ())
    rest = leaving((share * problem.above(best.residual) + problem.samples) / best.chi2, best)
    assert found.stands(problem, base, formula(rest)) == stands


@pytest.mark.parametrize(("parameters_do", "instead"), [(True, True), (False, False)])
def test_of_what_parameters_do_as_well_one_term_has_to_leave_a_tenth_less_to_be_the_finding(
    parameters_do: bool, instead: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hoist's load, 30 % too heavy, took 43.4 million of 47.7, and a friction by direction, two numbers, 43.8."""
    problem, base, best = heavy()
    above = problem.above(best.residual)
    explained = leaving((above / 1.08 + problem.samples) / best.chi2, best)
    monkeypatch.setattr(outside, "_parameters_do", lambda *_: parameters_do)
    monkeypatch.setattr(outside, "_beside", lambda *_: None)
    one = [Selected("axis.asymmetry", base.cost - explained.cost)]
    with one_blas_thread():
        found = look_outside(problem, base, explained, one, lambda fit: Selection([base, fit]), lambda words: None)
    assert isinstance(found, Outside) == instead
    assert found is None or found.alike[0] == "axis.asymmetry"
