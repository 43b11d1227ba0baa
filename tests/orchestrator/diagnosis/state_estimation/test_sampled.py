"""Runs from given states keep to what units let a state start at."""

from __future__ import annotations

import numpy as np

from cobot_joint.diagnosis.state_estimation.linearisation import Lineariser
from cobot_joint.diagnosis.state_estimation.sampled import SampledSystem
from tests.orchestrator.diagnosis.state_estimation.rig import SIGMA, bench, clock, inputs


def test_a_state_that_an_integrator_takes_past_its_bound_can_be_linearised_at() -> None:
    """The drive's heat count: used up within a step, it ends a little below 0, where the unit refuses to start."""
    time = clock(2.0)
    limits = {"motor_bldc.drive.i_cont": 1.5, "motor_bldc.drive.i_peak": 3.0}
    volts = np.interp(time, [0.1, 0.2, 0.6, 0.65], [0, 20, 20, 0])
    with SampledSystem(bench()[0], list(SIGMA), limits) as sampled:
        piece = sampled.run(sampled.start({}), time, {**inputs(time), "v_command": volts})
        heat = [s.name for s in sampled.states].index("motor_bldc.q_t")
        assert piece.signals["motor_bldc.q_t"].min() < 0
        assert piece.x[:, heat].min() == 0
        assert np.isfinite(Lineariser(sampled, [])(piece).A).all()
