"""Recordings without what drove the machine: refused before anything is fitted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.orchestrator.diagnosis.typed import Done

T = np.arange(4000) * 1e-3


def refused(tmp_path: Path, cobot_joint: Callable[..., Done], chain: str, column: str, connector: str) -> str:
    """What is said of a run in which the column is all that was connected."""
    assert cobot_joint("new", "--chain", chain, "--out", "axis").returncode == 0
    rows = np.column_stack([T, np.sin(3 * T), np.cos(3 * T)])
    header = f"t [s],{column},tau [N.m]"
    np.savetxt(tmp_path / "axis/run.csv", rows, delimiter=",", header=header, comments="")
    text = 'title = "axis"\nsystem = "system.ssd"\nrecording = [{ file = "run.csv" }]\n[channels]\n'
    (tmp_path / "axis/campaign.toml").write_text(text + f'"{column.split()[0]}" = "{connector}"\n')
    done = cobot_joint("diagnose", "axis/campaign.toml", "--out", "found")
    assert done.returncode == 2
    return done.stderr


def test_a_campaign_that_nothing_drives_is_refused(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    assert "no column drives the system" in refused(tmp_path, cobot_joint, "load", "w_load [rad/s]", "w_load")


def test_so_is_one_without_its_drive_that_falls_by_itself_otherwise(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    """A hoist whose duty cycle was left unconnected was simulated as it fell, for three minutes."""
    said = refused(tmp_path, cobot_joint, "motor,gear,link", "w_motor [rad/s]", "w_motor")
    assert "no column drives the system" in said
    assert "v_command" in said
