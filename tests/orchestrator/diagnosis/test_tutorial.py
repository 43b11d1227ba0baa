"""docs/own-bench.md, line by line: from two CSV files of another bench to a verified repair."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.diagnosis.drafts.chain import chain, with_data_sheet
from cobot_joint.system.model import Inputs

SHEET = {"motor.R": "0.61 Ohm", "motor.k_M": "38.5 mNm/A", "motor.J": "121 gcm2"}
COGGING = {"motor.cogging.A": 4e-3, "motor.cogging.n": 6.0}  # what the bench has and the data sheet does not say


def write_log(path: Path, seed: int) -> None:
    """Six seconds of a motor, logged with semicolons, in ms, mA and U/min, with noise."""
    rng, t = np.random.default_rng(seed), np.arange(6001) * 1e-3
    corners = np.r_[0.0, rng.uniform(-8, 8, 11), 0.0]
    v = np.interp(t, np.linspace(0, 6, len(corners)), corners)
    with Simulation(with_data_sheet(chain(["motor"]), SHEET).system) as simulation:
        record = ["i_motor", "w_motor"]
        run = simulation.run(Experiment(Inputs(t, {"v_command": v}), 6.0, parameters=COGGING, record=record)).signals
    i = 1e3 * (run["i_motor"] + rng.normal(0, 4e-3, len(t)))
    n = 30 / np.pi * (run["w_motor"] + rng.normal(0, 0.3, len(t)))
    rows = [";".join(f"{x:.6g}".replace(".", ",") for x in row) for row in zip(1e3 * t, v, i, n, strict=True)]
    path.write_text("Bench 3\n\nt;U_soll;I_mot;n_mot\nms;V;mA;U/min\n" + "\n".join(rows), encoding="latin-1")


@pytest.mark.long
def test_the_commands_of_the_page_lead_from_a_csv_to_a_verified_repair(tmp_path: Path, root: Path) -> None:
    for seed, name in enumerate(("run1.csv", "run2.csv")):
        write_log(tmp_path / name, seed)
    page = (root / "docs/own-bench.md").read_text()
    for line in re.findall(r"^    cobot-joint (.+)$", page, flags=re.MULTILINE):
        call = [sys.executable, "-m", "cobot_joint", *shlex.split(line)]
        done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{line}: {done.stderr}"
    answer = json.loads((tmp_path / "answer/diagnosis.json").read_text())
    assert (answer["verdict"], answer["findings"][0]["term"]) == ("explained", "motor.cogging")
    speed = json.loads((tmp_path / "answer/verify.json").read_text())["channels"]["w_motor"]
    assert speed["repaired"] < 0.5 * speed["calibrated"]
