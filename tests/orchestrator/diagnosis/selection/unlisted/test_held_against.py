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
