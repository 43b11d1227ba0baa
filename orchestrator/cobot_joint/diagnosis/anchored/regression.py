"""Bayesian linear regression on white innovations, its groups' variances estimated: what is beside what.

    e = X beta + white noise,  beta ~ N(centre, 1/precision);  groups: one variance each, the most likely one

Evidence and the groups' variances: MacKay 1992, Neural Computation 4(3), "Bayesian interpolation".
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Parts = Sequence[Sequence[int]]  # numbers of blocks that are left out together
ROUNDS = 40  # of re-estimating the groups' variances; a term's own few, from where they are
FEW = 12
OWN = 1e-6  # of a column's square that is its own beside the others: less is rounding
SMALLEST = 1e-30
LEAST = 1e-3  # coefficients that the data decide of a group that they say nothing of
ROUNDING = 1e-11
HELD = 1e-4  # sigma of the readings that a coefficient held at a value may still move


@dataclass(frozen=True)
class Columns:
    """Products of columns with one another and with the innovations, block by block of the recordings.

    gram: (blocks, k, k), gradient: (blocks, k).
    """

    gram: Array
    gradient: Array


@dataclass(frozen=True)
class Added:
    """Columns beside those of a regression: coefficients and covariance, (k,) and (k, k), everything else free.

    evidence: log of the ratio of marginal likelihoods, their prior as much as one reading says (Kass and Wasserman
    1995, J. Am. Stat. Assoc. 90). variances: of the groups beside them.
    """

    coefficients: Array
    covariance: Array
    evidence: float
    variances: Array


@dataclass(frozen=True)
class Products:
    """Of k more columns, block by block: gram: (blocks, k, k), cross: with a regression's, (blocks, columns, k),
    gradient: (blocks, k)."""

    gram: Array
    cross: Array
    gradient: Array

    def __getitem__(self, own: slice) -> Products:
        """Some of the columns."""
        return Products(self.gram[:, own, own], self.cross[:, :, own], self.gradient[:, own])


@dataclass
class Regression:
    """readings: how many innovations there are. precision, centre: (k,) of the first columns; groups: of the others,
    consecutive, by size."""

    columns: Columns
    precision: Array
    centre: Array
    groups: Sequence[int]
    readings: int
    variances: Array = field(init=False)  # (groups,)
    theta: Array = field(init=False)
    covariance: Array = field(init=False)
    evidence: float = field(init=False)  # log of the marginal likelihood over that of white noise alone

    def __post_init__(self) -> None:
        self.first = len(self.precision)
        self.places = [slice(e - n, e) for n, e in zip(self.groups, self.first + np.cumsum(self.groups), strict=True)]
        self.gram, self.gradient = self.columns.gram.sum(axis=0), self.columns.gradient.sum(axis=0)
        size = np.diag(self.gram)
        self.variances = np.array([self.readings * 4e-4 / max(float(size[p].mean()), SMALLEST) for p in self.places])
        self.variances = self._estimated(self.variances, self.gram, self.gradient, 0, ROUNDS)
        self.evidence = self._evidence(self.variances, self.gram, self.gradient, 0)
        self.theta, self.covariance = self._solved(self.variances, self.gram, self.gradient, 0)

    @property
    def by_block(self) -> Array:
        """Log likelihood over that of no signal, as fitted: (blocks,)"""
        pairs = zip(self.columns.gram, self.columns.gradient, strict=True)
        return np.array([_likelihood(self.theta, gram, gradient) for gram, gradient in pairs])

    @property
    def price(self) -> float:
        """What the freedom of the coefficients costs, in nats, negative."""
        return self.evidence - float(self.by_block.sum())

    def gain(self, more: Products) -> float:
        """Log likelihood that more columns add, the groups' variances as they are; 0: they say nothing of their own."""
        own = self._own(more)
        if own is None:
            return 0.0
        pull = more.gradient.sum(axis=0) - more.cross.sum(axis=0).T @ self.theta
        return float(0.5 * pull @ np.linalg.solve(own, pull))

    def added(self, more: Products) -> Added | None:
        """With more columns, the groups' variances estimated again beside them. None: they say nothing of their own."""
        own = self._own(more)
        if own is None:
            return None
        k = len(own)
        across = more.cross.sum(axis=0)
        wide = np.block([[self.gram, across], [across.T, more.gram.sum(axis=0)]])
        g = np.concatenate([self.gradient, more.gradient.sum(axis=0)])
        prior = np.diag(own) / self.readings  # as much as one reading says
        variances = self._estimated(self.variances, wide, g, k, FEW)
        theta, covariance = self._solved(variances, wide, g, k, prior)
        evidence = self._evidence(variances, wide, g, k, prior) - self.evidence
        return Added(theta[-k:], covariance[-k:, -k:], evidence, variances)

    def predicted(self, more: Products, variances: Array, parts: Parts) -> Array:
        """Log of the predictive density that the columns add to each part, given the others: (parts,)

        p(part | others) = p(all) / p(others), the groups' variances held. What the others leave uncertain counts: a
        recording that says nothing of a coefficient predicts nothing of it either.
        """
        k, found = more.gradient.shape[1], []
        wide = np.concatenate([np.concatenate([self.columns.gram, more.cross], axis=2),
                               np.concatenate([more.cross.transpose(0, 2, 1), more.gram], axis=2)], axis=1)  # fmt: skip
        g = np.concatenate([self.columns.gradient, more.gradient], axis=1)
        total, pull, own = wide.sum(axis=0), g.sum(axis=0), self._own(more)
        prior = np.diag(total[-k:, -k:] if own is None else own) / self.readings

        def adds(gram: Array, gradient: Array) -> float:
            beside = self._evidence(variances, gram, gradient, k, prior)
            return beside - self._evidence(self.variances, gram[:-k, :-k], gradient[:-k], 0)

        in_all = adds(total, pull)
        for part in parts:
            gram, gradient = wide[part].sum(axis=0), g[part].sum(axis=0)
            found.append(in_all - adds(total - gram, pull - gradient))
        return np.array(found)

    def predicted_free(self, k: int, bound: float, parts: Parts) -> Array:
        """Log of the predictive density that coefficient k adds to each part, given the others, where it is free rather
        than held at a bound: (parts,). 0: the others do not press against the bound, from where it lies."""
        found, total, pull = [], self.columns.gram.sum(axis=0), self.columns.gradient.sum(axis=0)
        side, held = np.sign(self.theta[k] - bound), self._held(k, bound, float(total[k, k]))
        in_all = self._over(held, total, pull)
        for part in parts:
            others = total - self.columns.gram[part].sum(axis=0)
            rest = pull - self.columns.gradient[part].sum(axis=0)
            free, _ = self._solved(self.variances, others, rest, 0)
            presses = side * (free[k] - bound) > 0
            found.append(in_all - self._over(held, others, rest) if presses else 0.0)
        return np.array(found)

    def _held(self, k: int, bound: float, size: float) -> Regression:
        """The same with coefficient k known to be at a bound. size: its column's square."""
        held, among = copy(self), np.arange(self.first) == k
        held.precision = np.where(among, max(size, SMALLEST) / HELD**2, self.precision)
        held.centre = np.where(among, bound, self.centre)
        return held

    def _over(self, other: Regression, gram: Array, gradient: Array) -> float:
        """How much more likely such data are here than with the other's prior."""
        own, its = (each._evidence(each.variances, gram, gradient, 0) for each in (self, other))
        return own - its

    def _own(self, more: Products) -> Array | None:
        """What of the columns' products no other column can stand in for; None: nothing but rounding, or one of them
        stands in for another: a wave's sine and cosine, over an angle that rests."""
        total, across = more.gram.sum(axis=0), more.cross.sum(axis=0)
        own = total - across.T @ self.covariance @ across
        if np.min(np.diag(total)) <= 0 or np.min(np.diag(own) / np.diag(total)) <= OWN:
            return None
        scale = 1 / np.sqrt(np.diag(own))
        alone = float(np.linalg.eigvalsh((own + own.T) / 2 * scale * scale[:, None])[0])
        return np.asarray((own + own.T) / 2) if alone > OWN else None

    def _precision(self, variances: Array, more: int, prior: Array | None = None) -> Array:
        of_groups = np.repeat(1 / np.maximum(variances, SMALLEST), self.groups)
        return np.concatenate([self.precision, of_groups, np.zeros(more) if prior is None else prior])

    def _centre(self, n: int) -> Array:
        return np.concatenate([self.centre, np.zeros(n - self.first)])

    def _solved(
        self, variances: Array, gram: Array, gradient: Array, more: int, prior: Array | None = None
    ) -> tuple[Array, Array]:
        precision = self._precision(variances, more, prior)
        covariance = _inverse(gram + np.diag(precision))
        return covariance @ (gradient + precision * self._centre(len(precision))), covariance

    def _estimated(self, variances: Array, gram: Array, gradient: Array, more: int, rounds: int) -> Array:
        for _ in range(rounds):
            theta, covariance = self._solved(variances, gram, gradient, more)
            spread = np.diag(covariance)
            variances = np.array([
                _variance(theta[p], spread[p] / variance) for p, variance in zip(self.places, variances, strict=True)
            ])  # fmt: skip
        return variances

    def _evidence(self, variances: Array, gram: Array, gradient: Array, more: int, prior: Array | None = None) -> float:
        precision = self._precision(variances, more, prior)
        centre = self._centre(len(precision))
        theta, _ = self._solved(variances, gram, gradient, more, prior)
        fit = 2 * gradient @ theta - theta @ gram @ theta - precision @ (theta - centre) ** 2
        scale = 1 / np.sqrt(np.maximum(precision, SMALLEST))
        volume = np.linalg.slogdet(np.eye(len(precision)) + scale[:, None] * gram * scale)[1]
        return float(0.5 * fit - 0.5 * volume)


def _variance(theta: Array, undecided: Array) -> float:
    """MacKay's: the coefficients' squares over how many of them the data decide. undecided: share of each one's
    variance that the data leave."""
    decided = float(np.sum(1 - np.clip(undecided, 0.0, 1.0)))
    return max(float(theta @ theta) / max(decided, LEAST), SMALLEST)


def _likelihood(theta: Array, gram: Array, gradient: Array) -> float:
    """Log likelihood over that of no signal."""
    return float(gradient @ theta - 0.5 * theta @ gram @ theta)


def _inverse(A: Array) -> Array:
    """Of a positive definite matrix whose diagonal spans many decades; what rounding left of a direction is nothing."""
    scale = 1 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    return np.asarray(np.linalg.inv(A * scale * scale[:, None] + ROUNDING * np.eye(len(A))) * scale * scale[:, None])
