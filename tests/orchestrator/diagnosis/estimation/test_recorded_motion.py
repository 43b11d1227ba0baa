"""What acts along a motion is looked for along the recorded one, which a free run loses."""

from __future__ import annotations

import numpy as np
import pytest

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.recorded_motion import along_recording

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
