"""What a draft makes of the logs of a drive that is commanded a current."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import guess
from cobot_joint.errors import UserError
from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.typed import Done

T = 1e-3 * np.arange(2000)
GOES_IN = {"to": "v_command", "scale": "1 V/A"}


def drafted(
    folder: Path, cobot_joint: Callable[..., Done], columns: dict[str, float], mode: str = "current"
) -> dict[str, Any]:
    """The campaign that is drafted from a log with these columns, of this size; the column of time is added."""
    rows = np.column_stack([T, *(size * np.sin(9 * T + k) for k, size in enumerate(columns.values()))])
    np.savetxt(folder / "a.csv", rows, fmt="%.6g", delimiter=",", header=",".join(["t [s]", *columns]), comments="")
    made = cobot_joint("new", "--chain", "motor,load", "--set", f"motor.drive.mode={mode}", "--out", "m")
    assert made.returncode == 0, made.stderr
    done = cobot_joint("inspect", "a.csv", "--system", "m/system.ssd", "--out", "f")
    assert done.returncode == 0, done.stderr
    return tomllib.loads((folder / "f/campaign.toml").read_text())


def feedforward(folder: Path) -> float:
    return load_system(str(folder / "m/system.ssd")).component("motor").parameters["drive.decoupling"]


@pytest.mark.parametrize(("given", "share"), [([], 1.0), (["--set", "motor.drive.decoupling=0.5"], 0.5)])
def test_a_drive_in_current_mode_loses_nothing_to_the_back_emf_unless_that_is_given(
    tmp_path: Path, cobot_joint: Callable[..., Done], given: list[str], share: float
) -> None:
    """A servo motor of 0.36 N.m/A had the rotor's inertia twice, by the resistance of the bench's motor."""
    mode = ["--set", "motor.drive.mode=current"]
    assert cobot_joint("new", "--chain", "motor,load", "--out", "m", *mode, *given).returncode == 0
    assert feedforward(tmp_path) == share


def test_the_measured_current_goes_in_where_no_set_value_is_logged(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    """It was compared, and nothing drove the machine."""
    draft = drafted(tmp_path, cobot_joint, {"Iq_ist [mA]": 1500.0, "Drehzahl [U/min]": 1200.0})
    assert draft["channels"] == {"Iq_ist [mA]": GOES_IN, "Drehzahl [U/min]": "w_motor"}
    assert feedforward(tmp_path) == 1  # what was measured flows, whatever the loop does
    (recording,) = load_campaign(tmp_path / "f/campaign.toml").recordings
    assert np.max(recording.inputs["v_command"]) == pytest.approx(1.5, rel=1e-3)


def test_a_set_torque_goes_in_over_the_torque_constant_and_the_drives_own_torque_is_its_current(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    """Names as CANopen drives have them (CiA 402); a column that names no part is the drive's."""
    columns = {"Target torque [Nm]": 0.5, "Torque actual value [Nm]": 0.5, "Velocity actual value [rpm]": 900.0}
    draft = drafted(tmp_path, cobot_joint, columns | {"Drum speed [rpm]": 900.0})
    k = load_system(str(tmp_path / "m/system.ssd")).component("motor").parameters["winding.k"]
    assert draft["channels"] == {
        "Target torque [Nm]": {"to": "v_command", "scale": f"{1 / k:g} V/(N.m)"},
        "Torque actual value [Nm]": {"to": "i_motor", "scale": f"{1 / k:g} A/(N.m)"},
        "Velocity actual value [rpm]": "w_motor",
        "Drum speed [rpm]": "w_load",
    }
    (recording,) = load_campaign(tmp_path / "f/campaign.toml").recordings
    assert np.max(recording.inputs["v_command"]) == pytest.approx(0.5 / k, rel=1e-3)


@pytest.mark.parametrize(("times", "behind"), [(1.0, False), (50.0, True), (7.0, False)])
def test_a_set_torque_is_the_joint_s_where_the_current_says_that_it_is_so_many_times_the_motor_s(
    tmp_path: Path, cobot_joint: Callable[..., Done], times: float, behind: bool
) -> None:
    """A leg's controller asked for 6 times the motor's, and `diagnose` said that the current was read wrongly."""
    given = ["--set", "motor.drive.mode=current", "--set", "motor.k=0.1", "--set", "gear.N=50"]
    assert cobot_joint("new", "--chain", "motor,gear,load", "--out", "m", *given).returncode == 0
    amperes = 2 * np.sin(9 * T)
    rows = np.column_stack([T, 0.1 * times * amperes, amperes, np.cos(9 * T)])
    np.savetxt(
        tmp_path / "a.csv", rows, delimiter=",", header="t [s],torque_cmd [Nm],iq [A],w_load [rad/s]", comments=""
    )
    assert cobot_joint("inspect", "a.csv", "--system", "m/system.ssd", "--out", "f").returncode == 0
    text = (tmp_path / "f/campaign.toml").read_text()
    line = next(line for line in text.splitlines() if line.startswith('"torque_cmd'))
    assert f'scale = "{0.2 if behind else 10:g} V/(N.m)"' in line
    assert ("50 times the motor's by its current" in line) == behind
    assert ("if it is the torque behind the gear, 0.2 V/(N.m)" in line) == (not behind)


