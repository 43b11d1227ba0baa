"""Recordings are followed, each on its own account, and what cannot be followed is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.anchored.beside import Beside
from cobot_joint.diagnosis.anchored.search import Search
from cobot_joint.diagnosis.anchored.tracks import Tracker
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.state_estimation.sampled import SampledSystem
from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.anchored.test_search import searcher
from tests.orchestrator.diagnosis.state_estimation.rig import NOISE, SIGMA, bench, recorded, run


def driven(name: str, volts: float, seed: int) -> Recording:
    time = np.arange(0, 3.0001, 0.004)
    ramp = {"v_command": np.interp(time, [0.1, 0.4], [0, volts]), "i_brake": 0 * time}
    with SampledSystem(bench()[0], list(SIGMA)) as sampled:
        return replace(recorded(sampled.run(sampled.start({}), time, ramp), seed=seed), name=name, role="train")


def test_a_run_that_turns_a_thousand_times_is_followed_beside_one_that_stands() -> None:
    """It was called lost by what the first recording of its set-up reaches."""
    with Tracker(
        FmuPlant({"loaded": load_system("joint_logged")}), [driven("still", 0, 1), driven("spin", 24, 2)], NOISE
    ) as found:
        assert [tracking.tracked.recording.name for tracking in found.follow({})] == ["still", "spin"]


@pytest.mark.parametrize("refitted", [True, False], ids=["re-fitted values", "the first correction"])
def test_values_that_cannot_be_followed_do_not_end_a_search_that_has_begun(
    refitted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "motor_bldc.winding.R"
    with searcher(recorded(run({name: 0.209 * 1.06}, seconds=2.0))) as found:
        own, asked = found._follow, []

        def follow(search: Search) -> Beside:
            asked.append(dict(search.values))
            if len(asked) == 2:
                raise SimulationError("lost")
            return own(search)

        monkeypatch.setattr(found, "_follow", follow)
        begun, at = found._begun({name: 0.209 * 1.06} if refitted else {})
        settled = at if refitted else found._settle(begun, 1, at)
        assert begun.values == {}
        assert asked[1]
        assert settled is at
