"""What every machine has besides its model, and what is worth no name: smooth functions of speed and of load.

Friction that waves over speed, a sensor that bends over torque: at each latent force's port, functions of the unit's
own speed and of its own load, the same in all recordings. How large each is, the regression estimates; changes over
time, quick and slow, are the latent forces themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.plant.plant import SPEEDS, Port
from cobot_joint.diagnosis.state_estimation.evidence import Tracking

Array = NDArray[np.float64]
Of = Callable[[int], tuple[Array, Array]]  # an effect's psi and direct in the tracking of that number
OVER_SPEED, OVER_LOAD = 10, 6  # bells side by side
STANDS = 1e-9  # range of a signal that does not change


@dataclass(frozen=True)
class Group:
    """Functions of one signal at one port. signals: what they are there, of all recordings that have it, one after the
    other: (samples, functions)."""

    port: str
    variable: str
    signals: Array

    @property
    def count(self) -> int:
        """Of its functions."""
        return self.signals.shape[1]


def background(trackings: Sequence[Tracking], ports: Sequence[Port]) -> Iterator[tuple[Group, Of]]:
    """Along the recorded motion, group by group, and a unit of each function in each tracking. ports: of the plant."""
    there = {name for t in trackings for name in t.estimator.ports}
    for port in (p for p in ports if p.name in there):
        for name, count in _variables(trackings, port):
            series = [_signal(t, port, name) for t in trackings]
            low = float(min(x.min() for x in series if x is not None))
            high = float(max(x.max() for x in series if x is not None))
            if high - low < STANDS:
                continue
            bells = [None if x is None else _bells(x, low, high, count) for x in series]
            signals = np.concatenate([b for b in bells if b is not None])
            yield Group(port.name, name, signals), partial(_at_port, trackings, port.name, bells, count)


def _variables(trackings: Sequence[Tracking], port: Port) -> list[tuple[str, int]]:
    """The first of the unit's own speeds and of its loads that was simulated."""
    t = next(t for t in trackings if port.name in t.estimator.ports)
    unit = t.estimator.sampled.system.component(port.component).unit
    speeds = [s for s in port.signals if unit.unit_of(s.split(".", 1)[1]) in SPEEDS]
    found = []
    for names, count in ((speeds, OVER_SPEED), (port.loads, OVER_LOAD)):
        name = next((n for n in names if t.estimator.sampled.own_signal(n, t.tracked.signals) is not None), None)
        if name is not None:
            found.append((name, count))
    return found


def _signal(t: Tracking, port: Port, name: str) -> Array | None:
    """None: the recording has no such port."""
    return t.estimator.sampled.own_signal(name, t.tracked.signals) if port.name in t.estimator.ports else None


def _bells(x: Array, low: float, high: float, count: int) -> Array:
    """Gaussian bells side by side, as wide as they are apart: (n, count)"""
    middles = np.linspace(low, high, count)
    return np.asarray(np.exp(-0.5 * ((x[:, None] - middles) / (middles[1] - middles[0])) ** 2))


def _at_port(
    trackings: Sequence[Tracking], port: str, bells: Sequence[Array | None], count: int, number: int
) -> tuple[Array, Array]:
    """(n - 1, states, count), (n, channels, count): in the tracking of that number, of signals (n, count) that enter at
    a latent's port; None: there is no such port."""
    t, signals = trackings[number], bells[number]
    if signals is None:
        shape = (*t.tracked.steps.r.shape, count)
        return np.zeros((shape[0] - 1, t.estimator.x.stop, count)), np.zeros(shape)
    column = t.estimator.ports.index(port)
    gamma = t.tracked.tangent.Gamma[:, :, column]
    read = t.tracked.steps.H[:, :, t.estimator.d.start + column]
    between = 0.5 * (signals[1:] + signals[:-1])
    return gamma[:, :, None] * between[:, None, :], read[:, :, None] * signals[:, None, :]
