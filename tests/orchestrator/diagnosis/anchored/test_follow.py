"""What is followed, and where a free run does as well."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cobot_joint.diagnosis.anchored.follow import _searcher, can_follow, healthy, motion_is_given
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.campaign_file import Tolerance
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import Parameter


@pytest.mark.parametrize("unit", ["V", "rad/s", "rad", "m"])
def test_a_motion_that_drives_the_system_is_given(root: Path, unit: str) -> None:
    campaign = load_campaign(root / "proof/open/case01", roles=("train",))
    campaign.recordings[0].units["v_command"] = unit
    with FmuPlant(campaign.systems()) as plant:
        assert can_follow(campaign, plant)
        assert motion_is_given(campaign) == (unit != "V")


def test_what_is_held_out_is_not_looked_at(root: Path) -> None:
    """Its noise was: field/open case01 was answered otherwise with and without its held-out run"""
    campaign = load_campaign(root / "proof/sealed/case01", roles=("train",))
    held_out = replace(campaign.train[0], role="holdout")
    held_out.outputs = {name: y + np.random.default_rng(0).normal(size=len(y)) for name, y in held_out.outputs.items()}
    with FmuPlant(campaign.systems()) as plant:
        noises = []
        for recordings in (campaign.train, [*campaign.train, held_out]):
            case = replace(campaign, recordings=recordings)
            with _searcher(case, plant, [], lambda words: None, ()) as searcher:
                noises.append(searcher.tracker.noise)
    assert noises[0] == noises[1]


def test_a_tolerance_ends_where_the_unit_does() -> None:
    """A gear's efficiency of 1 within 6 % was followed with 1.013, which its unit refuses: no answer after 220 s."""
    parameters = {"gear.mesh.eta": Parameter("gear.mesh.eta", 1.0, "1", 0.01, 1.0)}
    plant: Any = SimpleNamespace(parameters=parameters)
    campaign: Any = SimpleNamespace(tolerances={"gear.mesh.eta": Tolerance(relative=0.06)})
    assert healthy(campaign, plant) == {"gear.mesh.eta": (0.94, 1.0)}
