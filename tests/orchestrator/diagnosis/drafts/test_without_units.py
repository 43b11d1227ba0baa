"""Logs of robots and drives that give no unit: what their columns are is in their names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import quantity
from cobot_joint.diagnosis.drafts.without_units import with_assumed_units
from tests.orchestrator.diagnosis.typed import Done

T = 0.01 * np.arange(1000)
W, AMPERES = 3 * np.sin(T), 2 * np.cos(T)
SAID = "no unit is given, [{}] is taken: write another between the brackets"


@pytest.mark.parametrize(
    ("name", "is_one"),
    [
        ("present_velocity", "w"),
        ("actual_qd_0", "w"),
        ("dq[3]", "w"),
        ("axis0.encoder.pos_estimate", "phi"),
        ("target_q_0", "phi"),
        ("q_current", "i"),
        ("axis0.motor.current_control.Iq_measured", "i"),
        ("motorTorque", "tau"),
        ("input_voltage", "v"),
        ("n", "w"),
        ("temp_m_os", ""),
        ("tachometer", ""),
    ],
)
def test_a_name_says_what_a_column_is(name: str, is_one: str) -> None:
    assert quantity(name) == is_one


def drafted(folder: Path, cobot_joint: Callable[..., Done], columns: dict[str, np.ndarray]) -> tuple[list[str], str]:
    """Lines of the draft's [channels] over a motor in current mode with a load; what was printed."""
    mode = ["--set", "motor.drive.mode=current"]
    assert cobot_joint("new", "--chain", "motor,load", *mode, "--out", "m").returncode == 0
    rows = np.column_stack([T, *columns.values()])
    np.savetxt(folder / "log.csv", rows, fmt="%.6g", delimiter=",", header=",".join(["time", *columns]), comments="")
    done = cobot_joint("inspect", "log.csv", "--system", "m/system.ssd", "--out", "first")
    assert done.returncode == 0, done.stderr
    text = (folder / "first/campaign.toml").read_text()
    return text.split("[channels]")[1].split("[tolerances]")[0].splitlines(), " ".join(done.stdout.split())


def test_a_drive_s_log_without_units_is_drafted_in_si_units_and_says_so(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    """It was refused: no column looked like an output."""
    columns = {"position": 1 - np.cos(T), "velocity": W, "q_current": AMPERES, "voltage": 24 + 0.1 * W}
    lines, _ = drafted(tmp_path, cobot_joint, columns)
    (speed,) = (line for line in lines if line.startswith('"velocity [rad/s]" = "w_motor"'))
    assert speed.endswith(SAID.format("rad/s"))
    (current,) = (line for line in lines if line.startswith('"q_current [A]" = { to = "v_command", scale = "1 V/A" }'))
    assert current.endswith(SAID.format("A"))
    assert any(line.startswith('# "position [rad]" = ') for line in lines)
    assert any(line.startswith('# "voltage" = ') for line in lines)  # the supply's


def test_of_several_joints_none_is_taken_and_all_are_offered(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    """A set angle had become a voltage by its name, and without that the log was refused, and nothing written."""
    columns = {
        f"{name}_{k}": x + k
        for name, x in (("actual_qd", W), ("actual_current", AMPERES), ("target_q", W))
        for k in (0, 1)
    }
    lines, printed = drafted(tmp_path, cobot_joint, columns)
    assert not any(line.startswith('"') for line in lines)
    assert (
        sum(
            "w_motor" in line
            for line in lines
            if line.startswith(('# "actual_qd_0 [rad/s]"', '# "actual_qd_1 [rad/s]"'))
        )
        == 2
    )
    assert (
        "log.csv: no column looks like an output of the system (i_motor, w_motor, w_load): fill in [channels]"
        in printed
    )


def test_beside_a_column_with_a_unit_none_is_assumed_for_the_same_quantity(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    lines, _ = drafted(tmp_path, cobot_joint, {"n_mot [rpm]": 10 * W, "velocity": W, "iq [A]": AMPERES})
    assert any(line.startswith('"n_mot [rpm]" = "w_motor"') for line in lines)
    assert not any('[rad/s]" =' in line for line in lines)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("/odom/twist/twist/linear/x", "m/s"),
        ("odom.pose.pose.position.y", "m"),
        ("/imu/angular_velocity/z", "rad/s"),
        ("/ft/wrench/torque/z", "N.m"),
        ("/imu/linear_acceleration/x", None),
        ("linear", None),
    ],
)
def test_a_field_of_a_ros_message_has_its_si_unit(name: str, unit: str | None) -> None:
    """A cart's way was offered as an angle, and its speed as nothing (REP 103)."""
    carriage = {"s": Connector("s", "output", "m")}
    (column,) = with_assumed_units([Channel(name, None, T, W)], carriage, alone=True)
    assert column.unit == unit
    (resting,) = with_assumed_units([Channel(name, None, T, 5 + 0.01 * W)], carriage, alone=True)
    assert resting.unit is None
