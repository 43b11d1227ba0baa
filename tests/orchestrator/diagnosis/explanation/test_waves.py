"""A formula over an angle, and the listed wave that it is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from cobot_joint.diagnosis.anchored.search import Named, Search
from cobot_joint.diagnosis.estimation.effects import PortSignal
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.least_squares import fit
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.explanation.beyond_the_list import BeyondTheList
from cobot_joint.diagnosis.explanation.waves import wave_alone
from cobot_joint.diagnosis.findings import Estimate, Feature, Finding, Form
from cobot_joint.diagnosis.plant.correction import Factor, Product
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled
from tests.orchestrator.diagnosis.axis import NOISE, TERMS, Axis, campaign

COGGING = {"axis.cogging.A": 0.01, "axis.cogging.n": 3.0, "axis.cogging.phi_0": 0.4}
WAVE = (Product((Factor("phi", "sin", 3.0),)), Product((Factor("phi", "cos", 3.0),)))
TURNS = Product((Factor("phi", "sin", 3.0), Factor("w", "tanh", 1.0)))
SPEED = Product((Factor("w", "u3"),))


def formula(truth: dict[str, float], forms: tuple[Product, ...]) -> tuple[Problem, Fit, Unmodelled]:
    """These forms at the axis's port, fitted to a machine with that truth: (problem, base model's fit, formula)."""
    case, plant = campaign(truth), Axis()
    problem = Problem(plant, case.train, {"w": Noise(NOISE)})
    base = fit(problem, Hypothesis(()))
    assert base is not None
    signals = {r.name: plant.simulate(truth, r) for r in case.train}
    values = tuple(
        {n: np.prod([f.of(s[f"axis.{f.signal}"]) for f in form.factors], axis=0) for n, s in signals.items()}
        for form in forms
    )
    effect = PortSignal(plant.ports[0], tuple(map(str, forms)), values, tuple(1e-6 for _ in forms))
    found = fit(problem, Hypothesis((), (effect,)))
    assert found is not None
    features = tuple(Feature(form, Estimate(0.01, "N.m", (0.009, 0.011))) for form in forms)
    shape = Form("axis.tau_add", "N.m", ("axis.phi", "axis.w"), features, 0.95)
    finding = Finding("axis.unlisted", (), 0.95, None, {}, {}, base.cost - found.cost, shape=shape)
    return problem, base, Unmodelled(found, [], finding, 0.95)


def claimed(order: float, unit: str = "N.m") -> Search:
    term = replace(next(t for t in TERMS if t.phase), unit=unit)
    candidate = SimpleNamespace(term=term, values={**COGGING, "axis.cogging.n": order})
    return Search(named=[cast(Named, SimpleNamespace(candidate=candidate, name="axis.cogging", shows=True))])


@pytest.mark.parametrize(
    ("truth", "order", "unit", "same"),
    [
        (COGGING, 3.0, "N.m", True),
        (COGGING, 5.0, "N.m", False),
        (COGGING, 3.0, "1", False),
        ({"axis.windage.c": 3e-4}, 3.0, "N.m", False),
    ],
    ids=["cogging", "of another order", "as a share of the current", "it takes next to nothing"],
)
def test_a_formula_that_is_the_wave_which_the_motion_claims_does_not_go_before_it(
    truth: dict[str, float], order: float, unit: str, same: bool
) -> None:
    """Cogging of order 6 whose angle free runs had lost was -0.0057 sin(6 phi) and two features more, on no list."""
    problem, _, found = formula(truth, (*WAVE, SPEED))
    asked = cast(BeyondTheList, SimpleNamespace(problem=problem))
    assert BeyondTheList._is_the_claimed_wave(asked, found, claimed(order, unit)) == same


def test_of_a_formula_its_wave_alone_is_fitted_with_all_else() -> None:
    problem, base, found = formula(COGGING, (*WAVE, SPEED))
    alone = wave_alone(problem, found, 3.0)
    assert alone is not None
    (effect,) = alone.hypothesis.effects
    assert isinstance(effect, PortSignal)
    assert effect.forms == tuple(map(str, WAVE))
    assert alone.chi2 - problem.samples < 0.02 * (base.chi2 - problem.samples)


@pytest.mark.parametrize("forms", [(TURNS, SPEED), (SPEED,)], ids=["it turns with the direction", "there is none"])
def test_a_wave_that_turns_with_the_direction_is_no_cogging(forms: tuple[Product, ...]) -> None:
    """Machine 163/88."""
    problem, _, found = formula(COGGING, forms)
    assert wave_alone(problem, found, 3.0) is None
