"""A hypothesis at its best point, and what that says of every number in it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.estimation.effects import Coordinate
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.problem import Run, Simulated, Vector
from cobot_joint.diagnosis.findings import Estimate

Stretches = NDArray[np.intp]
NORMAL = 1.96  # sigma of a 95 % interval
UNKNOWN = 1e-8  # of what a direction's columns differ by, that is counted where they may be off by as much
AT_BOUND = 1e-6  # of a natural step, within which a coordinate is at its bound
STRAINED, FEWEST = 0.25, 3  # share of the base parameters, and how many, that end at the ends of their tolerances: the
# repaired systems of the 72 campaigns of proof/ and ../shared/recordings/field/open have 3 of 19 there at most


@dataclass
class Fit:
    """A hypothesis at its best point."""

    hypothesis: Hypothesis
    x: Vector
    chi2: float  # of the whitened residual
    residual: Vector  # (rows,)
    simulated: Simulated
    jacobian: Vector  # d(simulated)/dx, (rows, len(x))
    steps: int
    errors: Vector | None = None  # length of what each column may be off by, (len(x),); None: as good as 0

    @property
    def cost(self) -> float:
        """chi-square and prior"""
        base = len(self.hypothesis.base)
        return self.chi2 + float(np.sum(self.hypothesis.prior[:base] * self.x[:base] ** 2))

    @property
    def run(self) -> Run:
        """The simulation at the best point."""
        return self.hypothesis.run(self.x)

    def covariance(self, stretches: Stretches | None = None) -> Vector:
        """Of x, everything else free (the marginal one), for unit noise: (len(x), len(x))

        stretches: number of each row's, (rows,), where more than noise is left: wider, as their residuals say, but no
        wider than the prior alone.
        """
        prior = self.hypothesis.prior
        white = marginal_covariance(self.jacobian, prior, self.errors)
        if stretches is None:
            return white
        wide = widened(white, self.jacobian, self.residual, stretches)
        within = np.sqrt(np.minimum(1.0, 1.0 / np.maximum(prior * np.diag(wide), 1e-300)))
        return np.asarray(wide * np.outer(within, within))

    def settled(self) -> Fit:
        """The same fit, its effects' coordinates counted from what was found."""
        hypothesis = self.hypothesis.settled(self.x)
        old, new = self.hypothesis.coordinates, hypothesis.coordinates
        grown = [b.scale / a.scale if a.kind in ("linear", "cos", "sin") and a.scale > 0 else 1.0
                 for a, b in zip(old, new, strict=True)]  # fmt: skip
        x, base = hypothesis.start(), len(hypothesis.base)
        x[:base] = self.x[:base]
        return replace(self, hypothesis=hypothesis, x=x, jacobian=self.jacobian * np.array(grown))

    def interval(self, k: int, stretches: Stretches | None = None) -> tuple[float, float]:
        """95 % of coordinate k in its own unit, everything else free. stretches: see covariance."""
        c = self.hypothesis.coordinates[k]
        return _interval(c, c.start + c.scale * float(self.x[k]), _sigma(self.covariance(stretches), k))

    def is_none(self, amplitudes: Collection[str], stretches: Stretches | None = None) -> bool:
        """Whether a common factor of some terms' amplitudes may be 0 by its 95 % interval, all else free.

        Of terms that act alike their sum may be known where each alone is not (Wald 1943, Trans. Amer. Math. Soc. 54).
        """
        k = [k for k, c in enumerate(self.hypothesis.coordinates) if c.names[0] in amplitudes]
        C = self.covariance(stretches)[np.ix_(k, k)]
        return bool(self.x[k] @ np.linalg.pinv(C, hermitian=True) @ self.x[k] <= NORMAL**2)

    def estimates(self, units: Mapping[str, str], stretches: Stretches | None = None) -> dict[str, Estimate]:
        """Every parameter that the fit moved or set, with its 95 % interval.

        units: parameter -> unit of measure. stretches: see covariance.
        """
        covariance, values = self.covariance(stretches), self.run.values
        found: dict[str, Estimate] = {}
        for k, c in enumerate(self.hypothesis.coordinates):
            name = c.names[0]
            if c.kind == "sin" or name not in values:  # a signal at a port is no parameter
                continue
            interval = _interval(c, values[name], _sigma(covariance, k))
            if c.kind == "cos":
                interval, phase = _polar(c, self.x[k : k + 2], covariance[k : k + 2, k : k + 2])
                found[c.names[1]] = Estimate(values[c.names[1]], "rad", phase)
            found[name] = Estimate(values[name], units.get(name, "1"), interval, self._at(k))
        for name, value in values.items():
            found.setdefault(name, Estimate(value, units.get(name, "1"), (value, value)))
        return found

    @property
    def units_at_bounds(self) -> set[str]:
        """Components whose terms have a value that ends at what it may be."""
        coordinates = enumerate(self.hypothesis.coordinates)
        return {c.component for k, c in coordinates if c.kind != "base" and self._at(k)}

    def is_strained(self, stretches: Stretches | None) -> bool:
        """Whether so many base parameters end at the ends of their tolerances that the machine is no healthy one."""
        return len(self.at_ends(stretches)) >= max(FEWEST, STRAINED * len(self.hypothesis.base))

    def at_ends(self, stretches: Stretches | None) -> list[str]:
        """Base parameters that are at an end of their tolerance.

        One whose interval is as wide as its tolerance may end anywhere. stretches: see covariance.
        """
        covariance, found = self.covariance(stretches), []
        for k, c in enumerate(self.hypothesis.coordinates[: len(self.hypothesis.base)]):
            if self._at(k) and NORMAL * _sigma(covariance, k) < (c.upper - c.lower) / 2:
                found.append(c.names[0])
        return found

    def _at(self, k: int) -> Literal["lower", "upper"] | None:
        """The bound at which coordinate k is."""
        c = self.hypothesis.coordinates[k]
        return "lower" if self.x[k] <= c.lower + AT_BOUND else "upper" if self.x[k] >= c.upper - AT_BOUND else None


