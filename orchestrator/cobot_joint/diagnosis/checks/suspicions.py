"""What a recording alone says against one of its channels, before anything is fitted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from cobot_joint.diagnosis.data.conditioning import noise_and_colour
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion, faults

Vector = NDArray[np.float64]

OUTLIER = 20.0  # times the rest's range
EXCITED = 3.0  # sigma of the noise that a moving channel exceeds
BLOCKS = 8  # of a run, for the scatter of its inertia
INERTIA, SURE = 0.15, 4.0  # relative difference between runs, and standard errors of it


def suspicions(recordings: Sequence[Recording]) -> list[Suspicion]:
    """Of every recording, and of the runs among each other. A commanded input may stand still and end at a limit."""
    found = [s for r in recordings for s in _of_recording(r)]
    return found + list(_inertias(recordings))


def _of_recording(r: Recording) -> Iterator[Suspicion]:
    yield from _duplicates(r)
    yield from (Suspicion(r.name, out.channel, out.kind, out.words) for out in r.left_out)
    yield from (Suspicion(r.name, n, "outlier", words) for n, x in r.inputs.items() if (words := outlier(x)))
    known = {name: x[np.isfinite(x)] for name, x in r.outputs.items() if np.isfinite(x).sum() > 1}
    yield from (Suspicion(r.name, n, "outlier", words) for n, x in known.items() if (words := outlier(x)))
    yield from (Suspicion(r.name, fault.channel, fault.kind, fault.words) for fault in faults(r))
    noises = {name: np.nan_to_num(noise_and_colour(r.outputs[name])[0]) for name in known}
    if not any(np.std(x) > EXCITED * noises[name] for name, x in known.items()):
        names = ", ".join(r.outputs)
        yield Suspicion(r.name, names, "not excited", "nothing moves beyond the noise: the run tells nothing")


def _duplicates(r: Recording) -> Iterator[Suspicion]:
    """Two outputs with the very same samples: one column was taken for both."""
    for a, b in combinations(r.outputs, 2):
        if np.ptp(np.nan_to_num(r.outputs[a])) > 0 and np.array_equal(r.outputs[a], r.outputs[b], equal_nan=True):
            wrong = not {a, b} <= r.believed
            words = (
                f"{r.columns.get(a, a)!r} and {r.columns.get(b, b)!r} have the same samples: one of them is the other's"
            )
            yield Suspicion(r.name, f"{a}, {b}", "duplicate", f"{words}; if both are right, scale = 1 for both", wrong)


def outlier(x: Vector) -> str:
    """A few samples far outside of what all others span."""
    low, high = np.quantile(x, [0.005, 0.995])
    reach = high - low
    if reach == 0:
        return ""
    far = np.maximum(x - high, low - x) > OUTLIER * reach
    if not far.any():
        return ""
    return f"{int(far.sum())} samples lie far outside, first {x[np.argmax(far)]:.4g} among {low:.4g} to {high:.4g}"


def _inertias(recordings: Sequence[Recording]) -> Iterator[Suspicion]:
    """Runs of one set-up whose torque (or current) per acceleration differs beyond their own scatter."""
    for setup in dict.fromkeys(r.setup for r in recordings):
        motions = [m for r in recordings if r.setup == setup and (m := _motion(r)) is not None]
        efforts = set.intersection(*(set(m.efforts) for m in motions)) if motions else set()
        if len(motions) < 2 or not efforts:
            continue
        # the effort that goes with the acceleration best: a motor's current, the torque at its shaft
        effort = max(sorted(efforts), key=lambda n: sum(_correlation(m.efforts[n], m.slope) for m in motions))
        known = [(m.name, *inertia(m, effort)) for m in motions]
        known = [(name, a, error) for name, a, error in known if a > SURE * error]
        if len(known) < 2:
            continue
        (low, a, sa), (high, b, sb) = min(known, key=lambda k: k[1]), max(known, key=lambda k: k[1])
        if b - a > INERTIA * (a + b) / 2 and b - a > SURE * float(np.hypot(sa, sb)):
            evidence = (
                f"{effort} per acceleration is {a:.3g} in {low} and {b:.3g} in {high} "
                f"(standard errors {sa:.1g} and {sb:.1g}): the inertia or the load differs by run"
            )
            yield Suspicion(f"{low}, {high}", effort, "inertia differs", evidence)


@dataclass(frozen=True)
class _Motion:
    """One run's speed, smoothed, its slope, and torques or currents beside it: (n,) where all are known."""

    name: str
    speed: Vector
    slope: Vector
    efforts: dict[str, Vector]


def _motion(r: Recording) -> _Motion | None:
    """None: no speed, no effort, or too short."""
    series = r.inputs | r.outputs
    speeds = [n for n in r.outputs if r.units.get(n) == "rad/s"]
    window = 2 * max(2, round(0.005 / r.step)) + 1
    if not speeds or len(r.time) < 50 * BLOCKS:
        return None
    known = np.all([np.isfinite(x) for x in series.values()], axis=0)
    w = np.where(known, series[speeds[0]], 0.0)
    speed, slope = (savgol_filter(w, window, 2, deriv=k, delta=r.step)[known] for k in (0, 1))
    efforts = {n: x[known] for n, x in series.items() if r.units.get(n) in ("N.m", "A") and np.ptp(x[known]) > 0}
    return _Motion(r.name, speed, slope, efforts) if efforts and np.any(slope) else None


def inertia(m: _Motion, effort: str) -> tuple[float, float]:
    """Effort per acceleration and its standard error: effort = a dw/dt + b w + c sgn(w) + d + other efforts.

    Least squares; the error is a jackknife over blocks, which holds for correlated residuals.
    """
    top = np.quantile(np.abs(m.speed), 0.99)
    others = [x for n, x in m.efforts.items() if n != effort]
    columns = [m.slope, m.speed, np.tanh(m.speed / (0.01 * top or 1.0)), np.ones_like(m.speed), *others]
    design = np.column_stack([c / np.sqrt(np.mean(c**2)) for c in columns if np.any(c)])
    y, pieces = m.efforts[effort], np.array_split(np.arange(len(m.speed)), BLOCKS)
    kept = [np.concatenate([p for j, p in enumerate(pieces) if j != k]) for k in range(BLOCKS)]
    left_out = [np.linalg.lstsq(design[keep], y[keep], rcond=None)[0][0] for keep in kept]
    scale = np.sqrt(np.mean(m.slope**2))
    return float(np.mean(left_out) / scale), float(np.sqrt((BLOCKS - 1) * np.var(left_out)) / scale)


def _correlation(a: Vector, b: Vector) -> float:
    a, b = a - a.mean(), b - b.mean()
    return float(abs(a @ b) / np.sqrt((a @ a) * (b @ b))) if np.any(a) and np.any(b) else 0.0
