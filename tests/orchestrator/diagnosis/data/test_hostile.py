"""Campaigns and recordings that cannot be meant are refused at load: what was given, what is allowed, where."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.errors import UserError

CAMPAIGN = 'system = "joint"\n[[recording]]\nfile = "run.csv"\nsetup = "no_load"\n'
HEADER = "time [s],v_command [V],i_motor [A],w_motor [rad/s]"


def write(folder: Path, campaign: str = CAMPAIGN, header: str = HEADER, still: bool = False) -> Path:
    """A campaign over a second of something."""
    t = np.arange(1001) * 1e-3
    rows = np.column_stack([t, np.sin(9 * t), np.zeros(1001) if still else np.cos(9 * t), 0 * t if still else 20 * t])
    np.savetxt(folder / "run.csv", rows, fmt="%.6g", delimiter=",", header=header, comments="")
    (folder / "campaign.toml").write_text(campaign)
    return folder / "campaign.toml"


def test_the_campaign_itself_is_read(tmp_path: Path) -> None:
    assert load_campaign(write(tmp_path)).outputs == ["i_motor", "w_motor"]


@pytest.mark.parametrize(
    ("head", "tail", "told"),
    [
        ('[parameters]\n"motor_bldc.winding.R" = true\n', "", "winding.R: true is given, a number is allowed"),
        ('[tolerances]\n"motor_bldc.nix" = "5 %"\n', "", "'motor_bldc.nix': no such parameter"),
        ('[tolerances]\n"motor_bldc.winding.R" = "0 %"\n', "", '"20 %" (more than 0 %) or [lower, upper] is allowed'),
        ('[logged.w_motor]\nunit = "rad/s"\ncausality = "output"\nnoise = -1\n', "", "should be greater than 0"),
        ('[logged.w_motor]\nunit = "rad/s"\ncausality = "output"\nsetups = ["zz"]\n', "", "'zz' is given, loaded, no_"),
        ('[logged.w_motor]\nunit = "9**9**9**9"\ncausality = "output"\n', "", "an SI spelling such as"),
        ("", "begin = true\n", "recording.0.begin: True is given"),
        ("", "begin = 1e9\n", "begin = 1e+09, end = inf s is given, the clock runs 0 to 1 s"),
        ("", 'time = "v_command [V]"\n', "unit 'V' is given"),
        ("", 'without = ["zz"]\n', "without = 'zz' is given, a column or connector is needed"),
        ("", "skip = 1000000\n", "skip = 1000000 is given"),
        ("", '[[recording]]\nfile = "./run.csv"\nsetup = "no_load"\n', "recording 'run.csv' is given twice"),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path: Path, head: str, tail: str, told: str) -> None:
    path = write(tmp_path, CAMPAIGN.replace("[[rec", f"{head}[[rec") + tail)
    with pytest.raises(UserError) as refused:
        load_campaign(path)
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)


def test_two_windows_of_one_file_are_two_recordings(tmp_path: Path) -> None:
    window = '[[recording]]\nfile = "run.csv"\nsetup = "no_load"\nbegin = 0.5\n'
    assert len(load_campaign(write(tmp_path, CAMPAIGN + "end = 0.5\n" + window)).recordings) == 2


def test_recordings_in_which_nothing_moves_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="i_motor, w_motor: one value in all recordings"):
        load_campaign(write(tmp_path, still=True))


def test_brackets_without_end_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path, "a = " + "[" * 100_000)
    with pytest.raises(UserError, match="not a TOML file: brackets within brackets"):
        load_campaign(path)


def test_a_column_in_two_units_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="column 'w_motor' is there 2 times"):
        load_campaign(write(tmp_path, header="time [s],v_command [V],w_motor [rpm],w_motor [rad/s]"))


def test_control_characters_of_columns_do_not_reach_the_message(tmp_path: Path) -> None:
    path = write(tmp_path, header="time [s],v_command [V],\x1b[31mi\x1b]0;t\x07 [A],w_motor [rad/s]")
    with pytest.raises(UserError) as refused:
        load_campaign(path)
    assert str(refused.value).isprintable()
