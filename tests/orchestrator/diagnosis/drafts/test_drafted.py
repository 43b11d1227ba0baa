"""What `new` writes and says for machines whose data sheet does not say everything."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.typed import Done


@pytest.mark.parametrize(("spring", "rings"), [([], True), (["sensor.c_s=4935", "sensor.d_s=22"], False)])
def test_a_load_that_would_ring_behind_recorded_motion_is_said_with_what_to_set(
    tmp_path: Path, cobot_joint: Callable[..., Done], spring: list[str], rings: bool
) -> None:
    settings = [word for value in ["load.J=0.05", *spring] for word in ("--set", value)]
    done = cobot_joint("new", "--chain", "motion,sensor,load", "--out", "axis", *settings)
    assert done.returncode == 0
    said = "the load rings at 22 Hz, damped by 1.4 %"
    assert (
        (said in done.stdout) == ("--set sensor.c_s=4935 --set sensor.d_s=22" in " ".join(done.stdout.split())) == rings
    )


def test_friction_that_is_zero_in_the_system_stands_in_a_draft_to_be_given_a_range(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    assert cobot_joint("new", "--chain", "load", "--out", "axis").returncode == 0
    lines = (tmp_path / "axis/campaign.toml").read_text().splitlines()
    (line,) = (line for line in lines if "load.friction.tau_C" in line)
    assert line.startswith('# "load.friction.tau_C" = [0.0, MOST]   # it is 0 in the system')
    assert '"load.body.J" = "10 %"' in lines


def test_the_supply_stands_in_the_system_of_a_motor(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    """A motor at 48 V was limited to the bench's 24 V without a word."""
    assert cobot_joint("new", "--chain", "motor", "--set", "motor.v_bus=48", "--out", "motor").returncode == 0
    assert "inverter.v_bus" in (tmp_path / "motor/system.ssd").read_text()
    assert load_system(str(tmp_path / "motor/system.ssd")).component("motor").parameters["inverter.v_bus"] == 48.0
