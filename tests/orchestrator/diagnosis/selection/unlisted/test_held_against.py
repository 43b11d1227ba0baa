"""A formula held against parameters and the listed terms beside them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from cobot_joint.diagnosis.selection.unlisted import held_against


@pytest.mark.parametrize(
    ("left", "sought"),
    [
        pytest.param(0.5, False, id="gravity on an elbow beside a freed inertia"),
        pytest.param(0.05, True, id="terms may do the rest"),
    ],
)
def test_no_terms_are_sought_beside_a_parameter_that_leaves_far_more_than_a_formula(
    monkeypatch: pytest.MonkeyPatch, left: float, sought: bool
) -> None:
    """The formula, of two features, leaves a thousandth: all but 3*2*0.001 of what there is would have to be taken."""
    shares = {"freed": left, "formula": 0.001}
    monkeypatch.setattr(held_against, "remains", lambda problem, *fits: [shares[fit] for fit in fits])
    formula: Any = SimpleNamespace(fit="formula", freedom=2)
    asked: list[Any] = []
    nothing: Any = None
    freed: Any = "freed"
    select: Any = lambda fit: asked.append(fit) or "terms"  # noqa: E731
    found = held_against.within_reach(nothing, formula, select)(freed)
    assert (found == "terms", asked) == (sought, ["freed"] if sought else [])
    assert sought or found.history == ["freed"]


@pytest.mark.parametrize(("terms", "needed"), [(1, 0.9), (2, 0.8)])
@pytest.mark.parametrize("stand", [True, False])
def test_a_formula_alone_has_to_take_more_than_listed_terms_that_stand_do(
    monkeypatch: pytest.MonkeyPatch, terms: int, needed: float, stand: bool
) -> None:
    """A load that sticks takes 0.87 of a rotary table's misfit, the best formula 0.84, which took a minute to fit."""
    left = 0.1 if stand else 0.5
    monkeypatch.setattr(held_against, "remains", lambda problem, listed, start: [0.1, 1.0])
    problem: Any = SimpleNamespace(
        excess=lambda residual: residual,
        stands_out=lambda residual: True,
        excess_scatter=1e-9,
        unexplained=lambda _: True,
    )
    fits: Any = SimpleNamespace(residual=left), SimpleNamespace(residual=1.0)
    listed: Any = SimpleNamespace(fit=fits[0], selected=[None] * terms, imitates=False)
    asked: list[float] = []
    monkeypatch.setattr(held_against, "look_at_ports", lambda *_, needed: asked.append(needed))
    monkeypatch.setattr(held_against, "look_beside", lambda *_: None)
    assert held_against.look_for_unmodelled(problem, fits[1], listed, lambda words: None) is None
    assert asked == [pytest.approx(needed if stand else 0.0)]
