"""What is not followed."""

from __future__ import annotations

from pathlib import Path

import pytest

from cobot_joint.diagnosis.anchored.follow import can_follow
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant


@pytest.mark.parametrize("unit", ["V", "rad/s", "rad", "m"])
def test_a_voltage_is_followed_and_a_motion_that_is_given_is_not(root: Path, unit: str) -> None:
    campaign = load_campaign(root / "proof/open/case01", roles=("train",))
    campaign.recordings[0].units["v_command"] = unit
    with FmuPlant(campaign.systems()) as plant:
        assert can_follow(campaign, plant) == (unit == "V")
