"""A system beside a recording."""

from __future__ import annotations

import numpy as np
import pytest

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.system.read import load_system

LATE = {"motor_bldc.cogging.A": 3e-3, "motor_bldc.viscous_warmup.fade": 0.5}
ONSETS = {"motor_bldc.cogging.A": 0.4}


def spun(begin: float) -> dict[str, np.ndarray]:
    """1 s without load, by a clock that starts at `begin`."""
    t = begin + 1e-3 * np.arange(1001)
    inputs = {"v_command": np.interp(t - begin, [0.0, 0.3], [0.0, 6.0])}
    outputs = {"i_motor": np.zeros(len(t)), "w_motor": np.zeros(len(t))}
    recording = Recording("spun", "train", "no_load", t, inputs, outputs, {})
    with Simulator({"no_load": load_system("joint_no_load_logged")}, LATE, ONSETS) as simulate:
        return dict(simulate(recording))


def test_a_run_is_the_same_whatever_its_clock_begins_with() -> None:
    here, there = spun(0.0), spun(1000.0)
    for name in here:
        assert there[name] == pytest.approx(here[name], abs=1e-5), name
