"""Logs at one speed each become a table."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.data.campaign import load_campaign
from tests.orchestrator.diagnosis.typed import Done

SPEEDS = [5.0, -5.0, 10.0, -10.0, 20.0, -20.0, 30.0, -30.0, 40.0, -40.0, 50.0, -50.0, 60.0, -60.0, 70.0, -70.0]
T = np.arange(400) * 1e-3


@pytest.fixture
def machine(tmp_path: Path, cobot_joint: Callable[..., Done]) -> Path:
    """A folder with a table's system, and logs of 16 speeds in both directions, torque in N.m and in %."""
    assert cobot_joint("new", "--chain", "friction", "--out", "machine").returncode == 0
    rng = np.random.default_rng(1)
    for k, w in enumerate(SPEEDS):
        tau = 0.02 * np.sign(w) + 1e-4 * w + rng.normal(0, 1e-4, len(T))
        table = np.column_stack([T, w + rng.normal(0, 0.3, len(T)), tau, 1e3 * tau])
        names = "t [s],speed [rad/s],torque [N.m],Torque actual value [%]"
        np.savetxt(tmp_path / f"{k}.csv", table, delimiter=",", header=names, comments="")
    return tmp_path


def drafted(cobot_joint: Callable[..., Done], *logs: str) -> str:
    assert cobot_joint("inspect", *logs, "--system", "machine/system.ssd", "--out", "first").returncode == 0
    return Path("first/campaign.toml").read_text()


def test_logs_at_one_speed_each_are_drafted_as_a_table_of_which_every_fourth_speed_is_held_out(
    machine: Path, monkeypatch: pytest.MonkeyPatch, cobot_joint: Callable[..., Done]
) -> None:
    monkeypatch.chdir(machine)
    drafted(cobot_joint, *(f"{k}.csv" for k in range(len(SPEEDS))))
    campaign = load_campaign(machine / "first/campaign.toml")
    assert campaign.title == machine.name  # not that of one log
    (fitted,), (held_out,) = campaign.train, campaign.holdout
    assert np.isfinite(fitted.outputs["tau"]).sum() == 12
    speeds = held_out.inputs["w"][np.isfinite(held_out.outputs["tau"])]
    np.testing.assert_allclose(speeds, [-50, -10, 20, 60], atol=0.1)


def test_logs_in_which_the_speed_moves_are_drafted_as_runs(
    machine: Path, monkeypatch: pytest.MonkeyPatch, cobot_joint: Callable[..., Done]
) -> None:
    monkeypatch.chdir(machine)
    for k in range(4):
        table = np.column_stack([T, 50 * np.sin(20 * T + k), np.cos(20 * T), 10 * np.cos(20 * T)])
        names = "t [s],speed [rad/s],torque [N.m],Torque actual value [%]"
        np.savetxt(f"{k}.csv", table, delimiter=",", header=names, comments="")
    assert "table" not in drafted(cobot_joint, *(f"{k}.csv" for k in range(4)))


def test_a_torque_in_percent_alone_is_drafted_with_a_place_for_what_100_percent_is(
    machine: Path, monkeypatch: pytest.MonkeyPatch, cobot_joint: Callable[..., Done]
) -> None:
    monkeypatch.chdir(machine)
    for k in range(len(SPEEDS)):
        lines = (machine / f"{k}.csv").read_text().splitlines()
        kept = [",".join(cell for j, cell in enumerate(line.split(",")) if j != 2) for line in lines]
        (machine / f"{k}.csv").write_text("\n".join(kept))
    text = drafted(cobot_joint, *(f"{k}.csv" for k in range(len(SPEEDS))))
    line = next(line for line in text.splitlines() if "[%]" in line)
    assert line.startswith(
        '# "Torque actual value [%]" = { to = "tau", scale = "RATED N.m" }   # not used: in place of'
    )
    filled = line.removeprefix("# ").replace("RATED", "0.1").split("   #")[0]
    Path("first/campaign.toml").write_text(text.replace(line, filled))
    tau = load_campaign(machine / "first/campaign.toml").train[0].outputs["tau"]
    np.testing.assert_allclose(tau[np.isfinite(tau)].max(), 0.02 + 1e-4 * 70, rtol=0.01)
