"""Free runs that lose the machine: beyond the top a pendulum turns on, and what is fitted there says nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.quantity import is_position
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.plant import SPEEDS

Vector = NDArray[np.float64]

REACH = 0.05  # s, over which a position's speed is taken
LONG = 0.1  # of a recording, that the simulation is elsewhere in all


@dataclass(frozen=True)
class Lost:
    """A recording whose simulation moves on its own from a time on, s; by how much, and what all recordings span."""

    recording: str
    channel: str
    since: float
    off: float  # as a speed, of a position too
    span: float


def lost(recordings: Sequence[Recording], outputs: Sequence[Mapping[str, Vector]]) -> list[Lost]:
    """Recordings in which a simulated speed is off by more than all that was recorded of it, in a tenth of the time.

    outputs: of the simulation, per recording. Speeds, since a position adds up what friction is missing.
    """
    pairs = [
        (r, name, _speed(r, name, x), _speed(r, name, np.asarray(simulated[name])))
        for r, simulated in zip(recordings, outputs, strict=True)
        for name, x in r.outputs.items()
        if name in simulated and (r.units.get(name) in SPEEDS or is_position(r.units.get(name)))
    ]
    spans: dict[str, float] = {}
    for _, name, x, _ in pairs:
        known = x[np.isfinite(x)]
        spans[name] = max(spans.get(name, 0.0), float(np.ptp(known)) if len(known) else 0.0)
    found: dict[str, Lost] = {}
    for r, name, x, s in pairs:
        off = np.nan_to_num(np.abs(s - x))
        elsewhere = off > spans[name]
        if r.name not in found and spans[name] > 0 and elsewhere.mean() > LONG:
            found[r.name] = Lost(r.name, name, float(r.step * np.argmax(elsewhere)), float(off.max()), spans[name])
    return list(found.values())


def _speed(r: Recording, name: str, x: Vector) -> Vector:
    """(n,) of a speed, fewer of a position."""
    if not is_position(r.units.get(name)):
        return x
    reach = max(1, round(REACH / r.step))
    return (x[reach:] - x[:-reach]) / (reach * r.step)
