"""Numbers in words, and what has to be said beside the verdict."""

from __future__ import annotations

import pytest

from cobot_joint.diagnosis.report.headline import number, percent
from cobot_joint.diagnosis.report.words import notes


@pytest.mark.parametrize(("n", "said"), [(1.0, True), (6.0, False)])
def test_cogging_once_per_turn_is_said_to_be_perhaps_a_weight(n: float, said: bool) -> None:
    """A load out of balance was cogging of one slot, 65 %, and could also be nothing else."""
    cogging = {"term": "motor_bldc.cogging", "component": "motor_bldc", "parameters": {"n": {"value": n, "unit": "1"}}}
    content = {"verdict": "explained", "findings": [cogging], "channels": {}, "structure": {}, "repair": "offered"}
    assert any("a weight or an imbalance" in note for note in notes(content)) == said


def test_parameters_that_end_at_the_ends_of_their_tolerances_are_said_where_they_are_many() -> None:
    content = {"verdict": "undecided", "findings": [], "channels": {}, "structure": {}, "repair": "offered"}
    content |= {"strained": ["a.R", "a.J", "b.J"], "calibrated": {name: {} for name in ("a.R", "a.J", "b.J", "b.d")}}
    said = " ".join(notes(content))
    assert "3 of the 4 parameters" in said
    assert "(a.R, a.J, b.J)" in said
    assert "[tolerances]" in said


def test_numbers_read_as_people_write_them() -> None:
    assert number(2.1e-7) == "2.1·10⁻⁷"
    assert number(-0.5) == "−0.5"
    assert number(None) == "–"
    assert percent(0.9996) == "99.9 %"
    assert percent(0.499) == "49.9 %"  # "no effect reaches 50 %; the closest is ... (50 % sure)"
    assert percent(1.0) == "100 %"
