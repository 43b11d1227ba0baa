"""Linear least squares beside a fit: what further columns would take, everything that was fitted re-fitted beside them.

The columns compete after the fit's own Jacobian is projected out of them (Frisch and Waugh 1933; variable projection,
Golub and Pereyra 1973, SIAM J. Numer. Anal. 10(2)), base parameters held by their prior.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import bounded_step
from cobot_joint.diagnosis.estimation.problem import Vector

SINGULAR = 1e-9  # of the largest singular value of a scaled Gram matrix, below which a direction is not seen


def solve(gram: Vector, gradient: Vector) -> Vector:
    """Least-squares solution of gram @ x = gradient, (k,), whatever the units of its coordinates."""
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return np.asarray(np.linalg.lstsq(gram / np.outer(scale, scale), gradient / scale, rcond=SINGULAR)[0] / scale)


class Projection:
    """Of a fit's residual over its own Jacobian and further columns, (rows,) each."""

    def __init__(self, start: Fit, columns: Sequence[Vector]) -> None:
        self.base = start.jacobian.shape[1]
        stacked = np.column_stack([start.residual, start.jacobian, *columns])
        self.gram = stacked.T @ stacked
        self.prior, self.x = start.hypothesis.prior, start.x
        coordinates = start.hypothesis.coordinates
        self.lower = np.array([c.lower for c in coordinates]) - self.x
        self.upper = np.array([c.upper for c in coordinates]) - self.x
        self.nothing, _ = self._decrease([])

    def gain(self, chosen: Sequence[int], penalty: Vector | None = None) -> tuple[float, Vector]:
        """(chi-square that these columns take beyond what a re-fit does, their coefficients), all that was fitted
        inside its bounds. penalty: added to their Gram matrix, (k, k)."""
        total, coefficients = self._decrease(chosen, penalty)
        return total - self.nothing, coefficients

    def gain_beyond_bounds(self, chosen: Sequence[int]) -> tuple[float, Vector]:
        """The same beyond what a re-fit does wherever its bounds are: where a wrong data sheet would do as well, little
        is left to take."""
        (nothing, _), (total, step) = self._free([]), self._free(chosen)
        return total - nothing, step[self.base :]

    @property
    def together(self) -> float:
        """Chi-square that all columns take with all that was fitted, wherever its bounds are."""
        return self._free(range(len(self.gram) - 1 - self.base))[0]

    @property
    def inside(self) -> float:
        """The same inside the bounds."""
        return self._decrease(range(len(self.gram) - 1 - self.base))[0]

    def _normal(self, chosen: Sequence[int]) -> tuple[Vector, Vector]:
        """Gram matrix and gradient of all that was fitted, and of these columns."""
        base = self.base
        use = np.concatenate([np.arange(1, base + 1), base + 1 + np.array(chosen, dtype=int)]).astype(int)
        G, g = self.gram[np.ix_(use, use)].copy(), self.gram[use, 0].copy()
        G[:base, :base] += np.diag(self.prior)
        g[:base] -= self.prior * self.x
        return G, g

    def _free(self, chosen: Sequence[int]) -> tuple[float, Vector]:
        G, g = self._normal(chosen)
        step = solve(G, g)
        return float(2 * g @ step - step @ G @ step), step

    def _decrease(self, chosen: Sequence[int], penalty: Vector | None = None) -> tuple[float, Vector]:
        G, g = self._normal(chosen)
        held = G.copy()
        if penalty is not None:
            held[self.base :, self.base :] += penalty
        step = solve(held, g)
        own = step[: self.base]
        if np.any(own < self.lower) or np.any(own > self.upper):
            free = np.full(len(g) - self.base, np.inf)
            step, _ = bounded_step(held, g, np.append(self.lower, -free), np.append(self.upper, free))
        return float(2 * g @ step - step @ G @ step), step[self.base :]
