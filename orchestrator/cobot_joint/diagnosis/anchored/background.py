"""What every machine has besides its model, and what is worth no name: smooth functions of speed and of load.

Friction that waves over speed, a sensor that bends over torque: at each latent force's port, functions of the unit's
own speed and of its own load, the same in all recordings. How large each is, the regression estimates; changes over
time, quick and slow, are the latent forces themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.plant.plant import Port
from cobot_joint.diagnosis.state_estimation.evidence import Effect, Tracking

Array = NDArray[np.float64]
OVER_SPEED, OVER_LOAD = 10, 6  # bells side by side
SPEEDS = ("rad/s", "m/s")
STANDS = 1e-9  # range of a signal that does not change


@dataclass(frozen=True)
class Background:
    """Columns of all its groups, one after the other.

    groups: (port, signal, number of columns). signals: of each group, what its columns are at the port, of all
    recordings that have it, (samples, columns).
    """

    effect: Effect
    groups: tuple[tuple[str, str, int], ...]
    signals: tuple[Array, ...]


def background(trackings: Sequence[Tracking], ports: Sequence[Port]) -> Background:
    """Along the recorded motion. ports: of the plant."""
    there = {name for t in trackings for name in t.estimator.ports}
    groups: list[tuple[str, str, int]] = []
    signals: list[Array] = []
    psi: list[list[Array]] = [[] for _ in trackings]
    direct: list[list[Array]] = [[] for _ in trackings]
    for port in (p for p in ports if p.name in there):
        for name, count in _variables(trackings, port):
            series = [_signal(t, port, name) for t in trackings]
            low = min(x.min() for x in series if x is not None)
            high = max(x.max() for x in series if x is not None)
            if high - low < STANDS:
                continue
            groups.append((port.name, name, count))
            there_is = [x for x in series if x is not None]
            signals.append(np.concatenate([_bells(x, float(low), float(high), count) for x in there_is]))
            for n, (t, x) in enumerate(zip(trackings, series, strict=True)):
                samples = len(t.tracked.time)
                bells = np.zeros((samples, count)) if x is None else _bells(x, float(low), float(high), count)
                one, other = _at_port(t, port.name, bells)
                psi[n].append(one)
                direct[n].append(other)
    inner = [_side_by_side(p, len(t.tracked.y) - 1, t.estimator.x.stop) for p, t in zip(psi, trackings, strict=True)]
    outer = [_side_by_side(p, *t.tracked.y.shape) for p, t in zip(direct, trackings, strict=True)]
    return Background(Effect(inner, outer), tuple(groups), tuple(signals))


def _side_by_side(parts: Sequence[Array], rows: int, across: int) -> Array:
    """(rows, across, all columns)"""
    return np.concatenate(parts, axis=2) if parts else np.zeros((rows, across, 0))


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


def _at_port(t: Tracking, port: str, signals: Array) -> tuple[Array, Array]:
    """(n - 1, states, k), (n, channels, k): of signals (n, k) that enter at a latent's port."""
    if port not in t.estimator.ports:
        shape = (*t.tracked.y.shape, signals.shape[1])
        return np.zeros((shape[0] - 1, t.estimator.x.stop, shape[2])), np.zeros(shape)
    column = t.estimator.ports.index(port)
    gamma = np.concatenate([tangent.Gamma[:, :, column] for tangent in t.tracked.tangents])
    read = t.tracked.steps.H[:, :, t.estimator.d.start + column]
    between = 0.5 * (signals[1:] + signals[:-1])
    return gamma[:, :, None] * between[:, None, :], read[:, :, None] * signals[:, None, :]
