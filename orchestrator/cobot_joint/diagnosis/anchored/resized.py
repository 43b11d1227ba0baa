"""What a term gains where the latent forces need no longer stand in for it: their sizes estimated again with it.

A regression of innovations holds the latent forces' sizes as they are without the term, as large as it is slow: most of
what it explains they have taken already. Here what a regression explains is taken off the readings, the sizes are
estimated for the rest, and the likelihoods compared. No run is simulated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.anchored.background import background
from cobot_joint.diagnosis.anchored.beside import Beside, Candidate, trimmed_sum
from cobot_joint.diagnosis.state_estimation.evidence import Effect, Tracking
from cobot_joint.diagnosis.state_estimation.kalman import respond

Array = NDArray[np.float64]
ROUNDS = 4  # of estimating the sizes again
AT_ONCE = 2  # recordings, each in a thread


class Resized:
    """At one point of a search; what it is without any term is found once."""

    def __init__(self, at: Beside) -> None:
        self.at = at
        self._without: Array | None = None

    def evidence(self, found: Candidate) -> float:
        """Nats for a term, less the logarithm of how many shapes and onsets were tried."""
        at = self.at
        if self._without is None:
            self._without = self._likelihoods(at.regression.theta, at.acting)
        with_it = self._likelihoods(found.added.theta, at.acting, found.effect)
        price = found.added.price - at.regression.price
        return price + trimmed_sum(with_it - self._without) - (found.added.evidence - found.evidence)

    def _likelihoods(self, theta: Array, acting: Sequence[Effect], last: Effect | None = None) -> Array:
        """Logarithms, but for a constant, of the readings less what acts, block by block: (blocks,)"""
        at = self.at
        sums = [[np.zeros((len(t.tracked.time) - 1, t.estimator.x.stop)), np.zeros(t.tracked.y.shape)]
                for t in at.trackings]  # fmt: skip
        first = 0
        for effect in self._all(acting, last):
            own = slice(first, first + effect.direct[0].shape[2])
            for total, psi, direct in zip(sums, effect.psi, effect.direct, strict=True):
                total[0] += psi @ theta[own]
                total[1] += direct @ theta[own]
            first = own.stop
        with ThreadPoolExecutor(AT_ONCE) as pool:
            parts = list(pool.map(_of_readings, at.trackings, *zip(*sums, strict=True)))
        return np.array([float(parts[n][rows].sum()) for n, rows in at.blocks])

    def _all(self, acting: Sequence[Effect], last: Effect | None) -> Iterator[Effect]:
        """In the order of the regression's columns."""
        yield from acting
        yield from (effect for _, effect in background(self.at.trackings, self.at.ports))
        yield from [last] if last else []


def _of_readings(t: Tracking, psi: Array, direct: Array) -> Array:
    """Log likelihood of each sample, (n,), when what is known is taken off and the latent forces have its rest."""
    steps, found = t.tracked.steps, t.tracked.filtered
    alone = replace(found, K=np.zeros_like(found.K), precision=(found.precision > 0).astype(float))
    explained = respond(steps, alone, psi[:, :, None], direct[:, :, None])[:, :, 0]
    tracked = replace(t.tracked, steps=replace(steps, r=steps.r - explained))
    estimator = t.estimator
    for _ in range(ROUNDS):
        estimator = estimator.resized(tracked, slice(None))
    p, e = (getattr(estimator.refilter(tracked).filtered, name) for name in ("precision", "e"))
    return np.asarray(0.5 * np.sum(np.log(p, where=p > 0, out=np.zeros_like(p)) - p * e**2, axis=1))
