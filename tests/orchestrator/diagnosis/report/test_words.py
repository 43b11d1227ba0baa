"""What has to be said beside the verdict."""

from __future__ import annotations

import pytest

from cobot_joint.diagnosis.report.words import notes


@pytest.mark.parametrize(("n", "said"), [(1.0, True), (6.0, False)])
def test_cogging_once_per_turn_is_said_to_be_perhaps_a_weight(n: float, said: bool) -> None:
    """A load out of balance was cogging of one slot, 65 %, and could also be nothing else."""
    cogging = {"term": "motor_bldc.cogging", "component": "motor_bldc", "parameters": {"n": {"value": n, "unit": "1"}}}
    content = {"verdict": "explained", "findings": [cogging], "channels": {}, "structure": {}, "repair": "offered"}
    assert any("a weight or an imbalance" in note for note in notes(content)) == said
