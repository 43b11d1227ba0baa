"""By how much a channel comes late in each run, how well the run tells it, and whether its runs agree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.recording import Recording

Vector = NDArray[np.float64]

ROUNDS, LONGEST = 4, 0.1  # of linearisation; share of a run, from which on a shift is no delay
PIECES = 10  # of a run, that are left out in turn
ALIKE = 0.3  # share by which delays of two runs may differ and be the same, and to which a run has to know one
SCATTER = 3.0  # standard errors of one run, within which it does not contradict
SHARE = 0.5  # of what is left beside a simulation, that a delay has to explain: 0.2 at most in sound channels
SAME_SHAFT = 1e-3  # of an angle's size, that the integral of its own speed leaves
GAIN = 0.05  # by which an integrated speed may be off and still be that of the angle


@dataclass(frozen=True)
class Delay:
    """One run's: s late, its standard error, and the sum of squares that is left without and with it."""

    late: float
    error: float
    without: float = 1.0
    left: float = 0.0


def agreed(delays: Sequence[Delay], step: float) -> float | None:
    """Seconds late, by more than a sample, in every run that can tell. None: they differ, or fewer than two tell, of
    several; or most of the misfit is something else."""
    if not mostly(delays):
        return None
    telling = [d for d in delays if d.error < ALIKE * abs(d.late)]
    if len(telling) < min(2, len(delays)):
        return None
    weights = 1 / np.array([d.error for d in telling]) ** 2
    late = float(np.average([d.late for d in telling], weights=weights))
    same = all(abs(d.late - late) < max(ALIKE * abs(late), SCATTER * d.error) for d in delays)
    return late if same and abs(late) > step else None


def mostly(delays: Sequence[Delay]) -> bool:
    """Whether most of the misfit, of all runs together, is that."""
    return bool(delays) and sum(d.left for d in delays) < (1 - SHARE) * sum(d.without for d in delays)


def beside(x: Vector, s: Vector, step: float) -> Delay | None:
    """Of x, recorded, beside s, simulated: (n,). None: one of them does not move, or it does not converge."""
    t, known = np.arange(len(x)) * step, np.isfinite(x)
    late = error = 0.0
    columns = np.empty((0, 3))
    for _ in range(ROUNDS):
        moved = np.interp(t - late, t, s)
        columns = np.column_stack([-np.gradient(moved, step), moved, np.ones_like(t)])[known]
        found = _ratio(columns, x[known])
        if found is None:
            return None
        late, error = late + found[0], found[1]
    if abs(late) > LONGEST * step * len(x):
        return None
    without = np.column_stack([s, np.ones_like(t)])[known]
    return Delay(late, error, _left(without, x[known]), _left(columns, x[known]))


def of_one_shaft(r: Recording, simulated: Mapping[str, Vector]) -> Iterator[tuple[str, str, Delay]]:
    """Angles and speeds that are of one shaft in the nominal system, and by how much the speed is late.

    phi(t) = g*S(t + late) + a + b*t, with S the integral of the recorded w, which is free of most of its noise.
    """
    angles, speeds = ([n for n in r.outputs if n in simulated and r.units.get(n) == unit] for unit in ("rad", "rad/s"))
    for angle, speed in product(angles, speeds):
        there = _integrated(simulated[speed], r.step)
        if _left(there[:, 1:], simulated[angle]) > (SAME_SHAFT * np.ptp(simulated[angle])) ** 2 * len(there):
            continue
        phi, w = r.outputs[angle], r.outputs[speed]
        known = np.isfinite(phi) & np.isfinite(w)
        columns = _integrated(np.interp(r.time, r.time[known], w[known]) if known.any() else w, r.step)[known]
        found = _ratio(columns, phi[known])
        if found is not None and abs(found[2] - 1) < GAIN:
            yield angle, speed, Delay(*found[:2], _left(columns[:, 1:], phi[known]), _left(columns, phi[known]))


def _integrated(w: Vector, step: float) -> Vector:
    """Columns: the speed, its integral, 1, t."""
    integral = step * np.concatenate([[0.0], np.cumsum((w[1:] + w[:-1]) / 2)])
    return np.column_stack([w, integral, np.ones_like(w), np.arange(len(w)) * step])


def _left(columns: Vector, y: Vector) -> float:
    """Sum of squares that they leave."""
    rest = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    return float(rest @ rest)


def _ratio(columns: Vector, y: Vector) -> tuple[float, float, float] | None:
    """Least squares: the first coefficient over the second, its standard error, and the second. None: nothing moves.

    The error is a jackknife over pieces of the run, which holds for correlated residuals.
    """
    if len(y) < 10 * PIECES or np.ptp(y) == 0 or not np.ptp(columns[:, :2], axis=0).all():
        return None
    scale = np.sqrt(np.mean(columns**2, axis=0))
    parts = np.array_split(np.arange(len(y)), PIECES)
    design = columns / scale
    grams, moments = [design[p].T @ design[p] for p in parts], [design[p].T @ y[p] for p in parts]
    gram, moment = sum(grams), sum(moments)
    left_out = zip(grams, moments, strict=True)
    whole = [np.linalg.lstsq(gram - g, moment - m, rcond=None)[0] / scale for g, m in left_out]
    if not all(c[1] for c in whole):
        return None
    ratios = np.array([c[0] / c[1] for c in whole])
    gain = float(np.mean([c[1] for c in whole]))
    return float(np.mean(ratios)), float(np.sqrt((PIECES - 1) * np.var(ratios))), gain
