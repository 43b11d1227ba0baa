"""One point of the search: everything linear about the recorded motion, and what a term adds to it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.anchored.background import Group, Of, background
from cobot_joint.diagnosis.anchored.orders import clearest_orders
from cobot_joint.diagnosis.anchored.regression import Added, Columns, Products, Regression
from cobot_joint.diagnosis.plant.at_once import at_once
from cobot_joint.diagnosis.plant.plant import Port, TermCandidate
from cobot_joint.diagnosis.state_estimation.evidence import TOGETHER, Effect, Evidence, Tracking, combinations
from cobot_joint.diagnosis.state_estimation.native.kalman import respond

Array = NDArray[np.float64]
Shapes = Mapping[str, float]
BLOCKS = 4  # of each recording, left out in turn
MANY = 10  # combinations of a wave's shapes from which on a stretch of the recordings is scanned first
STRETCH = 2.0  # s of each recording, where it moves most
FEW = 3  # shapes that are then tried on all of it
LOOSE = 1e-12  # precision of what may have any size
FAR = 5.99  # sigma of an innovation, as kalman.c limits it
STEPS = 12  # onsets that are tried
SILENT = 1e-3  # nats, below which a recording says nothing of an effect
LOST = 0.005  # of the samples, from which on a filter has lost its way in a recording
WORSE = 2.0  # times as many, from which on one tells less than another
NEAR = 10  # samples about one that the filter could not follow, which say nothing either


@dataclass(frozen=True)
class Candidate:
    """A switched-off term beside everything else.

    values: `component.variable`, as it would be switched on; onset: s, None: from the start. added: its one or two
    columns; evidence: of these, less the logarithm of how many shapes and onsets were tried.
    by_runs: its answer is the difference of two runs.
    """

    term: TermCandidate
    values: Mapping[str, float]
    onset: float | None
    added: Added
    evidence: float
    effect: Effect
    by_runs: bool = False


@dataclass(frozen=True)
class Predicted:
    """Log likelihood that something adds to parts that it was not fitted to: (blocks,), (recordings,) or none of one.

    What repeats in time by chance, such as a drift, predicts other parts of its own recording, and no other recording.
    recordings: those that the filter could follow; where it lost its way, it may be for want of what is judged.
    """

    blocks: Array
    recordings: Array

    @property
    def worth(self) -> float:
        """In all: of blocks as far as it does not hang on one, or of recordings, if that is less; of the one that is
        worst predicted, if it contradicts the others. Where one recording alone answers, no other could have told.
        """
        blocks, acts = trimmed_sum(self.blocks), np.abs(self.recordings) > SILENT
        if acts.sum() < 2:
            return blocks
        worst = float(self.recordings.min())
        contradicts = worst < -thresholds.ANCHORED_ALIKE
        return worst if contradicts else min(blocks, float(self.recordings.sum()))


class Beside:
    """Recordings followed with the same values: a regression of the innovations on free parameters and the background.

    free: `component.parameter` -> (most likely value less the one it has now, 1 sigma that it may be off). linear:
    effects that act as well, and that the values do not have.
    """

    def __init__(
        self,
        trackings: Sequence[Tracking],
        free: Mapping[str, tuple[float, float]],
        ports: Sequence[Port],
        linear: Sequence[Effect] = (),
    ) -> None:
        self.trackings, self._ports = list(trackings), ports
        self.evidence = Evidence(trackings, free)
        self.names = self.evidence.parameters
        self._weight = [_followed(t) for t in self.trackings]
        self.background: list[Group] = []
        parts: list[tuple[int, Of]] = [(e.direct[0].shape[2], e.of) for e in (self.evidence.base, *linear)]
        for group, of in background(trackings, ports):
            self.background.append(group)
            parts.append((group.count, of))
        self._X = self._whites(parts)
        self._e = [t.tracked.filtered.white[:, :, None] * w for t, w in zip(self.trackings, self._weight, strict=True)]
        self.blocks = [(n, rows) for n, t in enumerate(self.trackings)
                        for rows in _quarters(len(t.tracked.time))]  # fmt: skip
        own = Columns(self._sums(self._X, self._X), self._sums(self._X, self._e)[:, :, 0])
        acting = sum(e.direct[0].shape[2] for e in linear)
        precision = np.concatenate([[1 / free[name][1] ** 2 for name in self.names], np.full(acting, LOOSE)])
        centre = np.concatenate([[free[name][0] for name in self.names], np.zeros(acting)])
        readings = sum(
            int((w[:, 0] * (t.tracked.filtered.precision > 0)).sum())
            for t, w in zip(self.trackings, self._weight, strict=True)
        )
        groups = [group.count for group in self.background]
        self.regression = Regression(own, precision, centre, groups, readings)
        self._scan: Evidence | None = None
        self._asking = threading.Lock()

    def gain_over(self, other: Beside) -> float:
        """How much more likely the same recordings are here than there: of their blocks all but the best and worst."""
        return self.regression.price - other.regression.price + trimmed_sum(self._more_than(other))

    def doubt_over(self, other: Beside) -> float:
        """1 sigma of `gain_over`, as its blocks differ among themselves: where a filter is lost in impacts, one motion
        followed twice, from slightly other values, may be hundreds of nats more likely in a block, or less."""
        return trimmed_sigma(self._more_than(other))

    def _more_than(self, other: Beside) -> Array:
        """By block, in those recordings in which neither filter loses its way, as where an output rattles in its gap
        (where that is so in all, those in which it is hardly worse than in the best)."""
        here, there = ({t.tracked.recording.name: _lost(t) for t in each.trackings} for each in (self, other))
        lost = {name: max(here[name], there[name]) for name in here.keys() & there.keys()}
        best = min(lost.values(), default=0.0)
        most = LOST if best < LOST else WORSE * best
        both = {name for name, share in lost.items() if share < most}
        return self._by_block(both) - other._by_block(both)

    def _by_block(self, recordings: Collection[str]) -> Array:
        """Log likelihood of these recordings' innovations, parameters and background as fitted, but for a constant:
        (blocks,)"""
        found = []
        for (number, rows), fitted in zip(self.blocks, self.regression.by_block, strict=True):
            tracked = self.trackings[number].tracked
            if tracked.recording.name in recordings:
                p, e = tracked.filtered.precision[rows], tracked.filtered.e[rows]
                logarithm = np.log(p, where=p > 0, out=np.zeros_like(p))
                found.append(0.5 * float(np.sum(logarithm - p * e**2)) + fitted)
        return np.array(found)

    def where(self, predicted: Array) -> dict[str, object]:
        """The recording and the part of it whose likelihood a term raises most: (blocks,)"""
        number, rows = self.blocks[int(np.argmax(predicted))]
        tracked = self.trackings[number].tracked
        span = [float(tracked.time[rows.start]), float(tracked.time[rows.stop - 1])]
        return {"recording": tracked.recording.name, "by_regime": [], "time": span}

    @property
    def corrections(self) -> dict[str, tuple[float, float]]:
        """`component.parameter` -> by how much it is off, most likely, and 1 sigma of that."""
        theta, sigma = self.regression.theta, np.sqrt(np.diag(self.regression.covariance))
        return {name: (float(theta[k]), float(sigma[k])) for k, name in enumerate(self.names)}

    def candidate(self, term: TermCandidate) -> Candidate | None:
        """The term with the shapes that do best; None: no recording answers to it."""
        clearest = clearest_orders(term, self.trackings, self._ports, [e[:, :, 0] for e in self._e])
        every = list(combinations(term))
        beyond = [shapes for shapes in clearest if shapes not in every]
        some = self._shortlist(term, every) if term.phase is not None and len(every) > MANY else every
        some = [*some, *(shapes for shapes in clearest if shapes not in some)]
        return self.best(term, some, len(every) + len(beyond), lambda shapes: self.evidence.of_term(term, shapes))

    def best(
        self, term: TermCandidate, some: Sequence[Shapes], tried: int, of: Callable[[Sequence[Shapes]], Effect]
    ) -> Candidate | None:
        """With those of some shapes that do best. tried: how many there were. of: a unit of the term with shapes, one
        column each, or two of a wave."""
        width = 1 if term.phase is None else 2
        best: tuple[float, Shapes, Products, Effect] | None = None
        for first in range(0, len(some), TOGETHER):
            shapes = some[first : first + TOGETHER]
            effect = of(shapes)
            more = self._products(self._white(effect))
            for k, shape in enumerate(shapes):
                own = slice(k * width, (k + 1) * width)
                gain = self.regression.gain(more[own])
                if gain > (best[0] if best else 0.0):
                    best = gain, shape, more[own], effect[own]
        added = self.regression.added(best[2]) if best else None
        if best is None or added is None:
            return None
        values = _values(term, best[1], added.coefficients)
        return Candidate(term, values, None, added, added.evidence - float(np.log(tried)), best[3])

    def with_onset(self, found: Candidate, worth: float) -> Candidate:
        """From the time on from which it does best, if that is worth so much more than being there from the start."""
        last = max(float(t.tracked.time[-1]) for t in self.trackings)
        best, width = found, last / (STEPS + 2)
        for look in range(3):
            times = [] if best.onset is None else [best.onset + share * width for share in (-0.5, -0.25, 0.25, 0.5)]
            if look == 0:
                times = list(np.arange(1, STEPS + 1) * width)
            else:
                width /= 4
            if not times:
                continue
            count = len(found.added.coefficients)
            products = self._products(self._white(self._since(found.effect, times)))  # one pass over the recordings
            for k, t_0 in enumerate(times):
                own = slice(k * count, (k + 1) * count)
                added = self.regression.added(products[own])
                evidence = -np.inf if added is None else added.evidence - np.log(STEPS)
                if added is not None and evidence > best.evidence + (worth if best.onset is None else 0.0):
                    shapes = {s.name: float(found.values[s.name]) for s in found.term.shapes}
                    values = _values(found.term, shapes, added.coefficients)
                    best = Candidate(
                        found.term, values, float(t_0), added, float(evidence), found.effect, found.by_runs
                    )
        return best if best.onset is None else replace(best, effect=self._since(found.effect, [best.onset]))

    def predicted(self, found: Candidate) -> Predicted:
        """What it adds to parts that it was not fitted to."""
        more = self._products(self._white(found.effect))
        blocks, recordings = (self.regression.predicted(more, found.added.variances, each) for each in self._parts)
        followed = [x for x, t in zip(recordings.tolist(), self.trackings, strict=False) if _lost(t) < LOST]
        return Predicted(blocks, np.array(followed))

    def predicted_outside(self, name: str, bound: float) -> Predicted:
        """The same of a base parameter outside its tolerance, over being held at the bound, which is so much from the
        value that it has now."""
        k = self.names.index(name)
        blocks, recordings = (self.regression.predicted_free(k, bound, each) for each in self._parts)
        return Predicted(blocks, recordings)

    @property
    def _parts(self) -> tuple[list[list[int]], list[list[int]]]:
        """What is left out in turn: every block; every recording, of several."""
        numbers = range(len(self.blocks))
        by_recording = [[b for b in numbers if self.blocks[b][0] == n] for n in range(len(self.trackings))]
        return [[b] for b in numbers], by_recording if len(by_recording) > 1 else []

    def _since(self, effect: Effect, onsets: Sequence[float]) -> Effect:
        """The same from a time on, for each of some."""
        on = [[t.tracked.time >= onset for onset in onsets] for t in self.trackings]
        psi = [np.concatenate([p * m[1:, None, None] for m in of_one], axis=2)
               for p, of_one in zip(effect.psi, on, strict=True)]  # fmt: skip
        direct = [np.concatenate([d * m[:, None, None] for m in of_one], axis=2)
                  for d, of_one in zip(effect.direct, on, strict=True)]  # fmt: skip
        return Effect(psi, direct)

    def _shortlist(self, term: TermCandidate, every: Sequence[Mapping[str, float]]) -> Sequence[Mapping[str, float]]:
        """Those that do best on a stretch of each recording."""
        with self._asking:
            if self._scan is None:
                self._scan = Evidence([_stretch(t) for t in self.trackings], self.evidence.tolerances)
            scan = self._scan
        width = 2
        gains: list[float] = []
        for first in range(0, len(every), TOGETHER):
            some = every[first : first + TOGETHER]
            groups = [slice(k * width, (k + 1) * width) for k in range(len(some))]
            gains += [gain for _, _, gain in scan.gls(scan.of_term(term, some), groups)]
        return [every[k] for k in np.argsort(gains)[::-1][:FEW]]

    def _white(self, effect: Effect) -> list[Array]:
        """In the innovations: (n, channels, columns) per recording"""
        return self._whites([(effect.direct[0].shape[2], effect.of)])

    def _whites(self, parts: Sequence[tuple[int, Of]]) -> list[Array]:
        """The same of several, by their columns, side by side."""
        ends = np.cumsum([0, *(count for count, _ in parts)])

        def of_one(n: int) -> Array:
            tracked = self.trackings[n].tracked
            white = np.empty((*tracked.steps.r.shape, ends[-1]))
            for (_, of), (first, end) in zip(parts, pairwise(ends), strict=True):
                respond(tracked.steps, tracked.filtered, *of(n), white[:, :, first:end])
            white *= self._weight[n]
            return white

        return at_once(of_one, range(len(self.trackings)))

    def _products(self, white: Sequence[Array]) -> Products:
        return Products(self._sums(white, white), self._sums(self._X, white), self._sums(white, self._e)[:, :, 0])

    def _sums(self, a: Sequence[Array], b: Sequence[Array]) -> Array:
        """(blocks, columns of a, columns of b)"""

        def of_one(block: tuple[int, slice]) -> Array:
            n, rows = block
            return np.asarray(a[n][rows].reshape(-1, a[n].shape[2]).T @ b[n][rows].reshape(-1, b[n].shape[2]))

        return np.stack(at_once(of_one, self.blocks))


def trimmed_sum(blocks: Array) -> float:
    """Without the largest and the smallest."""
    return float(np.sort(blocks)[1:-1].sum())


def trimmed_sigma(blocks: Array) -> float:
    """1 sigma of `trimmed_sum`: that of the blocks, the largest and the smallest drawn in to their neighbours, times
    the root of their number (Tukey and McLaughlin 1963, Sankhya A 25(3)). 0: too few to say."""
    if len(blocks) < 4:
        return 0.0
    inner = np.sort(blocks)[1:-1]
    return float(np.std([inner[0], *inner, inner[-1]], ddof=1) * np.sqrt(len(blocks)))


def _lost(t: Tracking) -> float:
    """Share of the samples that the filter could not follow."""
    return float(np.mean(np.any(np.abs(t.tracked.filtered.white) > FAR, axis=1)))


def _followed(t: Tracking) -> Array:
    """1 where the filter could follow, 0 about impacts that it could not: (n, 1, 1)"""
    lost = np.any(np.abs(t.tracked.filtered.white) > FAR, axis=1).astype(float)
    near = np.convolve(lost, np.ones(2 * NEAR + 1), "same") > 0
    return np.where(near, 0.0, 1.0)[:, None, None]


def _quarters(n: int) -> list[slice]:
    edges = np.linspace(0, n, BLOCKS + 1).astype(int)
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def _values(term: TermCandidate, shapes: Mapping[str, float], theta: Array) -> dict[str, float]:
    """Inside its bounds. theta: its amplitude over the neutral one, or the two parts of a wave's."""
    if term.phase is None:
        return {**shapes, term.amplitude: float(np.clip(term.neutral + theta[0], term.lower, term.upper))}
    amplitude = float(min(np.hypot(*theta), term.upper))
    return {**shapes, term.amplitude: amplitude, term.phase: float(np.arctan2(theta[1], theta[0]))}


def _stretch(t: Tracking) -> Tracking:
    """The segments of a recording in which it moves most."""
    tracked = t.tracked
    every = int(tracked.ends[0])
    count = min(max(round(STRETCH / tracked.recording.step / every), 1), len(tracked.ends))
    moved = np.abs(np.diff(tracked.x, axis=0) / t.estimator.sampled.nominal).sum(axis=1)
    of_segment = np.diff(np.concatenate([[0.0], np.cumsum(moved)[tracked.ends - 1]]))
    first = int(np.argmax(np.convolve(of_segment, np.ones(count), "valid")))
    return replace(t, tracked=tracked[first : first + count])
