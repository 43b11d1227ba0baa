"""The order spectrum of a residual: its power at so many periods per turn of a shaft."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.signal import detrend, lfilter
from scipy.stats import gamma

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.problem import Vector

WIDTHS = (512, 1024, 2048, 4096)  # samples of a window: the first in which the shaft turns `TURNS`, or the last
TURNS = 4.0
PERIODS = 2.0  # that a window must hold of an order
HIGHEST = 0.8 * np.pi  # rad that a wave may turn within a sample
QUICK = 0.75  # of its samples a shaft is slower than where it is quick
ORDINARY = 48  # orders that every shaft is looked at
QUICKEST = 0.9  # of the quickest shaft's travel, that another has which turns as quickly
FINEST = 400  # the highest of all: slots times poles of a motor with many of both, teeth of a large wheel
CELLS = 8  # of a turn's grid, per period of the highest order
LAST, RIDGE = 8, 1e-9  # samples that predict the next; share that keeps their equations from being singular
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


class Rows(Protocol):
    """Of one channel of one recording, in a residual."""

    @property
    def recording(self) -> int:
        """Its number."""

    @property
    def rows(self) -> slice:
        """As many as the recording has samples."""


class Blocks(Protocol):
    """What has a residual: a problem."""

    @property
    def blocks(self) -> Sequence[Rows]:
        """Of all its recordings."""


def order_spectrum(
    problem: Blocks,
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
    project = _at_whole_orders if np.all(n == np.round(n)) else _at_any_orders
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
        seen = (np.outer(n, turned) > PERIODS * 2 * np.pi) & (np.outer(n, fastest) < HIGHEST)
        count = len(rows) * np.count_nonzero(seen, axis=1)
        power += np.sum(project(phi, r, n), axis=1, where=seen) / width - count
        windows += count
    return power, windows


def clearest_between(
    problem: Blocks, residual: Vector, angle: str, signals: Sequence[Mapping[str, Vector]], most: float
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
    problem: Blocks,
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


def whole_orders(signals: Sequence[Mapping[str, Vector]], angles: Sequence[str]) -> dict[str, list[float]]:
    """Angle -> those that its shaft is looked at: of the quickest, up to what its samples resolve where it is slow.
    What repeats more often on a slower one is a low order of that. signals: per recording, by name, (n,) each."""
    runs = {angle: [s[angle] for s in signals if angle in s] for angle in angles}
    travel = {angle: max((float(np.ptp(phi)) for phi in of_one), default=0.0) for angle, of_one in runs.items()}
    quickest = max(travel.values(), default=0.0)
    found = {}
    for angle, of_one in runs.items():
        most = float(ORDINARY)
        if travel[angle] > QUICKEST * quickest:
            most = max(most, HIGHEST / max(_speed(of_one, 1 - QUICK), HIGHEST / FINEST))
        found[angle] = [float(n) for n in range(1, int(most) + 1)]
    return found


def prewhitened(problem: Blocks, residual: Vector) -> Vector:
    """Each channel less what its last samples predict of it: waves stay, and what is slow has no more power than they.
    Linear prediction by autocorrelation, as for faults of bearings beside gears (Sawalhi, Randall, Endo 2007, Mech.
    Syst. Signal Process. 21(6)). residual: (rows,)"""
    found = np.zeros_like(residual)
    for b in problem.blocks:
        x = residual[b.rows]
        if len(x) <= LAST or np.ptp(x) == 0:
            continue  # as the rows of a table
        x = (x - np.mean(x)) / np.ptp(x)
        r = np.array([x[: len(x) - k] @ x[k:] for k in range(LAST + 1)])
        r[0] *= 1 + RIDGE
        e = lfilter([1.0, *-solve_toeplitz(r[:-1], r[1:])], [1.0], x)
        found[b.rows] = e / np.std(e)
    return found


def clear_orders(power: Vector, windows: Vector) -> list[int]:
    """Numbers of whole orders that stand out of noise and of those beside them. power, windows: `order_spectrum`."""
    mean, found = power / np.maximum(windows, 1), []
    for k in np.flatnonzero(power > thresholds.STANDS_OUT * np.sqrt(np.maximum(windows, 1))):
        beside = [mean[j] for j in (k - 2, k - 1, k + 1, k + 2) if 0 <= j < len(mean) and windows[j]]
        if beside and mean[k] > thresholds.STANDS_OUT * max(float(np.median(beside)), 0.0):
            found.append(int(k))
    return found


def _at_whole_orders(phi: Vector, r: Vector, orders: Vector) -> Vector:
    """Sum over channels of |sum_k r_k exp(-j n phi_k)|^2: (orders, windows). phi: (windows, samples), r: (windows,
    channels, samples). A Fourier transform over the turn: each sample is shared out between the two cells of a grid
    about it, which multiplies what is at n by sinc(n/cells)^2."""
    n = orders.astype(np.intp)
    cells = 1 << (CELLS * int(np.max(n, initial=1))).bit_length()
    place = np.mod(phi, 2 * np.pi) * (cells / (2 * np.pi))
    cell = place.astype(np.intp)
    part, first = place - cell, cells * np.arange(len(phi))[:, None]
    at = np.concatenate([(first + cell % cells).ravel(), (first + (cell + 1) % cells).ravel()])
    found = np.zeros((len(n), len(phi)))
    for x in np.swapaxes(r, 0, 1):
        shared = np.concatenate([(x * (1 - part)).ravel(), (x * part).ravel()])
        turn = np.bincount(at, shared, cells * len(phi)).reshape(len(phi), cells)
        found += np.abs(np.fft.rfft(turn, axis=1)[:, n].T) ** 2
    return np.asarray(found / np.sinc(n / cells)[:, None] ** 4)


def _at_any_orders(phi: Vector, r: Vector, orders: Vector) -> Vector:
    """The same, of any orders."""
    found = np.empty((len(orders), len(phi)))
    for k, wave in enumerate(_waves(phi, orders)):
        parts = wave.view(np.float64).reshape(*wave.shape, 2)  # real and imaginary
        found[k] = np.sum((r @ parts) ** 2, axis=(1, 2))
    return found


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
