"""What a recorded channel is worth, from the data: noise, its colour, the converter's step, saturation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import toeplitz
from scipy.optimize import brentq
from scipy.signal import detrend, savgol_filter

WINDOWS = (256, 128, 64, 32)  # samples in which a quiet signal is a parabola, the most that agree with shorter ones
AGREE = 1.2  # times the sigma of shorter windows, above which longer ones hold more than noise: coloured noise of 0.8
# comes out 13 % less from 32 samples than from 256
MOTION = 0.95  # lag-1 correlation from which on what the quietest windows hold is no noise, but the machine's motion
ENOUGH = 16  # samples of a window, of which its noise can be told
ROUNDING = 1e-12  # of the largest value: a window that varies by less stands still, and says nothing of the noise
QUIETEST = (
    0.03  # share of windows that is taken for noise alone; windows as quiet, within the scatter of a variance, join it
)
WIDTHS = (9, 17, 33, 65, 129)  # samples of a smoother's window
BESIDE = 2  # samples on either side, by which noise may be correlated
CUBIC = 3
OWN = 0.5  # s, over which a speed knows better than a position how quick a shaft is
RATE = 0.02  # by which a speed may differ from a position's rate, and share that its integral may leave of it
FEWEST_OF_PARABOLA, BY_CHANCE = 16, 3.0  # samples, and sigma up to which they lie on one
APART, CLEARLY = 0.05, 100.0  # of what a position goes through, or times its noise, by which it begins elsewhere
FEWEST_VALUES, MOST_LINES = 50, 2**18  # of a channel, and places that they may lie at, for a step that was rounded
IN_PHASE = 0.7  # of values, from which on they are whole multiples of a step: 50 anywhere have 0.5 by chance
RAIL = 10  # samples in a row at an extreme from which the channel counts as saturated: noise would move them


@dataclass(frozen=True)
class ChannelQuality:
    """One channel of one recording, or of all that have it."""

    noise: float  # 1 sigma, quantisation included
    colour: float  # correlation from sample to sample, first order
    step: float  # of the converter; 0: none seen
    low: float
    high: float
    saturated: int  # samples at an extreme, several in a row
    missing: int  # samples not recorded
    samples: int

    def sigma(self, stated: float = 0.0) -> float:
        """The noise; of a channel that shows none, because it rests or was computed, what is stated, else 1."""
        return self.noise if np.isfinite(self.noise) and self.noise > 0 else stated or 1.0


def assess(*series: NDArray[np.float64]) -> ChannelQuality:
    """One channel. series: per recording (n,) on a regular clock, NaN where not recorded."""
    recorded = [x[np.isfinite(x)] for x in series]
    x = np.concatenate(recorded)
    noise, colour = noise_and_colour(*series)
    step = quantisation_step(x)
    return ChannelQuality(
        noise=noise,
        colour=colour,
        step=step,
        low=float(x.min(initial=np.inf)),
        high=float(x.max(initial=-np.inf)),
        saturated=sum(_saturated(part, x, step) for part in recorded),
        missing=sum(map(len, series)) - len(x),
        samples=sum(map(len, series)),
    )


def noise_and_colour(*series: NDArray[np.float64]) -> tuple[float, float]:
    """Sigma and lag-1 correlation of the noise on a slow signal.

    In windows, less a parabola; the quietest windows are noise alone. Noise is the same in windows of any length; what
    longer ones have more is the machine's own motion. Where no window is without motion, only what differs from one
    sample to the next without a pattern is noise, and white. (NaN, 0) where no window has enough samples.
    """
    if min(map(len, series)) < ENOUGH:
        return float("nan"), 0.0
    longest = max(ENOUGH, min(map(len, series)) // 8)
    found = [_in_windows(series, n) for n in dict.fromkeys(min(n, longest) for n in WINDOWS)]
    sigmas = [sigma for sigma, _ in found]
    agree = [s <= AGREE * min(sigmas[k:]) for k, s in enumerate(sigmas)]
    sigma, colour = next((f for f, fits in zip(found, agree, strict=True) if fits), found[0])
    return (sigma, colour) if colour < MOTION else (_from_sample_to_sample(series), 0.0)


def _from_sample_to_sample(series: Sequence[NDArray[np.float64]]) -> float:
    """Sigma of white noise on a signal that is a parabola over four samples, by third differences: their variance is
    twenty times the noise's. By their median, since a few samples are impacts and others stand still."""
    third = np.abs(np.concatenate([np.diff(x, 3) for x in series]))
    third = third[third > ROUNDING * max(float(np.nanmax(np.abs(x))) for x in series)]
    return float(np.median(third) / 0.6745 / np.sqrt(20)) if len(third) else 0.0


