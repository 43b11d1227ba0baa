"""What is followed, and where a free run does as well."""

from __future__ import annotations

from pathlib import Path

import pytest

from cobot_joint.diagnosis.anchored.follow import can_follow, motion_is_given
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant


@pytest.mark.parametrize("unit", ["V", "rad/s", "rad", "m"])
def test_a_motion_that_drives_the_system_is_given(root: Path, unit: str) -> None:
    campaign = load_campaign(root / "proof/open/case01", roles=("train",))
    campaign.recordings[0].units["v_command"] = unit
    with FmuPlant(campaign.systems()) as plant:
        assert can_follow(campaign, plant)
        assert motion_is_given(campaign) == (unit != "V")
