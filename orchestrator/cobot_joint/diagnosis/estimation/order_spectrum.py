"""The order spectrum of a residual: its power at so many periods per turn of a shaft."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend

from cobot_joint.diagnosis.estimation.problem import Problem, Vector

WIDTHS = (512, 1024, 2048, 4096)  # samples of a window: the first in which the shaft turns `TURNS`, or the last
TURNS = 4.0
PERIODS = 2.0  # that a window must hold of an order


def order_spectrum(
    problem: Problem,
    residual: Vector,
    angle: str,
    signals: Sequence[Mapping[str, Vector]],
    orders: Sequence[float],
) -> tuple[Vector, Vector]:
    """Per order n: sum over windows and channels of |projection on exp(j n phi)|^2 above its expectation; how many.

    A window counts where it holds `PERIODS` at least, below the Nyquist frequency; a phase that shifts with speed does
    no harm. signals: per recording, by name, (n,) each; runs without the angle do not count.
    """
    n = np.asarray(orders, dtype=np.float64)
    power, windows = np.zeros(len(n)), np.zeros(len(n))
    blocks = [b for b in problem.blocks if angle in signals[b.recording]]
    if not blocks:
        return power, windows
    width = _width([signals[k][angle] for k in {b.recording for b in blocks}])
    taper = np.hanning(width) / np.sqrt(np.mean(np.hanning(width) ** 2))  # else slow structure leaks into low orders
    for number in dict.fromkeys(b.recording for b in blocks):
        rows = [b.rows for b in blocks if b.recording == number]
        samples = len(signals[number][angle]) // width * width
        phi = signals[number][angle][:samples].reshape(-1, width)
        r = np.stack([residual[of_one][:samples].reshape(-1, width) for of_one in rows])
        r = detrend(r, axis=2) * taper if samples else r
        turned, fastest = np.ptp(phi, axis=1), np.abs(np.diff(phi, axis=1)).max(axis=1, initial=0.0)
        for k, wave in enumerate(_waves(phi, n)):
            seen = (turned * n[k] > PERIODS * 2 * np.pi) & (fastest * n[k] < 0.8 * np.pi)
            projected = np.einsum("cwi,wi->cw", r[:, seen], wave[seen])
            power[k] += float(np.sum(np.abs(projected) ** 2 / width - 1))
            windows[k] += len(rows) * np.count_nonzero(seen)
    return power, windows


def _waves(phi: Vector, orders: Vector) -> Iterator[NDArray[np.complex128]]:
    """exp(-j n phi) for each order n; of whole orders one after the other a product of the last: as phi"""
    last, turn = 0.0, np.exp(-1j * phi)
    wave = np.ones_like(turn)
    for order in orders:
        wave = wave * turn if order == last + 1 else np.exp(-1j * order * phi)
        last = order
        yield wave


def _width(angles: Sequence[Vector]) -> int:
    """The same for all runs; no longer than the shortest of them."""
    speed = float(np.quantile(np.abs(np.concatenate([np.diff(phi) for phi in angles])), 0.75))
    possible = [w for w in WIDTHS if w <= min(map(len, angles))] or [WIDTHS[0]]
    return next((w for w in possible if speed * w > TURNS * 2 * np.pi), possible[-1])
