"""The score test: what every switched-off term would take from the residual, re-fittable parameters projected out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.candidates.columns import Column
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import bounded_step
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.estimation.projection import solve
from cobot_joint.diagnosis.plant.plant import TermCandidate

SEGMENTS = 16  # of a run; an effect may set in at each of their borders


@dataclass(frozen=True)
class Score:
    """What one term would take away at its best shape and onset, all that is re-fittable re-fitted (linearly)."""

    term: TermCandidate
    gain: float
    values: Mapping[str, float]  # amplitude, phase, shapes
    onset: float | None
    column: Column = field(repr=False)

    @property
    def active(self) -> ActiveTerm:
        """The term switched on as the score test would have it."""
        return ActiveTerm(self.term, self.values, self.onset)

    @property
    def effects(self) -> tuple[ActiveTerm]:
        """Where a fit of it would start."""
        return (self.active,)


def scores(problem: Problem, fit: Fit, columns: Sequence[Column]) -> list[Score]:
    """Best first, one per term."""
    return ScoreTest(problem, fit, columns).rank(fit.residual)


class ScoreTest:
    """Gram matrices of a fit's Jacobian and the terms' columns per segment of the runs; they serve any residual."""

    def __init__(self, problem: Problem, fit: Fit, columns: Sequence[Column]) -> None:
        self.columns = columns
        self.onsets, self.samples = problem.onsets, problem.samples
        self.x = fit.x
        coordinates = fit.hypothesis.coordinates
        self.prior = fit.hypothesis.prior
        self.lower = np.array([c.lower for c in coordinates]) - fit.x
        self.upper = np.array([c.upper for c in coordinates]) - fit.x
        duration = float(problem.times().max())
        self.width = duration / SEGMENTS
        segment = np.minimum((problem.times() / (duration + 1e-9) * SEGMENTS).astype(int), SEGMENTS - 1)
        self.rows = [np.flatnonzero(segment == k) for k in range(SEGMENTS)]
        stacked = np.column_stack([fit.jacobian, *(v for c in columns for v in c.vectors)])
        self.parts = [stacked[rows] for rows in self.rows]
        self.grams = np.zeros((SEGMENTS, stacked.shape[1] + 1, stacked.shape[1] + 1))  # row and column 0: the residual
        for gram, part in zip(self.grams, self.parts, strict=True):
            gram[1:, 1:] = part.T @ part

    def rank(self, residual: Vector) -> list[Score]:
        """Best first, one per term."""
        for gram, part, rows in zip(self.grams, self.parts, self.rows, strict=True):
            gram[0, 1:] = gram[1:, 0] = part.T @ residual[rows]
        whole, base, above = self.grams.sum(axis=0), len(self.x), float(residual @ residual) - self.samples
        settled = self._settled(whole[: base + 1, : base + 1])
        best: dict[str, Score] = {}
        at = base + 1
        for column in self.columns:
            own = np.arange(at, at + len(column.vectors))
            at += len(own)
            for window, active in _windows(column.term, self.grams, self.width, self.onsets):
                gain, amplitude = settled.gain(whole, active, own)
                if window is not None and not column.term.episode:
                    gain -= max(thresholds.LATER, thresholds.WORTH * (above - gain))
                score = _score(column, amplitude, gain, window, self.width)
                if score and (column.term.name not in best or gain > best[column.term.name].gain):
                    best[column.term.name] = score
        return sorted(best.values(), key=lambda s: -s.gain)

    def _settled(self, gram: Vector) -> _Settled:
        """gram: of the residual and the fit's own columns."""
        step, decrease = bounded_step(
            gram[1:, 1:] + np.diag(self.prior), gram[1:, 0] - self.prior * self.x, self.lower, self.upper
        )
        free = (step > self.lower + 1e-9) & (step < self.upper - 1e-9)
        return _Settled(1 + np.flatnonzero(free), self.prior[free], self.x[free], decrease)


@dataclass(frozen=True)
class _Settled:
    """Where the fit's own coordinates may go: those at a bound are held there, and project nothing out."""

    free: NDArray[np.intp]  # rows of a Gram matrix
    prior: Vector
    x: Vector
    decrease: float  # of the cost, by a re-fit alone

    def gain(self, whole: Vector, active: Vector, own: NDArray[np.intp]) -> tuple[float, Vector]:
        """Decrease of the cost beyond what a re-fit alone brings, and the amplitudes of columns `own`.

        whole, active: Gram matrices over all the time, and over that in which the term acts.
        """
        free, k = np.concatenate([self.free, own]), len(own)
        gram, gradient = whole[np.ix_(free, free)].copy(), whole[free, 0].copy()
        gram[-k:, :] = active[np.ix_(own, free)]
        gram[:, -k:] = active[np.ix_(free, own)]
        gradient[-k:] = active[own, 0]
        base = len(self.prior)
        gram[:base, :base] += np.diag(self.prior)
        gradient[:base] -= self.prior * self.x
        step = solve(gram, gradient)
        return float(gradient @ step) - self.decrease, step[-k:]


def _windows(
    term: TermCandidate, grams: Vector, width: float, onsets: bool
) -> Iterator[tuple[tuple[float, float] | None, Vector]]:
    """((from, to), Gram matrix over that time); None: always. A term with a from and a to is scanned as windows."""
    if term.episode:
        for length in (1, 2, 4):
            for start in range(SEGMENTS - length + 1):
                yield (start * width, (start + length) * width), grams[start : start + length].sum(axis=0)
        return
    later = np.cumsum(grams[::-1], axis=0)[::-1]
    yield None, later[0]
    for start in range(1, SEGMENTS - 1) if onsets else ():
        yield (start * width, np.inf), later[start]


def _score(
    column: Column, amplitude: Vector, gain: float, window: tuple[float, float] | None, width: float
) -> Score | None:
    """None: the amplitude has the wrong sign."""
    term, values = column.term, dict(column.shape)
    if term.phase:
        values[term.amplitude] = float(np.hypot(*amplitude))
        values[term.phase] = float(np.arctan2(amplitude[1], amplitude[0]))
    else:
        values[term.amplitude] = float(np.clip(term.neutral + amplitude[0], term.lower, term.upper))
        if values[term.amplitude] != term.neutral + amplitude[0] and abs(
            values[term.amplitude] - term.neutral
        ) < 1e-3 * abs(amplitude[0]):
            return None
    if term.episode and window:
        values |= dict(zip(term.episode, (window[0], window[1] - window[0]), strict=True))
        return Score(term, gain, values, None, column)
    return Score(term, gain, values, window[0] if window else None, column)
