"""kill -9 at a series of moments: called again, a command gives the answer of an undisturbed one and leaves nothing.

`COBOT_JOINT_KILLS=100` kills each command that often; 5 without it.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

pytestmark = pytest.mark.long
KILLS = int(os.environ.get("COBOT_JOINT_KILLS", "5"))
PASSING = {"created", "seconds", "seconds_median"}  # what differs between two undisturbed calls

CAMPAIGN = """system = "screw_drive.ssd"
[channels]
"w" = "w"
"tau" = "tau"
[tolerances]
"friction.friction.tau_C" = [0.0, 0.01]
"friction.friction.d" = [0.0, 1e-3]
[[recording]]
file = "train.parquet"
[[recording]]
file = "later.parquet"
role = "holdout"
"""

SWEEP = """import json
from pathlib import Path
import numpy as np
import cobot_joint as cj
t = np.array([0.0, 0.1])
step = cj.Experiment(cj.Inputs(t, {"v_command": np.array([0.0, 12.0])}), stop_time=10.0)
grid = cj.sweep("joint_no_load", step, {"motor_bldc.winding.R": np.linspace(0.19, 0.23, 20)}, jobs=2)
assert not grid.errors
Path("sweep.json").write_text(json.dumps([float(result["w_motor"][-1]) for result in grid.results]))
"""


def recorded(folder: Path, root: Path) -> Path:
    """A case that is diagnosed in seconds: friction with a Stribeck effect that its model has not."""
    folder.mkdir(parents=True)
    rng, t = np.random.default_rng(1), np.arange(4001) * 1e-3
    for name, top in (("train", 40.0), ("later", 30.0)):
        w = top * np.sin(np.pi * t)
        tau = np.tanh(w / 0.05) * (2e-3 + 2e-3 * np.exp(-((w / 3) ** 2))) + 2e-5 * w
        columns = {"time [s]": t, "w [rad/s]": w, "tau [N.m]": tau + 1e-5 * rng.standard_normal(len(t))}
        pa.parquet.write_table(pa.table(columns), folder / f"{name}.parquet")
    shutil.copy(root / "proof/real/screw_drive.ssd", folder)
    (folder / "campaign.toml").write_text(CAMPAIGN)
    return folder


def start(words: list[str], folder: Path) -> subprocess.Popen[str]:
    """A command at work; its environment, and so its children's, names the folder."""
    environment = os.environ | {"KILLED_IN": str(folder), "TMPDIR": str(folder / "tmp")}
    (folder / "tmp").mkdir(exist_ok=True)
    call = [sys.executable, *words]
    return subprocess.Popen(
        call, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )


def to_its_end(words: list[str], folder: Path) -> float:
    """s that it took"""
    begin = time.monotonic()
    with start(words, folder) as process:
        _, said = process.communicate(timeout=300)
    assert process.returncode == 0, said
    return time.monotonic() - begin


def at_work(folder: Path) -> list[str]:
    """Processes that were started in a folder, whoever their parent is by now."""
    mark, found = f"KILLED_IN={folder}\0".encode(), []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if mark in (process / "environ").read_bytes() and (said := (process / "cmdline").read_bytes()):
                found.append(said.replace(b"\0", b" ").decode())
        except OSError:  # it has ended meanwhile
            continue
    return found


def left(folder: Path) -> dict[str, Any]:
    """Every file of a folder; of JSON the content, but for what passes."""
    return {
        path.relative_to(folder).as_posix(): without(json.loads(path.read_text())) if path.suffix == ".json" else None
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "tmp" not in path.relative_to(folder).parts
    }


def without(content: Any) -> Any:
    if isinstance(content, dict):
        return {k: without(v) for k, v in content.items() if k not in PASSING}
    return [without(v) for v in content] if isinstance(content, list) else content


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="processes are found in /proc")
@pytest.mark.parametrize("what", ["diagnose", "prove", "sweep"])
def test_killed_at_any_moment_and_called_again_it_ends_as_if_undisturbed(what: str, root: Path, tmp_path: Path) -> None:
    cases = {"diagnose": ["case"], "prove": ["set/a", "set/b"], "sweep": []}[what]
    words = {
        "diagnose": ["-m", "cobot_joint", "diagnose", "case"],
        "prove": ["-m", "cobot_joint", "prove", "set"],
        "sweep": ["sweep.py"],
    }[what]

    def fresh(name: str) -> Path:
        for case in cases:
            recorded(tmp_path / name / case, root)
        (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / name / "sweep.py").write_text(SWEEP)
        return tmp_path / name

    seconds = to_its_end(words, whole := fresh("whole"))
    for k in range(KILLS):
        folder = fresh(f"killed{k}")
        with start(words, folder) as process:
            time.sleep(seconds * (k + 0.5) / KILLS)
            process.kill()
        deadline = time.monotonic() + 10
        while (orphans := at_work(folder)) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert orphans == [], f"killed after {k + 0.5:g}/{KILLS} of {seconds:.1f} s"
        to_its_end(words, folder)
        assert left(folder) == left(whole), f"killed after {k + 0.5:g}/{KILLS} of {seconds:.1f} s"
        shutil.rmtree(folder)
