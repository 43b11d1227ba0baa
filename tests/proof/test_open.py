"""The campaign of the README's section "Diagnose", as it is typed there."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.long
def test_two_effects_of_which_neither_promises_much_while_the_other_is_missing_are_both_named(
    root: Path, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "cobot_joint", "diagnose", root / "proof/open/case14/campaign.toml"]
    subprocess.run([*command, "--out", tmp_path], check=True)
    answer = json.loads((tmp_path / "diagnosis.json").read_text())
    found = {f["term"]: f["confidence"] for f in answer["findings"]}
    assert found.keys() == {"motor_bldc.torque_saturation", "torque_sensor.low_pass"}
    assert min(found.values()) > 0.9
