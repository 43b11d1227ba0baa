"""Scoreboards side by side."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from cobot_joint.diagnosis.evaluation.score import scoreboard

COMPARE = Path(__file__).parents[2] / "proof" / "compare.py"


def test_scoreboards_stand_side_by_side(tmp_path: Path) -> None:
    answers = {"case01": {"effects": [], "noise_rho": 0.0}}
    for name, found in (("ours", []), ("theirs", [{"term": "a.b", "equivalent": [], "confidence": 0.9}])):
        case = tmp_path / name / "case01"
        case.mkdir(parents=True)
        case.joinpath("diagnosis.json").write_text(json.dumps({"verdict": "nothing_missing", "findings": found}))
        score = scoreboard(answers, tmp_path / name) | {"seconds_median": 1.5}
        (tmp_path / name / "scoreboard.json").write_text(json.dumps(score))
    told = [f"{name}={tmp_path / name}" for name in ("ours", "theirs")]
    ended = subprocess.run([sys.executable, COMPARE, *told], capture_output=True, text=True, check=True)
    lines = ended.stdout.splitlines()
    assert lines[0] == "| | ours | theirs |"
    assert "| healthy with a claim | 0 of 1 (0.00 to 0.79) | 1 of 1 (0.21 to 1.00) |" in lines
    assert "| seconds median | 1.5 | 1.5 |" in lines
