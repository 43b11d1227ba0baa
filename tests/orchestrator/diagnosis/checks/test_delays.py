"""How late a channel comes is told from runs that can tell it, and only where these agree."""

from __future__ import annotations

import numpy as np
import pytest

from cobot_joint.diagnosis.checks.beside_nominal import beside_nominal
from cobot_joint.diagnosis.checks.delays import Delay, agreed
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion

STEP = 2e-3
T = STEP * np.arange(5000)


def turning(name: str, speed: float, late: float) -> Recording:
    """A shaft whose speed is stamped late, s, logged with noise, and its angle in an encoder's steps."""
    rng = np.random.default_rng(2)
    fine = np.linspace(-1, T[-1], 200_000)
    w = speed * (np.sin(2 * np.pi * 0.4 * fine) + 0.6 * np.sin(2 * np.pi * 1.3 * fine))
    phi = np.concatenate([[0.0], np.cumsum((w[1:] + w[:-1]) / 2 * np.diff(fine))])
    outputs = {
        "phi": 1e-4 * np.round(np.interp(T, fine, phi) / 1e-4),
        "w": np.interp(T - late, fine, w) + rng.normal(0, 0.02, len(T)),
    }
    return Recording(name, "train", "default", T, {}, outputs, {"w": "rad/s", "phi": "rad"})


def beside_wrong_friction(r: Recording) -> dict[str, np.ndarray]:
    """A nominal system that drifts from what is recorded."""
    w = np.interp(T, T, r.outputs["w"]) + 0.5 * np.sin(0.9 * T)
    return {"w": w, "phi": STEP * np.concatenate([[0.0], np.cumsum((w[1:] + w[:-1]) / 2)])}


def said(late: float) -> list[Suspicion]:
    runs = [turning("quick", 6.0, late), turning("slow", 0.1, late), turning("other", 4.0, late)]
    return [s for s in beside_nominal(runs, beside_wrong_friction) if s.kind == "late"]


@pytest.mark.parametrize(("late", "when"), [(5e-3, "after"), (-5e-3, "before")])
def test_a_speed_that_is_late_beside_its_own_angle_is_said_whatever_the_nominal_system_does(
    late: float, when: str
) -> None:
    (found,) = said(late)
    assert found.channel == "w"
    assert f"it comes 5 ms {when} phi, whose slope it is" in found.evidence


def test_a_speed_that_keeps_time_with_its_angle_is_not_late() -> None:
    assert said(0.0) == []


def test_a_run_that_cannot_tell_a_delay_does_not_deny_it_and_one_that_contradicts_does() -> None:
    quick = [Delay(5.0e-3, 1e-4), Delay(4.8e-3, 5e-5)]
    assert agreed([*quick, Delay(-1e-3, 4e-3)], STEP) == pytest.approx(4.84e-3, rel=1e-2)
    assert agreed([*quick, Delay(0.0, 1e-4)], STEP) is None
    assert agreed([quick[0], Delay(0.0, 4e-3)], STEP) is None
    assert agreed([Delay(1e-3, 1e-5)] * 2, STEP) is None  # half a sample


def test_a_delay_that_is_little_of_what_is_left_is_none() -> None:
    assert agreed([Delay(5e-3, 1e-4, without=1.0, left=0.7)] * 2, STEP) is None
