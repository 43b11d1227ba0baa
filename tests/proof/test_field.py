"""Machines that no model fits to the noise, as their answers have it: ../shared/recordings/field/open."""

from __future__ import annotations

from pathlib import Path

import pytest

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.engine import diagnose

EVEN = 0.5  # score_field.py


@pytest.mark.long
@pytest.mark.parametrize(
    ("case", "claims"),
    [("case04", ["motor_bldc.cogging"]), ("case08", [])],
    ids=["cogging whose angle free runs lose", "nothing, and a gear whose place no channel shows"],
)
def test_of_a_machine_with_a_background_what_is_concealed_is_claimed_and_nothing_else(
    shared: Path, case: str, claims: list[str]
) -> None:
    """Once cogging was a formula, 95 % sure; and a filter that was lost took the diagnosis with it, for an hour."""
    found = diagnose(load_campaign(shared / "recordings/field/open" / case / "campaign.toml", roles=("train",)))
    assert [f.term for f in found.findings if f.confidence >= EVEN] == claims
    assert all(f.onset is None for f in found.findings if f.confidence >= EVEN)  # free runs had it set in at 7.5 s
    for f in found.findings:
        if f.term == "motor_bldc.cogging":
            assert f.parameters["motor_bldc.cogging.A"].value == pytest.approx(5.79e-3, rel=0.05)  # answers.json
