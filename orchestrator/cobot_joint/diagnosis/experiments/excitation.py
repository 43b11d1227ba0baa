"""Experiments that could be done next: excitations of the inputs that the recorded runs had, inside their range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.problem import Vector

DURATION = 6.0  # s
DWELL = 0.5  # s at rest, with which every run begins


@dataclass(frozen=True)
class Excitation:
    """Shares of what drives and of what loads, of the largest value recorded: (n,) each over DURATION."""

    words: str
    drive: Vector
    load: Vector


def experiments(recordings: Sequence[Recording]) -> list[Recording]:
    """Every excitation in every set-up of the recordings, named in words; outputs are zero.

    What drives is the input that all runs have; the others load, and where a set-up has none, only one excitation of
    those that differ in load is left.
    """
    largest: dict[str, float] = {}
    for r in recordings:
        for name, values in r.inputs.items():
            largest[name] = max(largest.get(name, 0.0), float(np.max(np.abs(values))))
    common = [name for name in largest if all(name in r.inputs for r in recordings)]
    found, setups = [], {r.setup: r for r in recordings}
    for setup, r in setups.items():
        time = np.linspace(0.0, DURATION, round(DURATION / r.step) + 1, dtype=np.float64)
        loads = [name for name in r.inputs if name not in common[:1]]
        for e in excitations(time, loaded=bool(loads)):
            inputs = {n: largest[n] * (e.drive if n in common[:1] else e.load) for n in r.inputs}
            name = e.words + (f" in set-up {setup}" if len(setups) > 1 else "")
            outputs = {channel: np.zeros(len(time)) for channel in r.outputs}
            found.append(Recording(name, "train", setup, time, inputs, outputs, dict(r.units), dict(r.initial)))
    return found


def excitations(time: Vector, loaded: bool) -> list[Excitation]:
    """Shares over time, (n,)"""
    on = (time >= DWELL).astype(float)
    since = np.maximum(time - DWELL, 0.0) / (time[-1] - DWELL)  # 0 to 1
    none = np.zeros_like(time)
    triangle = on * np.interp(np.mod(2 * since, 1), [0, 0.25, 0.75, 1], [0, 1, -1, 0])
    levels = np.array([0.2, 0.5, 0.8, 1.0, -0.2, -0.5, -0.8, -1.0])
    stairs = on * levels[np.minimum((since * len(levels)).astype(int), len(levels) - 1)]
    steps = np.array([0.0, 0.25, 0.5, 0.75])
    load_stairs = on * steps[np.minimum((np.mod(2 * since, 1) * len(steps)).astype(int), len(steps) - 1)]
    two = on * np.where(since < 0.5, 0.4, 0.9)
    found = [
        Excitation("a slow sweep through zero", 0.15 * triangle, none),
        Excitation("a speed staircase in both directions", stairs, none),
        Excitation("micro-reversals", 0.1 * on * np.sin(2 * np.pi * 2 * time), none),
        Excitation("a long hold at top speed", on, none),
        Excitation("a dwell at rest", none, none),
    ]
    if loaded:
        found += [
            Excitation("a load staircase at two speeds", two, load_stairs),
            Excitation("a speed staircase in both directions under half load", stairs, 0.5 * on),
            Excitation("micro-reversals under load", 0.2 * on * np.sin(2 * np.pi * 2 * time), 0.2 * on),
        ]
    return found
