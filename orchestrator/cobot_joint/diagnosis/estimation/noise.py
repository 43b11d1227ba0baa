"""A channel's noise, its colour, and what that predicts where nothing was recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Of a channel: 1 sigma in all, lag-1 autocorrelation; the converter's step: its rounding is white."""

    sigma: float
    colour: float = 0.0
    step: float = 0.0

    @property
    def filter(self) -> tuple[float, float, float]:
        """(rho, theta, sigma of the innovation): (1 - rho B) y = (1 + theta B) e, noise and white rounding."""
        rounding = min(self.step**2 / 12, 0.5 * self.sigma**2)
        first = self.sigma**2 - rounding
        rho = float(np.clip(self.colour * self.sigma**2 / first, 0.0, 0.95))
        g0, g1 = first * (1 - rho**2) + (1 + rho**2) * rounding, -rho * rounding
        # the invertible root of g1 theta^2 - g0 theta + g1 = 0, and g1 / theta, without a difference of like numbers
        root = g0 + np.sqrt(g0**2 - 4 * g1**2)
        return rho, float(2 * g1 / root), float(np.sqrt(root / 2))

    def sigma_after(self, steps: Vector) -> Vector:
        """1 sigma of what a sample is off from its prediction by the one that came so many steps before: like steps."""
        first = self.sigma**2 - min(self.step**2 / 12, 0.5 * self.sigma**2)
        r2 = self.filter[0] ** (2 * steps)
        return np.asarray(np.sqrt(self.sigma**2 * (1 + r2) - 2 * r2 * first))

    def draw(self, n: int, rng: np.random.Generator) -> Vector:
        """Such noise before it is rounded, stationary from the first sample on: (n,)"""
        sigma = np.sqrt(max(self.sigma**2 - self.step**2 / 12, 0.0))
        first = rng.normal(0, sigma)
        drawn = np.concatenate([[first], np.sqrt(1 - self.colour**2) * rng.normal(0, sigma, n - 1)])
        return np.asarray(lfilter([1.0], [1.0, -self.colour], drawn))

    def on(self, y: Vector, rng: np.random.Generator) -> Vector:
        """A signal as it is recorded, (n,): with noise, in steps of the converter."""
        noisy = y + self.draw(len(y), rng)
        return self.step * np.round(noisy / self.step) if self.step else noisy


@dataclass(frozen=True)
class Gaps:
    """Where a channel was not recorded.

    since: samples since the last that was recorded, 0: this one; before the first more than there are. resumes: which
    follow on a gap.
    """

    since: Vector
    resumes: NDArray[np.intp]

    @staticmethod
    def of(known: NDArray[np.bool_]) -> Gaps:
        """known: (n,)"""
        count = np.arange(len(known))
        since = count - np.maximum.accumulate(np.where(known, count, -len(known)))
        return Gaps(since.astype(float), np.flatnonzero(known[1:] & ~known[:-1]) + 1)

    def bridged(self, y: Vector, rho: float) -> Vector:
        """What the colour rho predicts from the last sample before it in place of what was not recorded: (n,)"""
        if not self.since.any():
            return y
        last = np.arange(len(y)) - self.since.astype(int)
        return np.where(last < 0, 0.0, y[last] * rho**self.since)
