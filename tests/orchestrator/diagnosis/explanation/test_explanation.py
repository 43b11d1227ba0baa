"""What a finding's own figures say against it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import fit
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.explanation.explanation import Explanation, answer
from cobot_joint.diagnosis.findings import Estimate
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from tests.orchestrator.diagnosis.axis import NOISE, NOMINAL, TERMS, Axis, campaign

FRICTION = {"axis.tau_C": (0.018, 0.022), "axis.d": (1.8e-3, 2.2e-3)}


@pytest.mark.parametrize(("interval", "claimed"), [((0.5e-5, 1.5e-5), True), ((-0.5e-5, 2.5e-5), False)])
def test_a_term_whose_size_may_be_none_is_no_claim(
    interval: tuple[float, float], claimed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = campaign({"axis.windage.c": 1e-5})
    problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
    free = tolerances(problem, FRICTION)
    base = fit(problem, Hypothesis(free))
    found = fit(problem, Hypothesis(free, (ActiveTerm(TERMS[0], {"axis.windage.c": 1e-5}),)))
    assert base is not None
    assert found is not None
    own = type(found).estimates

    def estimates(*given: object) -> dict[str, Estimate]:
        of = own(*given)  # type: ignore[arg-type]
        return of | {n: Estimate(e.value, e.unit, interval) for n, e in of.items() if n == "axis.windage.c"}

    monkeypatch.setattr(type(found), "estimates", estimates)
    selection = Selection([base, found], [Selected("axis.windage", base.cost - found.cost)])
    (finding,) = answer(problem, Explanation(base, found, selection, selection.selected)).findings
    assert (finding.confidence >= 0.5) == claimed
    assert ("its size may be none" in finding.limited_by) != claimed


@pytest.mark.parametrize(("times", "claimed"), [(1.0, True), (10.0, False)])
def test_what_is_fitted_in_runs_that_lose_the_machine_and_leaves_much_is_no_claim(times: float, claimed: bool) -> None:
    """An arm heavier than its sheet went over the top, and was a table at its gear, 65 %."""
    case = campaign({"axis.windage.c": 1e-5, "axis.cogging.A": 0.02})
    problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
    free = tolerances(problem, FRICTION)
    base = fit(problem, Hypothesis(free))
    found = fit(problem, Hypothesis(free, (ActiveTerm(TERMS[0], {"axis.windage.c": 1e-5}),)))
    assert base is not None
    assert found is not None
    assert problem.stands_out(found.residual)
    elsewhere = tuple({name: times * x for name, x in run.items()} for run in base.simulated.outputs)
    base = replace(base, simulated=replace(base.simulated, outputs=elsewhere))
    selection = Selection([base, found], [Selected("axis.windage", base.cost - found.cost)])
    (finding,) = answer(problem, Explanation(base, found, selection, selection.selected)).findings
    assert (finding.confidence >= 0.5) == claimed
    assert ("go their own way" in finding.limited_by) != claimed


@pytest.mark.parametrize(("told", "claimed"), [(1.0, True), (1e-4, False)])
def test_what_two_units_have_together_is_a_claim_though_either_may_have_none(told: float, claimed: bool) -> None:
    """Machine 127/12: a motor's and a gear's friction act alike. told: how much of their sum the recordings tell."""
    case = campaign({"axis.windage.c": 1e-5})
    problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
    windage = TERMS[0]
    twin = replace(windage, name="b.windage", amplitude="b.windage.c")
    free = tolerances(problem, FRICTION)
    base = fit(problem, Hypothesis(free))
    one = fit(problem, Hypothesis(free, (ActiveTerm(windage, {"axis.windage.c": 1e-5}),)))
    assert base is not None
    assert one is not None
    both = Hypothesis(free, tuple(ActiveTerm(t, {t.amplitude: 5e-6}) for t in (windage, twin)))
    friction, own = np.hsplit(one.jacobian, [len(free)])
    apart = 1e-4 * np.linalg.norm(own) * np.eye(len(own), 1)
    J = np.hstack([friction, told * (own + apart), told * (own - apart)])
    found = replace(one, hypothesis=both, x=both.start(), jacobian=J)
    each = found.estimates({})["axis.windage.c"].ci95
    assert each[0] < 0 < each[1]
    selected = [Selected("axis.windage", base.cost - one.cost)]
    alike = Selection([base, found], selected, indistinguishable={"b.windage": "axis.windage"})
    (finding,) = answer(problem, Explanation(base, found, alike, alike.selected)).findings
    assert (finding.confidence >= 0.5) == claimed
    assert ("its size may be none" in finding.limited_by) != claimed


@pytest.mark.parametrize("begins", [8.0, 40.0])
@pytest.mark.parametrize(("may_move", "w_S", "claimed"), [(False, 45.0, False), (False, 4.0, True), (True, 45.0, True)])
def test_a_curve_that_bends_beyond_the_speeds_driven_is_no_claim_where_no_parameter_of_its_unit_may_move(
    may_move: bool, w_S: float, claimed: bool, begins: float
) -> None:
    """A pendulum's dry friction was Stribeck friction with 108 rad/s, of a campaign without tolerances."""
    values = {"axis.stribeck.tau_S": 0.01, "axis.stribeck.w_S": w_S}
    case, plant = campaign(values), Axis()
    problem = Problem(plant, case.train, {"w": Noise(NOISE)})
    free = tolerances(problem, {"axis.d": (1e-3, 3e-3)}) if may_move else ()
    stribeck = next(t for t in TERMS if t.name == "axis.stribeck")
    (w,) = stribeck.shapes
    term = replace(stribeck, shapes=(replace(w, reached=30.0),))
    active = ActiveTerm(term, {**values, "axis.stribeck.w_S": begins})
    base, found = fit(problem, Hypothesis(free)), fit(problem, Hypothesis(free, (active,)))
    assert base is not None
    assert found is not None
    selection = Selection([base, found], [Selected("axis.stribeck", 1e5)])
    (finding,) = answer(problem, Explanation(base, found, selection, selection.selected)).findings
    assert (finding.confidence >= 0.5) == claimed
    assert ("bends beyond the speeds driven" in finding.limited_by) != claimed