def _in_windows(series: Sequence[NDArray[np.float64]], n: int) -> tuple[float, float]:
    """The same from windows of n samples; where none is recorded in full, from those with `ENOUGH` of them.

    What the parabola takes from coloured noise is put back by matching the expected moments of a first-order process.
    """
    windows = np.concatenate([np.lib.stride_tricks.sliding_window_view(x, n)[:: n // 2] for x in series])
    known = np.isfinite(windows)
    full = known.all(axis=1)
    some = full if full.any() else known.sum(axis=1) >= ENOUGH
    windows, known = windows[some], known[some]
    if not len(windows):
        return float("nan"), 0.0
    rest = _less_parabola(windows, known)
    m = round(float(known.sum(axis=1).mean()))
    power = np.sum(rest**2, axis=1) / known.sum(axis=1)
    moves = power > (ROUNDING * np.nanmax(np.abs(windows))) ** 2
    if not moves.any():
        return 0.0, 0.0
    rest, known, power = rest[moves], known[moves], power[moves]
    floor = np.quantile(power, QUIETEST)
    colour, variance = 0.0, 0.0
    for _ in range(3):  # coloured noise has fewer independent samples per window: its variances scatter more
        scatter = np.sqrt(2 / m * (1 + colour**2) / (1 - colour**2))
        quiet = power <= floor * (1 + 2.5 * scatter) / max(1 - 1.9 * scatter, 0.25)
        variance = float(np.mean(power[quiet]))
        pairs = known[quiet, 1:] & known[quiet, :-1]
        product = float(np.sum(rest[quiet, 1:] * rest[quiet, :-1])) / max(int(pairs.sum()), 1)
        colour = _colour(m, product / variance)
    return float(np.sqrt(variance / _moments(m, colour)[0])), colour


def _less_parabola(windows: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Windows, (k, n), less the parabola that fits what is known of each; 0 where nothing is known."""
    basis = _parabolas(windows.shape[1])
    if known.all():
        return np.asarray(windows - (windows @ basis) @ basis.T)
    there = np.where(known, windows, 0.0)
    gram = np.einsum("kn,ni,nj->kij", known.astype(float), basis, basis)
    fitted = np.linalg.solve(gram, (there @ basis)[..., None])[..., 0] @ basis.T
    return np.where(known, windows - fitted, 0.0)


def _colour(n: int, seen: float, lower: float = -0.95, upper: float = 0.98) -> float:
    """The first-order correlation whose noise, less its parabola in n samples, shows the correlation seen."""
    if seen <= _moments(n, lower)[1]:
        return lower
    if seen >= _moments(n, upper)[1]:
        return upper
    return float(brentq(lambda rho: _moments(n, rho)[1] - seen, lower, upper, xtol=1e-4))


@lru_cache(maxsize=8)
def _parabolas(n: int) -> NDArray[np.float64]:
    """Orthonormal 1, t, t^2: (n, 3)"""
    return np.linalg.qr(np.vander(np.linspace(-1, 1, n), 3, increasing=True))[0]


@lru_cache(maxsize=256)
def _moments(n: int, rho: float) -> tuple[float, float]:
    """Of unit first-order noise less its parabola, in a window of n: variance, and lag-1 product over variance."""
    basis = _parabolas(n)
    covariance = toeplitz(rho ** np.arange(n))
    left = covariance - basis @ (basis.T @ covariance)
    rest = left - (left @ basis) @ basis.T
    variance = float(np.trace(rest)) / n
    return variance, float(np.trace(rest, offset=1)) / (n - 1) / variance


def quantisation_step(x: NDArray[np.float64]) -> float:
    """The converter's step: distances between values that occur are whole multiples of it. 0 where they are not."""
    values = np.unique(x)
    if len(values) < 3 or len(values) > 0.5 * len(x):
        return 0.0
    apart = np.diff(values)
    apart = apart[apart > 1e-2 * np.median(apart)]  # the file's own rounding, 4.88e-3 or 4.883e-3
    step = float(np.median(apart[apart <= 1.5 * apart.min()]))
    whole = np.rint(values / step)
    step = float(np.dot(whole, values) / np.dot(whole, whole))  # all values together know it better than two neighbours
    multiples = np.mean(np.abs(values / step - np.rint(values / step)) < 0.1) > 0.95
    step = step if multiples else 0.0
    wider = _rounded_step(values, float(apart.min()), float(np.median(apart)))
    return wider if wider > 1.5 * step else step


def _rounded_step(values: NDArray[np.float64], least: float, usual: float) -> float:
    """The step of values that a file rounded once more: encoder counts in whole rpm, 2, 3, 6, 9, 12 of 2.93 each.

    The widest by which the values are in phase, |mean of exp(2 pi i x/step)|, of the spectrum of where they lie. Values
    anywhere have sqrt(ln(lines)/n) at most (Rayleigh), such counts 0.8. least, usual: distances of neighbours.
    """
    width = least / 8
    lines = np.ptp(values) / width
    if len(values) < FEWEST_VALUES or lines > MOST_LINES:
        return 0.0
    there = np.bincount(((values - values[0]) / width).astype(int))
    count = 4 * len(there)
    phase, frequency = np.abs(np.fft.rfft(there, count)) / len(values), np.fft.rfftfreq(count, width)
    asked = (frequency > 1 / (1.5 * usual)) & (frequency < 1.5 / least)
    together = np.flatnonzero(asked & (phase > IN_PHASE))
    if not len(together):
        return 0.0
    first = int(together[0])
    peak = first + int(np.argmax(np.diff(phase[first:], append=-1.0) < 0))
    return float(1 / frequency[peak])


def _saturated(x: NDArray[np.float64], everywhere: NDArray[np.float64], step: float) -> int:
    """Samples of x in runs of RAIL or more at the very top or bottom of what occurs anywhere, where a limit cut them
    off. A smooth peak, y = -a t^2, that a converter's step rounds is a run as well: as far again beyond its ends it has
    fallen by 9 steps at most, from 1 at half its length."""
    count = 0
    for extreme in (everywhere.min(initial=np.inf), everywhere.max(initial=-np.inf)):
        for start, stop in runs(x == extreme):
            beyond = x[[max(2 * start - stop, 0), min(2 * stop - start - 1, len(x) - 1)]]
            peak = step > 0 and start > 0 and stop < len(x) and np.abs(beyond - extreme).max() <= 9 * step
            count += stop - start if stop - start >= RAIL and not peak else 0
    return count


def runs(at: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and one past the last index of every stretch of True."""
    edges = np.diff(np.concatenate([[0], at.astype(int), [0]]))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))


def smoothed(x: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
    """A speed less its noise, (n,), and the window, samples (Savitzky and Golay 1964, Anal. Chem. 36(8)); 1: as it is.

    The window is the one that best predicts a sample from those around it, its own and its next neighbours left out
    since their noise may be the same (Chu and Marron 1991, Ann. Stat. 19(4)). An inertia behind a spring makes a torque
    of a speed's noise: an amplifier's bandwidth was named, 25 % sure, with 1.8 N.m left where the torque's noise is
    0.1 N.m.
    """
    error = {n: _left_out(x, n) for n in WIDTHS if 8 * n <= len(x)}
    best = min(error, key=error.__getitem__, default=1)
    if best in (1, WIDTHS[0]):  # nothing is gained by a wider one: it is motion
        return x, 1
    return savgol_filter(x, best, CUBIC), best


def is_rate(w: NDArray[np.float64], phi: NDArray[np.float64], t: NDArray[np.float64]) -> bool:
    """Whether a position is a speed's integral, (n,) each: their slope is 1, and what it leaves is little. A line is
    left out: an offset of the speed."""
    if len(t) < 2 or not all(np.all(np.isfinite(x)) for x in (w, phi, t)):
        return False
    way, place = detrend(cumulative_trapezoid(w, t, initial=0.0)), detrend(phi)
    square = float(way @ way)
    slope = float(way @ place) / square if square > 0 else 0.0
    return abs(slope - 1) < RATE and float(np.sum((place - way) ** 2)) < RATE * float(place @ place)


def with_place(
    w: NDArray[np.float64], phi: NDArray[np.float64], step: float
) -> tuple[NDArray[np.float64], float] | None:
    """A speed, (n,), whose integral does not leave the position that was recorded of the same shaft, (n,), NaN where it
    was not, and by how much it was off (rms): quicker than OWN it is as recorded, slower the position's rate. None: the
    position is not its integral, in this unit and direction."""
    at, known = np.arange(len(phi)), np.flatnonzero(np.isfinite(phi))
    width = min(max(round(OWN / step), 2 * CUBIC), len(w) // 2) // 2 * 2 + 1
    if width <= CUBIC or not len(known):
        return None
    place = np.interp(at, known, phi[known])
    if not is_rate(w, place, step * at.astype(float)):
        return None
    off = place - cumulative_trapezoid(w, dx=step, initial=0)
    correction = savgol_filter(off, width, CUBIC, deriv=1, delta=step)
    return w + correction, float(np.sqrt(np.mean(correction**2)))


def _left_out(x: NDArray[np.float64], n: int) -> float:
    """Mean square error of a cubic through a window without its middle."""
    at = np.arange(n) - n // 2
    beside = np.abs(at) > BESIDE
    weights = np.zeros(n)
    weights[beside] = np.linalg.pinv(np.vander(at[beside], CUBIC + 1, increasing=True))[0]
    predicted = np.convolve(x, weights[::-1], "valid")
    return float(np.mean((x[n // 2 : n // 2 + len(predicted)] - predicted) ** 2))


def beginning(x: NDArray[np.float64]) -> tuple[float, float]:
    """Where a series begins, and 1 sigma of that: at the first of a parabola through as many samples as one describes.

    Twice as many at a time, until a cubic fits better than by chance. From n samples it is known to 3/sqrt(n) of their
    noise (Savitzky, A., Golay, M. (1964), Anal. Chem. 36(8)); a rotor that coasts carries the error of its first
    sample on to the end.
    """
    known = np.flatnonzero(np.isfinite(x))
    sigma, colour = noise_and_colour(x)
    begins, n = float(x[known[0]]), FEWEST_OF_PARABOLA
    if not sigma > 0:
        return begins, 0.0
    scatter = sigma
    sigma *= np.sqrt((1 + colour) / (1 - colour))
    while n <= len(known) // 4 and known[n - 1] - known[0] == n - 1:
        basis, _ = np.linalg.qr(np.vander(np.linspace(-1, 1, n), CUBIC + 1, increasing=True))
        along = x[known[:n]] @ basis
        rest = x[known[:n]] - basis @ along
        if abs(along[CUBIC]) > BY_CHANCE * sigma or rest @ rest > (n + BY_CHANCE * np.sqrt(2 * n)) * sigma**2:
            break
        begins = float(basis[0, :CUBIC] @ along[:CUBIC])
        scatter = float(np.linalg.norm(basis[0, :CUBIC]) * sigma)
        n *= 2
    return begins, scatter


def begins_apart(x: NDArray[np.float64], there: float) -> float | None:
    """Where a position or speed begins, if that is elsewhere than there by more than its way, or its noise, leaves in
    doubt; else None. A motor that goes through 96 rad began 0.37 rad off, which is 20,000 times its encoder's noise."""
    known = x[np.isfinite(x)]
    if not len(known):
        return None
    off, sigma = abs(known[0] - there), np.nan_to_num(noise_and_colour(x)[0])
    apart = off > APART * np.ptp(known) or (sigma > 0 and off > CLEARLY * sigma)
    return float(known[0]) if apart else None
