"""A file is there as a whole or not at all; where a disk does not take it, one line says what is missing."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cobot_joint import cli, files
from cobot_joint.files import write_atomically
from cobot_joint.results.files import SignalsWriter
from cobot_joint.system import load_system, write_ssd, write_ssp


def test_a_write_that_fails_keeps_the_old_file(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("old")

    def half(file: Path) -> None:
        file.write_text("ne")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_atomically(tmp_path / "a.json", half)
    assert (tmp_path / "a.json").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


def signals(path: Path) -> None:
    with SignalsWriter(path, {"time": "s"}, {}) as writer:
        writer.write({"time": np.zeros(3)})


@pytest.mark.parametrize("write", [signals, lambda path: write_atomically(path, lambda file: file.write_text("new"))])
def test_what_a_killed_process_left_is_taken_away(tmp_path: Path, write: Callable[[Path], None]) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    for left in (f".a.parquet.{gone.pid}.partial", f".a.parquet.x7_q.{gone.pid}.partial"):
        (tmp_path / left).touch()
    (others := tmp_path / f".a.parquet.{os.getppid()}.partial").touch()
    write(tmp_path / "a.parquet")
    assert sorted(p.name for p in tmp_path.iterdir()) == [others.name, "a.parquet"]


@pytest.mark.parametrize("write", [write_ssd, write_ssp])
def test_a_system_that_cannot_be_written_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: object
) -> None:
    (tmp_path / "a.ssp").write_text("old")
    system = load_system("joint")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("zipfile.ZipFile.writestr", full)
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space left"):
        write(system, tmp_path / "a.ssp")  # type: ignore[operator]
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("a.ssp", "old")]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_disk_is_one_line_and_status_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(files.tempfile, "TemporaryFile", lambda dir: Path("/dev/full").open("wb", buffering=0))  # noqa: SIM115
    monkeypatch.setattr(sys, "argv", ["cobot-joint", "run", "no_load", "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as left:
        cli.main()
    _, said = capfd.readouterr()
    assert (left.value.code, said) == (
        1, f"cobot-joint: {tmp_path}: No space left on device: free space is missing; --out names another folder\n"
    )  # fmt: skip


def test_a_folder_that_cannot_be_written_is_one_line_and_status_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Who may write anywhere, as root, meets this in /proc."""
    folder = Path("/proc/sys/kernel") if os.geteuid() == 0 else tmp_path
    tmp_path.chmod(0o555)
    monkeypatch.setattr(sys, "argv", ["cobot-joint", "run", "no_load", "--out", str(folder)])
    with pytest.raises(SystemExit) as left:
        cli.main()
    _, said = capfd.readouterr()
    assert left.value.code == 1
    assert said.startswith(f"cobot-joint: {folder}")
    assert said.count("\n") == 1
