"""What acts along a motion is looked for along the recorded one, which a free run loses."""

from __future__ import annotations

import numpy as np
import pytest

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem, Run
from cobot_joint.diagnosis.estimation.recorded_motion import along_recording, at_recorded_angle
from tests.orchestrator.diagnosis.axis import NOISE, STEP, Axis, campaign
from tests.orchestrator.diagnosis.axis import OFF as OFF_NOMINAL

TIME = np.arange(0, 8, 1e-3)
SPEED = 100 * np.sin(TIME)  # as simulated
OFF = 3 + 2 * np.cos(0.7 * TIME)  # by which the recorded speed is off
TRAVEL, AWAY = 100 * (1 - np.cos(TIME)), 3 * TIME + 2 / 0.7 * np.sin(0.7 * TIME)  # their integrals
SIMULATED = {"w": SPEED, "a.phi": 1.0 + TRAVEL, "a.w": SPEED, "b.phi": TRAVEL / 113, "b.w": SPEED / 113, "b.tau": OFF}


def recorded(w: np.ndarray) -> Recording:
    return Recording("run", "train", "", TIME, {}, {"w": w}, {"w": "rad/s"})


def test_angles_and_speeds_go_where_the_recorded_speed_says() -> None:
    noise = np.random.default_rng(1).normal(0, 0.3, len(TIME))
    moved = along_recording(recorded(SPEED + OFF + noise), SIMULATED, ["a.phi", "a.w", "b.phi", "b.w"])
    assert moved["a.phi"] == pytest.approx(1.0 + TRAVEL + AWAY, abs=0.1)
    assert moved["b.phi"] == pytest.approx((TRAVEL + AWAY) / 113, abs=0.1 / 113)
    inner = slice(100, -100)
    assert moved["a.w"][inner] == pytest.approx((SPEED + OFF)[inner], abs=0.3)
    assert moved["b.w"][inner] == pytest.approx((SPEED + OFF)[inner] / 113, abs=0.3 / 113)


def test_what_no_channel_goes_along_with_stays() -> None:
    own = SIMULATED | {"b.phi": np.sin(5 * TIME)}
    moved = along_recording(recorded(SPEED + OFF), own, ["b.phi", "b.tau"])
    assert moved["b.phi"] is own["b.phi"]
    assert moved["b.tau"] is own["b.tau"]


def test_a_gap_in_the_recording_counts_as_right() -> None:
    w = np.where((TIME > 2) & (TIME < 3), np.nan, SPEED)
    moved = along_recording(recorded(w), SIMULATED, ["a.phi"])
    assert moved["a.phi"] == pytest.approx(SIMULATED["a.phi"])


def test_a_wave_acts_at_the_recorded_angle_whatever_a_run_s_own_is() -> None:
    case, plant = campaign(OFF_NOMINAL), Axis()
    problem = Problem(plant, case.train, {"w": Noise(NOISE)})
    term = next(t for t in plant.terms if t.phase)
    values = {term.amplitude: 0.01, "axis.cogging.n": 5.0, "axis.cogging.phi_0": 0.4}
    true = [plant.simulate(OFF_NOMINAL, r)["axis.phi"] for r in case.train]
    wave = at_recorded_angle(problem, Run(), ActiveTerm(term, values))
    courses = wave.apply(Run(), wave.start()).courses
    for recording, phi in zip(case.train, true, strict=True):
        for t, phase in courses[recording.name]["axis.cogging.phi_0"]:
            at = round(t / STEP)
            for own in (0.0, 17.0):
                assert np.sin(5 * own + phase.of(own)) == pytest.approx(np.sin(5 * phi[at] + 0.4), abs=0.2)


def test_a_term_that_goes_by_no_angle_stays_as_it_is() -> None:
    case, plant = campaign(OFF_NOMINAL), Axis()
    windage = ActiveTerm(next(t for t in plant.terms if not t.phase), {"axis.windage.c": 1e-4})
    assert at_recorded_angle(Problem(plant, case.train, {"w": Noise(NOISE)}), Run(), windage) is windage
