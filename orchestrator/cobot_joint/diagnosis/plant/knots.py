"""A recorded input on fewer knots: its own noise turns at every sample, and an integrator stops at every turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

Vector = NDArray[np.float64]

BEYOND = 4.0  # sigma of an input's noise: what departs so far is no noise, and keeps its samples
PASSES = 4  # over the stretches that do
OF_SECOND_DIFFERENCES = 1.4826 / np.sqrt(6.0)  # sigma of normal white noise, over their median magnitude


def on_fewer_knots(t: Vector, x: Vector, every: int) -> Vector:
    """Of the lines that turn only at every so-many-th sample the one closest to x, at the samples: all (n,).

    Where it departs from x by more than noise does, as at an edge, all samples are knots. Its integral is that of x, up
    to where it begins and ends; where x has no noise, it is x.
    """
    sigma = OF_SECOND_DIFFERENCES * float(np.median(np.abs(np.diff(x, 2))))
    is_knot = np.zeros(len(x), dtype=bool)
    is_knot[::every] = is_knot[-1] = True
    line = x
    for _ in range(PASSES):
        knots = np.flatnonzero(is_knot)
        line = _closest(t, x, knots)
        off = np.flatnonzero(np.abs(x - line) > BEYOND * sigma)
        spans = np.unique(np.clip(np.searchsorted(knots, off, side="right") - 1, 0, len(knots) - 2))
        finer = is_knot.copy()
        for begin, end in zip(knots[spans], knots[spans + 1], strict=True):
            finer[begin : end + 1] = True
        if np.array_equal(finer, is_knot):
            break
        is_knot = finer
    return line


def _closest(t: Vector, x: Vector, knots: NDArray[np.intp]) -> Vector:
    """Least squares over piecewise linear functions: their normal equations are tridiagonal."""
    at, count = t[knots], len(knots)
    span = np.clip(np.searchsorted(at, t, side="right") - 1, 0, count - 2)
    right = (t - at[span]) / (at[span + 1] - at[span])
    left = 1 - right

    def summed(first: Vector, second: Vector) -> Vector:
        return np.asarray(np.bincount(span, first, count) + np.bincount(span + 1, second, count), dtype=float)

    beside = np.bincount(span, left * right, count)  # of a knot and the next
    bands = np.vstack([np.concatenate([[0.0], beside[:-1]]), summed(left**2, right**2)])
    return np.interp(t, at, solveh_banded(bands, summed(left * x, right * x)))