@pytest.mark.parametrize(("ends", "told", "claimed"), [(2, True, True), (3, True, False), (3, False, True)])
def test_a_term_that_needs_many_parameters_at_the_ends_of_their_tolerances_is_no_claim(
    ends: int, told: bool, claimed: bool
) -> None:
    """Gravity on a robot's link, 95 % sure, with 7 parameters of 14 there, was a wrong torque constant. Those that the
    recordings do not tell may end anywhere: a conveyor's friction, by its direction, was held back for such a one."""
    case = campaign({"axis.windage.c": 1e-5})
    problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
    bounds = {name: (0.9 * value, 1.1 * value) for name, value in NOMINAL.items()}
    base = fit(problem, Hypothesis(tolerances(problem, bounds)))
    assert base is not None
    found = fit(problem, base.hypothesis.with_effects(ActiveTerm(TERMS[0], {"axis.windage.c": 1e-5})))
    assert found is not None
    x = found.x.copy()
    x[:4] = np.where(np.arange(4) < ends, 1.0, 0.5)
    found = replace(found, x=x, jacobian=found.jacobian * np.where(np.arange(len(x)) < 4, 1.0 if told else 1e-6, 1.0))
    selection = Selection([base, found], [Selected("axis.windage", base.cost - found.cost)])
    (finding,) = answer(problem, Explanation(base, found, selection, selection.selected)).findings
    assert (finding.confidence >= 0.5) == claimed
    assert ("ends of their tolerances" in finding.limited_by) != claimed


@pytest.mark.parametrize(("name", "claimed"), [("axis.cogging", True), ("axis.stribeck", False)])
def test_a_size_that_no_fit_tells_is_some_where_no_parameter_does_what_the_term_does(
    name: str, claimed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A motor's friction that is none forwards hides, in the fit with it, that its size is needed (a conveyor); one
    that bends beyond the speeds driven is dry friction."""
    shapes = {"axis.cogging": {"A": 6e-3, "n": 5.0, "phi_0": 0.4}, "axis.stribeck": {"tau_S": 6e-3, "w_S": 45.0}}
    values = {f"{name}.{short}": value for short, value in shapes[name].items()}
    problem = Problem(Axis(), campaign(values).train, {"w": Noise(NOISE)})
    free = tolerances(problem, FRICTION)
    base = fit(problem, Hypothesis(free))
    term = next(t for t in TERMS if t.name == name)
    found = fit(problem, Hypothesis(free, (ActiveTerm(term, values),)))
    assert base is not None
    assert found is not None
    monkeypatch.setattr(type(found), "estimates", lambda *_: {n: Estimate(1.0, "1", (-1.0, 1.0)) for n in values})
    selection = Selection([base, found], [Selected(name, base.cost - found.cost)])
    (finding,) = answer(problem, Explanation(base, found, selection, selection.selected)).findings
    assert ("its size may be none" in finding.limited_by) != claimed
