"""From a log, or from nothing, to a first campaign."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.cli import main
from cobot_joint.diagnosis.data.campaign import load_campaign

T = np.arange(4000) * 1e-3


@dataclass(frozen=True)
class Done:
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def cobot_joint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Done]:
    """The command as typed in the test's folder, in this process."""

    def call(*words: str) -> Done:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["cobot-joint", *words])
        with pytest.raises(SystemExit) as left:
            main()
        said = capsys.readouterr()
        return Done(int(left.value.code or 0), said.out, said.err)

    return call


def write(folder: Path, name: str) -> None:
    rng = np.random.default_rng(2)
    columns = [1e3 * T, 3 * np.sin(3 * T), 300 * np.sin(3 * T) + rng.normal(0, 4, len(T)), 2e3 * np.sin(3 * T)]
    columns[3] = np.minimum(columns[3] + rng.normal(0, 2, len(T)), 1500)
    rows = [";".join(f"{x:.6g}".replace(".", ",") for x in row) for row in zip(*columns, strict=True)]
    text = "Prüfstand;7\n\nZeit;U_soll;I_mot;n_mot\nms;V;mA;U/min\n" + "\n".join(rows)
    (folder / name).write_text(text, encoding="latin-1")


def test_inspect_says_what_a_log_holds_and_what_looks_wrong(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    write(tmp_path, "a.csv")
    done = cobot_joint("inspect", "a.csv", "--out", "look")
    assert (done.returncode, done.stderr) == (0, "")
    assert "a.csv: clock Zeit, 4000 samples, 3.999 s at 1000 Hz, 0 not recorded" in done.stdout
    assert [word in done.stdout for word in ("U_soll", "mA", "U/min", "noise", "saturated")] == [True] * 5
    assert "n_mot: clipped at the top, 1500" in done.stdout
    assert (tmp_path / "look/a.png").stat().st_size > 10_000


def test_inspect_with_a_system_writes_a_campaign_that_loads_with_its_guesses_marked(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    for name in ("a.csv", "b.csv"):
        write(tmp_path, name)
    done = cobot_joint("inspect", "a.csv", "b.csv", "--system", "joint")
    assert (done.returncode, done.stderr) == (0, "")
    text = (tmp_path / "campaign.toml").read_text()
    assert '"n_mot [U/min]" = "w_motor"   # guess: by its name' in text
    campaign = load_campaign(tmp_path / "campaign.toml")
    assert [(r.name, r.role) for r in campaign.recordings] == [("a", "train"), ("b", "holdout")]
    assert (set(campaign.train[0].inputs), set(campaign.train[0].outputs)) == ({"v_command"}, {"i_motor", "w_motor"})
    again = cobot_joint("inspect", "a.csv", "--system", "joint")
    assert again.returncode == 2
    assert "campaign.toml is there already" in again.stderr


def test_a_slow_clock_is_no_error_for_who_only_looks(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    (tmp_path / "a.csv").write_text("t,w\n" + "\n".join(f"{k},{np.sin(k / 50)}" for k in range(500)))
    done = cobot_joint("inspect", "a.csv")
    assert done.returncode == 0
    assert "the clock steps by 1 s: if it counts ms, say time = 't [ms]'" in done.stdout


def test_new_writes_a_system_and_a_campaign_over_it(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    done = cobot_joint("new", "--chain", "motor,gear,load", "--set", "motor.R=0.61 Ohm", "--out", "mine")
    assert (done.returncode, done.stderr) == (0, "")
    rows = "\n".join(f"{t},{np.sin(t)},{np.cos(t)},{100 * np.sin(t)},{np.sin(t)}" for t in T)
    for name in ("run1.csv", "run2.csv"):
        (tmp_path / "mine" / name).write_text(f"time,v_command,i_motor,w_motor,w_load\n{rows}")
    campaign = load_campaign(tmp_path / "mine/campaign.toml")
    assert set(campaign.outputs) == {"i_motor", "w_motor", "w_load"}
    assert campaign.tolerances["motor.winding.R"].relative == pytest.approx(0.05)


def test_new_starts_from_a_shipped_system_as_well(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    done = cobot_joint("new", "--from", "joint", "--set", "planetary_gear.N=66", "--out", "mine")
    assert (done.returncode, done.stderr) == (0, "")
    assert 'value="66.0"' in (tmp_path / "mine/system.ssd").read_text()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["new"], "one of --chain motor,gear,sensor,load and --from joint is needed"),
        (["new", "--chain", "motor,frob"], "there is no such part"),
        (["inspect", "gone.csv"], "gone.csv: there is no such file"),
        (["inspect", "text.csv"], "no row of numbers"),
        (["inspect"], "Missing argument"),
    ],
)
def test_a_wrong_call_is_one_line_and_status_2(
    tmp_path: Path, cobot_joint: Callable[..., Done], words: list[str], told: str
) -> None:
    (tmp_path / "text.csv").write_text("dear diary\ntoday\n")
    done = cobot_joint(*words)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert told in done.stderr