def test_a_measured_torque_goes_in_where_no_set_value_is_logged(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    draft = drafted(tmp_path, cobot_joint, {"Torque actual value [Nm]": 0.5, "Velocity actual value [rpm]": 900.0})
    assert draft["channels"]["Torque actual value [Nm]"]["to"] == "v_command"


def test_a_torque_in_percent_is_offered_to_the_drive_with_what_its_rated_value_is_in(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    """Without the rated torque nothing drives the machine: the draft has the line, but for that number. It offered
    an angle of the load."""
    columns = {"Target torque [%]": 90.0, "Torque actual value [%]": 90.0, "Velocity actual value [rpm]": 900.0}
    drafted(tmp_path, cobot_joint, columns)
    k = load_system(str(tmp_path / "m/system.ssd")).component("motor").parameters["winding.k"]
    text = (tmp_path / "f/campaign.toml").read_text()
    rated = "not used: in place of RATED, what 100 % of it is; 1 {} is a torque of " + f"{k:g} N.m"
    asked = '# "Target torque [%]" = { to = "v_command", scale = "RATED V" }   # ' + rated.format("V")
    assert asked in text.splitlines()
    told = '# "Torque actual value [%]" = { to = "i_motor", scale = "RATED A" }   # ' + rated.format("A")
    assert told in text.splitlines()


def test_a_set_value_goes_in_before_a_measured_current(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    draft = drafted(tmp_path, cobot_joint, {"i_ist [A]": 1.5, "i_soll [A]": 1.5, "n_motor [rpm]": 1200.0})
    assert draft["channels"] == {"i_ist [A]": "i_motor", "i_soll [A]": GOES_IN, "n_motor [rpm]": "w_motor"}
    assert "parameters" not in draft
    assert feedforward(tmp_path) == 1


def test_a_current_whose_name_ends_with_its_unit_goes_in(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    """`phase_A` is not in A."""
    draft = drafted(tmp_path, cobot_joint, {"phase_A": 1.0, "motor_current_A": 1.5, "motor_speed_rad_s": 120.0})
    assert draft["channels"] == {"motor_current_A [A]": GOES_IN, "motor_speed_rad_s [rad/s]": "w_motor"}


def test_a_q_axis_current_is_a_current(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    """`ank.iq_cmd_A` was taken for volts."""
    draft = drafted(tmp_path, cobot_joint, {"ank.iq_cmd_A": 1.5, "ank.iq_act_A": 1.5, "ank.mot_vel_rpm": 1200.0})
    assert draft["channels"] == {
        "ank.iq_act_A [A]": "i_motor", "ank.iq_cmd_A [A]": GOES_IN, "ank.mot_vel_rpm [rpm]": "w_motor"
    }  # fmt: skip


def test_a_draft_that_nothing_drives_is_said_to_lack_an_input(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    np.savetxt(tmp_path / "a.csv", np.column_stack([T, np.sin(9 * T)]), delimiter=",", header="t [s],n [rpm]")
    assert cobot_joint("new", "--chain", "motor,load", "--out", "m").returncode == 0
    done = cobot_joint("inspect", "a.csv", "--system", "m/system.ssd", "--out", "f")
    assert (
        "no column is an input of the system: `diagnose` needs one for v_command, or a start in [initial]\n"
        in done.stdout
    )
    done = cobot_joint("inspect", "a.csv", "--system", "f/campaign.toml", "--out", "g")
    assert (done.returncode, "--system f/campaign.toml is given, a campaign" in done.stderr) == (2, True)


def test_what_the_loop_makes_of_no_account_has_no_tolerance(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    """The winding's resistance: the loop gives whatever voltage the current takes."""
    draft = drafted(tmp_path, cobot_joint, {"i [A]": 1.5, "n_motor [rpm]": 1200.0})
    assert "motor.winding.R" not in draft["tolerances"]
    assert "motor.winding.k" in draft["tolerances"]


def test_the_current_of_a_drive_that_is_commanded_a_voltage_is_compared(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    columns = {"u_soll [V]": 5.0, "i_ist [A]": 1.5, "n_motor [rpm]": 1200.0}
    draft = drafted(tmp_path, cobot_joint, columns, mode="voltage")
    assert draft["channels"] == {"u_soll [V]": "v_command", "i_ist [A]": "i_motor", "n_motor [rpm]": "w_motor"}
    assert "motor.winding.R" in draft["tolerances"]


@pytest.mark.parametrize(
    ("columns", "found"),
    [
        (["Drehzahl"], {"w_motor": "Drehzahl"}),
        (["abc", "xyz"], {}),
        (["n_last"], {"w_load": "n_last"}),
    ],
    ids=["alone", "two that nobody tells apart", "the load's by its name"],
)
def test_a_speed_that_is_alone_is_the_motors(columns: list[str], found: dict[str, str]) -> None:
    speeds = {n: Connector(n, "output", "rad/s") for n in ("w_motor", "w_load")}
    logged = [Channel(n, "rpm", np.zeros(0), np.zeros(0)) for n in columns]
    assert {g.connector: g.column.name for g in guess(logged, speeds)} == found


def test_a_scale_with_a_unit_on_a_column_without_one_says_what_to_write(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    drafted(tmp_path, cobot_joint, {"I": 1.5, "n_motor [rpm]": 1200.0})
    text = (tmp_path / "f/campaign.toml").read_text()
    channels = 'n_motor = "w_motor"\nI = { to = "v_command", scale = "1 V/A" }\n'
    (tmp_path / "f/campaign.toml").write_text(re.sub(r"(?s)\[channels\].*?\n\n", f"[channels]\n{channels}\n", text))
    with pytest.raises(UserError, match=r'the column has no unit: "I \[UNIT\]" gives it one'):
        load_campaign(tmp_path / "f/campaign.toml")
