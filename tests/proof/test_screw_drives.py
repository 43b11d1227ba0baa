"""Measured screw drives at constant speeds, unaided: what docs/proof/screw_drives.md says."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.long


def diagnosed(root: Path, drive: int, out: Path) -> dict[str, Any]:
    """diagnosis.json of the command as it is typed."""
    campaign = root / f"proof/real/screw_drive_{drive}/campaign.toml"
    subprocess.run([sys.executable, "-m", "cobot_joint", "diagnose", campaign, "--out", out], check=True)
    answer: dict[str, Any] = json.loads((out / "diagnosis.json").read_text())
    return answer


@pytest.mark.parametrize(("drive", "least", "claimed"), [(1, 4.5e-5, True), (3, 5e-5, False)])
def test_a_stribeck_effect_is_named_without_an_onset_and_predicts_other_speeds(
    root: Path, tmp_path: Path, drive: int, least: float, claimed: bool
) -> None:
    answer = diagnosed(root, drive, tmp_path)
    (finding,) = answer["findings"]
    assert finding["term"] == "friction.stribeck"
    assert (finding["confidence"] > 0.9) == claimed  # the third drive's takes less than two thirds of what is left
    assert (finding["confidence"] < 0.5) != claimed
    assert finding["onset"] is None
    assert 0.2 < finding["parameters"]["w_S"]["value"] < 12  # rad/s; driven up to 21
    heldout = answer["channels"]["tau"]["holdout"]
    assert heldout["repaired"] < least  # N.m; a fit by that law alone leaves 3.8e-5 of the first drive
    assert heldout["repaired"] < 0.8 * heldout["calibrated"]


def test_nothing_is_claimed_of_a_drive_that_coulomb_and_viscous_friction_explain(root: Path, tmp_path: Path) -> None:
    assert diagnosed(root, 2, tmp_path)["findings"] == []