def marginal_covariance(jacobian: Vector, prior: Vector, errors: Vector | None = None) -> Vector:
    """Covariance of linear least squares' coordinates, each with all others free, for unit noise: (k, k)

    The inverse of J'J + diag(prior); a block of it is the inverse of the Schur complement of the other coordinates.
    jacobian: (rows, k). prior: (k,), weights of the coordinates' squares. errors: see Fit; a direction along which the
    columns differ by no more is unknown but for the prior (errors in variables: Fuller, W. A. (1987), Measurement Error
    Models, section 2.2).
    """
    gram = jacobian.T @ jacobian
    if errors is not None:
        size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        shares, directions = np.linalg.eigh(gram / np.outer(size, size))
        false = (directions**2).T @ (errors / size) ** 2
        known = np.maximum(shares - false, UNKNOWN * np.maximum(shares, 0.0))
        gram = (directions * known) @ directions.T * np.outer(size, size)
    gram = gram + np.diag(prior)
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return np.asarray(np.linalg.pinv(gram / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale))


def widened(white: Vector, jacobian: Vector, residual: Vector, stretches: Stretches) -> Vector:
    """A covariance for unit noise where residuals are correlated within stretches of the rows: (k, k)

    The pull of every stretch counts once, however many rows it has (Liang and Zeger 1986, Biometrika 73(1)). Never
    narrower than for noise alone. white: (k, k), jacobian: (rows, k), residual: (rows,), stretches: (rows,), from 0.
    """
    if not len(white):  # nothing was fitted
        return white
    pulls = np.stack([np.bincount(stretches, column * residual) for column in jacobian.T], axis=1)
    pulls = pulls - pulls.mean(axis=0)  # what pulls against a bound pulls everywhere
    count = len(pulls)
    spread = np.diag(white @ (pulls.T @ pulls * (count / max(count - 1, 1))) @ white)
    wider = np.sqrt(np.maximum(spread / np.maximum(np.diag(white), 1e-300), 1.0))
    return np.asarray(white * np.outer(wider, wider))


def _sigma(covariance: Vector, k: int) -> float:
    return float(np.sqrt(max(covariance[k, k], 0.0)))


def _interval(c: Coordinate, value: float, sigma: float) -> tuple[float, float]:
    """95 % about a value whose coordinate has that standard deviation."""
    if c.kind == "log":
        grow = float(np.exp(min(NORMAL * sigma, 50.0)))
        return value / grow, value * grow
    return value - NORMAL * c.scale * sigma, value + NORMAL * c.scale * sigma


def _polar(c: Coordinate, x: Vector, covariance: Vector) -> tuple[tuple[float, float], tuple[float, float]]:
    """95 % of amplitude and phase of a cosine and a sine part x, to first order. covariance: (2, 2)"""
    amplitude, phase = float(np.hypot(x[0], x[1])), float(np.arctan2(x[1], x[0]))
    along = x / amplitude if amplitude > 0 else np.array([1.0, 0.0])
    across = np.array([-along[1], along[0]])
    radial, tangential = (NORMAL * float(np.sqrt(max(float(u @ covariance @ u), 0.0))) for u in (along, across))
    turn = min(tangential / amplitude, np.pi) if amplitude > 0 else np.pi
    return (c.scale * (amplitude - radial), c.scale * (amplitude + radial)), (phase - turn, phase + turn)
