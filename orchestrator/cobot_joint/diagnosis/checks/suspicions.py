"""What a recording alone says against one of its channels, before anything is fitted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion
from scipy.signal import savgol_coeffs, savgol_filter

from cobot_joint.diagnosis.data.conditioning import noise_and_colour
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion, faults

Vector = NDArray[np.float64]

OUTLIER = 20.0  # times the rest's range
EXCITED = 3.0  # sigma of the noise that a moving channel exceeds
BLOCKS = 8  # of a run, for the scatter of its inertia
INERTIA, SURE = 0.15, 4.0  # relative difference between runs, and standard errors of it
SMOOTH = 0.02  # s on either side: a slope's noise makes an inertia too small, by half in slow runs with 5 ms
CREEP = 0.03  # of the top speed, below which friction may have any value


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
        known = [(m.name, found) for m in motions if (found := inertia(m, effort)) is not None and found.is_known]
        pairs = [(a, b) for a, b in permutations(known, 2) if a[1].is_less_than(b[1])]
        if pairs:
            (low, a), (high, b) = max(pairs, key=lambda pair: pair[1][1].value - pair[0][1].value)
            evidence = (
                f"{effort} per acceleration is {a.value:.3g} in {low} and {b.value:.3g} in {high} "
                f"(uncertain by {a.reach:.1g} and {b.reach:.1g}): the inertia or the load differs by run"
            )
            yield Suspicion(f"{low}, {high}", effort, "inertia differs", evidence)


@dataclass(frozen=True)
class _Motion:
    """One run's speed, its slope, and torques or currents beside it, all smoothed alike: (n,) where all are known.

    Without what nearly stands still. slope_noise: 1 sigma.
    """

    name: str
    speed: Vector
    slope: Vector
    efforts: dict[str, Vector]
    slope_noise: float


@dataclass(frozen=True)
class Inertia:
    """Effort per acceleration of one run, its standard error, and by how much it may be off for what is not modelled:
    what friction and a background leave, all of it going along with the acceleration, and the slope's noise."""

    value: float
    error: float
    bias: float

    @property
    def reach(self) -> float:
        """By how much it is uncertain."""
        return SURE * self.error + self.bias

    @property
    def is_known(self) -> bool:
        """Whether the run's acceleration shows it: a slow one shows friction."""
        return self.value > self.reach

    def is_less_than(self, other: Inertia) -> bool:
        """Beyond what both are uncertain."""
        apart = other.value - self.value
        unsure = SURE * float(np.hypot(self.error, other.error)) + self.bias + other.bias
        return apart > max(INERTIA * (self.value + other.value) / 2, unsure)


def _motion(r: Recording) -> _Motion | None:
    """None: no speed, no effort, or too short."""
    series = r.inputs | r.outputs
    speeds = [n for n in r.outputs if r.units.get(n) == "rad/s"]
    window = 2 * max(2, round(SMOOTH / r.step)) + 1
    if not speeds or len(r.time) < max(50 * BLOCKS, window):
        return None
    recorded = np.all([np.isfinite(x) for x in series.values()], axis=0)
    known = binary_erosion(recorded, iterations=window // 2, border_value=1)
    wanted = [n for n in series if n == speeds[0] or r.units.get(n) in ("N.m", "A")]
    smooth = {n: savgol_filter(np.where(recorded, series[n], 0.0), window, 2) for n in wanted}
    w = smooth[speeds[0]]
    kept = known & (np.abs(w) > CREEP * np.quantile(np.abs(w), 0.99))
    efforts = {n: x[kept] for n, x in smooth.items() if n != speeds[0] and kept.any() and np.ptp(x[kept]) > 0}
    slope = np.gradient(w, r.step)[kept]
    if not efforts or len(slope) < 50 * BLOCKS or not np.any(slope):
        return None
    weights = np.gradient(np.pad(savgol_coeffs(window, 2), 2), r.step)
    noise = float(np.nan_to_num(noise_and_colour(r.outputs[speeds[0]])[0]) * np.linalg.norm(weights))
    return _Motion(r.name, w[kept], slope, efforts, noise)


def inertia(m: _Motion, effort: str) -> Inertia | None:
    """Of effort = a dw/dt + b w + c sgn(w) + d + other efforts. None: the acceleration is one of these.

    Least squares; the error is a jackknife over blocks, which holds for correlated residuals.
    """
    others = [x for n, x in m.efforts.items() if n != effort]
    columns = [m.slope, m.speed, np.sign(m.speed), np.ones_like(m.speed), *others]
    design = np.column_stack([c / np.sqrt(np.mean(c**2)) for c in columns if np.any(c)])
    y, pieces = m.efforts[effort], np.array_split(np.arange(len(m.speed)), BLOCKS)
    own = float(np.std(design[:, 0] - design[:, 1:] @ np.linalg.lstsq(design[:, 1:], design[:, 0], rcond=None)[0]))
    if own == 0:
        return None
    kept = [np.concatenate([p for j, p in enumerate(pieces) if j != k]) for k in range(BLOCKS)]
    left_out = [np.linalg.lstsq(design[keep], y[keep], rcond=None)[0][0] for keep in kept]
    rest = float(np.std(y - design @ np.linalg.lstsq(design, y, rcond=None)[0]))
    scale = float(np.sqrt(np.mean(m.slope**2)))
    value, own = float(np.mean(left_out)) / scale, own * scale
    bias = rest / own + abs(value) * (m.slope_noise / own) ** 2
    return Inertia(value, float(np.sqrt((BLOCKS - 1) * np.var(left_out))) / scale, bias)


def _correlation(a: Vector, b: Vector) -> float:
    a, b = a - a.mean(), b - b.mean()
    return float(abs(a @ b) / np.sqrt((a @ a) * (b @ b))) if np.any(a) and np.any(b) else 0.0
