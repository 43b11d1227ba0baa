"""The order spectrum of a residual: its power at so many periods per turn of a shaft."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend
from scipy.stats import gamma

from cobot_joint.diagnosis.estimation.problem import Problem, Vector

WIDTHS = (512, 1024, 2048, 4096)  # samples of a window: the first in which the shaft turns `TURNS`, or the last
TURNS = 4.0
PERIODS = 2.0  # that a window must hold of an order
HIGHEST = 0.8 * np.pi  # rad that a wave may turn within a sample
QUICK = 0.75  # of its samples a shaft is slower than where it is quick
# of orders between whole ones
LONGER = (8192, 16384)  # windows that resolve them better
LOWEST = 0.4
SAME = 1e-9  # to which two orders are as far apart as two others
APART, REACH = 0.5, 4  # of the resolution, from one to the next; so many steps about one that a shorter window found
MANY_TURNS = 40.0  # in a window: more of them take more orders side by side than they tell
LOBE = 2.0  # half width of a peak under a window's Hann taper, over the resolution
LEAKS = 0.01  # of the highest peak, below which another may be its leakage: the taper's side lobes are at 0.0007
AROUND = 1.5  # orders about one, whose median is what it stands out of
BY_CHANCE = 1e-3  # of all that are looked at, one by noise


def order_spectrum(
    problem: Problem,
    residual: Vector,
    angle: str,
    signals: Sequence[Mapping[str, Vector]],
    orders: Sequence[float],
    width: int | None = None,
    turning: bool = False,
) -> tuple[Vector, Vector]:
    """Per order n: sum over windows and channels of |projection on exp(j n phi)|^2 above its expectation; how many.
    width: samples of a window; None: as many as the shaft needs for some turns. turning: of what changes its sign with
    the direction, as friction does: there and back cancel, else.

    A window counts where it holds `PERIODS` at least, below the Nyquist frequency; a phase that shifts with speed does
    no harm. signals: per recording, by name, (n,) each; runs without the angle do not count.
    """
    n = np.asarray(orders, dtype=np.float64)
    power, windows = np.zeros(len(n)), np.zeros(len(n))
    blocks = [b for b in problem.blocks if angle in signals[b.recording]]
    if not blocks:
        return power, windows
    width = width or _width([signals[k][angle] for k in {b.recording for b in blocks}])
    taper = np.hanning(width) / np.sqrt(np.mean(np.hanning(width) ** 2))  # else slow structure leaks into low orders
    for number in dict.fromkeys(b.recording for b in blocks):
        rows = [b.rows for b in blocks if b.recording == number]
        samples = len(signals[number][angle]) // width * width
        phi = signals[number][angle][:samples].reshape(-1, width)
        r = np.stack([residual[of_one][:samples].reshape(-1, width) for of_one in rows], axis=1)
        if samples:
            r = detrend(r, axis=2)
            if turning:
                r = detrend(r * np.sign(np.gradient(phi, axis=1))[:, None], axis=2)
            r = r * taper
        turned, fastest = np.ptp(phi, axis=1), np.abs(np.diff(phi, axis=1)).max(axis=1, initial=0.0)
        for k, wave in enumerate(_waves(phi, n)):
            seen = (turned * n[k] > PERIODS * 2 * np.pi) & (fastest * n[k] < HIGHEST)
            parts = wave.view(np.float64).reshape(*wave.shape, 2)  # real and imaginary
            count = len(rows) * np.count_nonzero(seen)
            power[k] += float(np.sum((r @ parts)[seen] ** 2)) / width - count
            windows[k] += count
    return power, windows


def clearest_between(
    problem: Problem, residual: Vector, angle: str, signals: Sequence[Mapping[str, Vector]], most: float
) -> float | None:
    """The order up to `most`, no whole number, that stands out most; None: none does.

    Bearings and belts leave such. First in windows of some turns; then in longer ones, which resolve it better: an
    order is known to a part of the inverse of the turns that a window has. residual, signals: as above.
    """
    angles = [signals[k][angle] for k in {b.recording for b in problem.blocks} if angle in signals[k]]
    shortest = min(map(len, angles), default=0)
    possible = [w for w in (*WIDTHS, *LONGER) if w <= shortest and _turns(angles, w) > TURNS]
    # where it is slow, the samples resolve as much
    high = HIGHEST / max(_speed(angles, 1 - QUICK), HIGHEST / most) if possible else 0.0
    if high < LOWEST:
        return None
    width = max([possible[0], *(w for w in possible if _turns(angles, w) < MANY_TURNS)])
    step = APART / _turns(angles, width)
    best = _clearest(problem, residual, angle, signals, np.arange(step, high, step), width)
    for longer in (w for w in possible if w > width):
        if best is None:
            break
        step = APART / _turns(angles, longer)
        orders = (best + step * np.arange(-REACH, REACH + 1)).tolist()
        power, windows = order_spectrum(problem, residual, angle, signals, orders, longer)
        if not np.any(windows):
            break
        best = _peak(orders, power)
    return best


def _clearest(
    problem: Problem,
    residual: Vector,
    angle: str,
    signals: Sequence[Mapping[str, Vector]],
    orders: Vector,
    width: int,
) -> float | None:
    """The highest peak that is no whole order's, and that what is on either side of it does not account for: noise has
    a chi-square of two per window, times a level that changes with the order where something wanders in time."""
    power, windows = order_spectrum(problem, residual, angle, signals, orders.tolist(), width)
    every, apart = power + windows, orders[1] - orders[0] if len(orders) > 1 else 1.0
    peaks = 1 + np.flatnonzero((every[1:-1] > every[:-2]) & (every[1:-1] >= every[2:]))
    peaks = peaks[orders[peaks] >= LOWEST]
    for k in peaks[np.argsort(-every[peaks])]:
        if abs(orders[k] - max(round(orders[k]), 1)) < apart / (2 * APART):
            continue  # half of the resolution
        away = (np.arange(len(orders)) - k) * apart
        beside = (np.abs(away) > LOBE * apart / APART) & (np.abs(away) < AROUND) & (windows > 0)
        sides = [every[beside & (away * sign > 0)] for sign in (-1, 1)]
        if every[k] < LEAKS * np.max(every) or not all(map(len, sides)):
            return None
        m = float(windows[k])
        level = max(map(np.median, sides)) / gamma.median(m)
        clear = m > 0 and every[k] > level * gamma.isf(BY_CHANCE / len(orders), m)
        return _peak(orders[k - 1 : k + 2].tolist(), power[k - 1 : k + 2]) if clear else None
    return None


def _peak(orders: Sequence[float], power: Vector) -> float:
    """Of a parabola through the largest and its neighbours."""
    k = int(np.argmax(power))
    if not 0 < k < len(power) - 1:
        return orders[k]
    before, here, after = power[k - 1 : k + 2]
    return orders[k] + (orders[1] - orders[0]) * float((before - after) / (before - 2 * here + after)) / 2


def _turns(angles: Sequence[Vector], width: int) -> float:
    """Of the shaft in a window where it is quick."""
    return _speed(angles, QUICK) * width / (2 * np.pi)


def _speed(angles: Sequence[Vector], quantile: float) -> float:
    """That part of the samples is slower, rad per sample."""
    return float(np.quantile(np.abs(np.concatenate([np.diff(phi) for phi in angles])), quantile))


def _waves(phi: Vector, orders: Vector) -> Iterator[NDArray[np.complex128]]:
    """exp(-j n phi) for each order n; where they are as far apart as the ones before, a product of the last: as phi"""
    wave, turn, last, apart = np.ones_like(phi, dtype=complex), np.ones_like(phi, dtype=complex), 0.0, 0.0
    for order in orders:
        if abs(order - last - apart) > SAME:
            apart = order - last
            turn = np.exp(-1j * apart * phi)
        wave, last = wave * turn, order
        yield wave


def _width(angles: Sequence[Vector]) -> int:
    """The same for all runs; no longer than the shortest of them."""
    possible = [w for w in WIDTHS if w <= min(map(len, angles))] or [WIDTHS[0]]
    return next((w for w in possible if _turns(angles, w) > TURNS), possible[-1])
