"""Ctrl-C and SIGTERM: one line, exit status 130, nothing half written, nobody left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

SIGNALS = [signal.SIGINT, signal.SIGTERM]
GOES_ON = "cobot-joint: interrupted, goes on from here when called again"


def interrupted(
    words: list[str], folder: Path, number: signal.Signals, ready: Callable[[], bool]
) -> tuple[int, str, float]:
    """(exit status, what was said on stderr, s until it ended) of a command that gets a signal when `ready`."""
    call = [sys.executable, "-m", "cobot_joint", *words]
    with subprocess.Popen(call, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not ready():
            time.sleep(0.02)
        assert process.poll() is None, "it ended before it could be interrupted"
        process.send_signal(number)
        begin = time.monotonic()
        _, said = process.communicate(timeout=60)
        return process.returncode, said, time.monotonic() - begin


@pytest.mark.parametrize("number", SIGNALS)
def test_an_interrupted_run_leaves_no_file(tmp_path: Path, number: signal.Signals) -> None:
    (tmp_path / "long.toml").write_text('system = "joint"\nstop_time = 3000\n[inputs.v_command]\npoints = [[0, 2]]\n')
    out = tmp_path / "out"
    status, said, _ = interrupted(["run", "long.toml", "--out", "out"], tmp_path, number, lambda: any(out.glob(".*")))
    assert (status, said) == (130, "cobot-joint: interrupted\n")
    assert list(out.iterdir()) == []


def campaign(folder: Path) -> Path:
    """Two seconds of noise beside an input, for which a diagnosis looks for minutes."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    t = np.arange(8001) * 1e-3
    columns = {"time [s]": t, "v_command [V]": 5 * np.sin(t), "i_motor [A]": 0.1 * rng.standard_normal(len(t)),
               "w_motor [rad/s]": 180 * np.sin(t - 0.1) + rng.standard_normal(len(t))}  # fmt: skip
    pa.parquet.write_table(pa.table(columns), folder / "run.parquet")
    (folder / "campaign.toml").write_text('[[recording]]\nfile = "run.parquet"\nsetup = "no_load"\n')
    return folder


@pytest.mark.long
@pytest.mark.parametrize("number", SIGNALS)
def test_an_interrupted_diagnosis_says_that_it_goes_on(tmp_path: Path, number: signal.Signals) -> None:
    case = campaign(tmp_path / "case")
    kept = case / "diagnosis" / ".work"
    status, said, seconds = interrupted(["diagnose", str(case)], tmp_path, number, lambda: any(kept.glob("*.npz")))
    progress, _, last = said.rstrip("\n").rpartition("\n")
    assert (status, last) == (130, GOES_ON)
    assert "Traceback" not in progress
    assert "interrupted" not in progress
    assert seconds < 30
    assert all(p.suffix == ".npz" and not p.name.startswith(".") for p in kept.iterdir())


@pytest.mark.long
@pytest.mark.parametrize("number", SIGNALS)
def test_an_interrupted_proof_ends_what_it_has_started(tmp_path: Path, number: signal.Signals) -> None:
    for name in ("case1", "case2", "case3"):
        campaign(tmp_path / name)
    status, said, seconds = interrupted(
        ["prove", str(tmp_path)], tmp_path, number, lambda: len(list(tmp_path.glob("*/.work/*.npz"))) >= 1
    )
    assert (status, said) == (130, GOES_ON + "\n")
    assert seconds < 30
    lines = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout.splitlines()
    assert [line for line in lines if str(tmp_path) in line] == []
    assert not (tmp_path / "case3" / ".work").exists()


@pytest.mark.skipif(os.name != "posix", reason="a process learns of its parent's end on POSIX only")
def test_a_process_ends_with_a_parent_that_is_killed() -> None:
    child = (
        "import os, time; from cobot_joint.interrupts import end_with; end_with(os.getppid()); print(1); time.sleep(60)"
    )
    parent = f"import subprocess, sys; subprocess.run([sys.executable, '-uc', {child!r}])"
    with subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.kill()
        begin = time.monotonic()
        process.stdout.read()  # until nobody holds the other end
    assert time.monotonic() - begin < 10


def test_handlers_are_those_of_before(monkeypatch: pytest.MonkeyPatch) -> None:
    from cobot_joint import cli

    before = [signal.getsignal(number) for number in SIGNALS]
    monkeypatch.setattr(sys, "argv", ["cobot-joint", "--help"])
    with pytest.raises(SystemExit):
        cli.main()
    assert [signal.getsignal(number) for number in SIGNALS] == before
