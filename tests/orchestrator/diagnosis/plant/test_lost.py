"""A free run that goes its own way is said to, and one that is merely off is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.drafts.chain import CURRENT_MODE, chain
from cobot_joint.diagnosis.plant.lost import lost
from cobot_joint.diagnosis.plant.simulator import Simulator

T = 2e-3 * np.arange(2001)
LIFT = 36.0  # A, which by 0.0232 N.m/A hold a pendulum of 1 kg at 0.1 m 58 degrees from where it hangs
SYSTEM = chain(["motor", "pendulum"]).system


def run(mass: float, outputs: tuple[str, ...] = ("w_motor",)) -> Recording:
    """A pendulum that a current lifts over a second, as recorded."""
    empty = {name: np.zeros(len(T)) for name in outputs}
    current = LIFT * np.minimum(T, 1.0)
    units = {"w_motor": "rad/s", "phi_load": "rad"}
    there = Recording("run", "train", "setup", T, {"v_command": current}, empty, {n: units[n] for n in outputs})
    return replace(there, outputs={n: x for n, x in simulated(there, mass).items() if n in empty})


def simulated(r: Recording, mass: float) -> dict[str, np.ndarray]:
    values = {"motor.drive.mode": CURRENT_MODE, "motor.drive.decoupling": 1.0, "pendulum.body.m": mass}
    with Simulator({"setup": SYSTEM}, values) as simulate:
        return dict(simulate(r))


@pytest.mark.parametrize("channel", ["w_motor", "phi_load"])
def test_a_pendulum_that_is_lifted_over_the_top_is_lost(channel: str) -> None:
    r = run(1.0, (channel,))
    (found,) = lost([r], [simulated(r, 0.7)])
    assert (found.recording, found.channel) == ("run", channel)
    assert 0.5 < found.since < 2.0
    assert found.off > found.span


def test_a_pendulum_that_swings_a_tenth_further_is_not() -> None:
    r = run(1.0)
    assert lost([r], [simulated(r, 0.95)]) == []


def test_what_any_run_goes_through_is_not_elsewhere() -> None:
    r = run(1.0)
    quick = replace(r, name="quick", outputs={"w_motor": 500 * np.sin(T)})
    assert lost([r, quick], [simulated(r, 0.7), quick.outputs]) == []
