"""The score test: what every switched-off term would take from the residual, re-fittable parameters projected out."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import bounded_step
from cobot_joint.diagnosis.estimation.order_spectrum import order_spectrum
from cobot_joint.diagnosis.estimation.problem import Key, Problem, Run, Vector
from cobot_joint.diagnosis.estimation.projection import solve
from cobot_joint.diagnosis.plant.plant import PROBE, Signals, TermCandidate

SEGMENTS = 16  # of a run; an effect may set in at each of their borders
ORDERS = 3  # whole orders per term that are simulated, of those that the residual's own order spectrum shows
RESPONSE = 0.3  # rms over noise that a probing amplitude should cause
LEAST, GREATEST = 0.1, 30.0  # the same, as it is kept; simulations are rough by some 0.002
IN_PROPORTION = 100.0  # to which a probing amplitude is made larger or smaller without trying it again


@dataclass(frozen=True)
class Column:
    """d(simulated)/d(amplitude) of a term at one scanned shape; two for a pair of sine and cosine."""

    term: TermCandidate
    shape: Mapping[str, float]
    vectors: tuple[Vector, ...]


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


class Scan:
    """Columns of all terms of a plant. Probing amplitudes, once found, serve every later scan."""

    def __init__(
        self, problem: Problem, terms: Sequence[TermCandidate], progress: Callable[[str], None] | None = None
    ) -> None:
        self.problem = problem
        self.progress = progress
        self.terms = list(terms)
        self.probe: dict[str, float] = {}
        self._simulated: dict[tuple[Key, int], Signals] = {}  # while probing, of one recording; a column asks for them
        self._at_base: tuple[Fit, list[Column]] | None = None  # of all terms, beside no other
        self.indistinguishable: dict[str, str] = {}  # term -> term of the same name in another unit that responds alike

    def columns(self, fit: Fit, skip: Collection[str] = (), only: Collection[str] | None = None) -> list[Column]:
        """One run per scanned shape (two per pair); other than middle shapes only where the term shows.

        only: the terms to look at, and those that respond alike; None: all.
        """
        if skip or only is not None:
            return self._columns(fit, skip, only)
        if self._at_base is None or self._at_base[0] is not fit:
            self._at_base = fit, self._columns(fit, (), None)
        return self._at_base[1]

    def _columns(self, fit: Fit, skip: Collection[str], only: Collection[str] | None) -> list[Column]:
        terms = [
            t
            for t in self.terms
            if t.name not in skip
            and (only is None or any(name in only for name in self.alike(t.name)))
            and any(self.problem.plant.has(t.name, r) for r in self.problem.recordings)
        ]
        self._adapt([t for t in terms if t.name not in self.probe], fit)
        orders = self._orders(fit, [t for t in terms if any(s.whole for s in t.shapes)])
        first = {t.name: _middle(t, orders) for t in terms}
        by_term = {c.term.name: [c] for c in self._run(fit, [(t, first[t.name]) for t in terms])}
        self._note_indistinguishable(terms, by_term)
        gains = {s.term.name: s.gain for s in scores(self.problem, fit, [c for (c,) in by_term.values()])}
        least = thresholds.PROMISING_SHAPE * max(gains.values(), default=0.0)
        rest = [
            (t, s)
            for t in terms
            if t.name not in self.indistinguishable
            if gains.get(t.name, 0.0) >= least or any(s.whole for s in t.shapes)
            for s in _shapes(t, orders)
            if s != first[t.name]
        ]
        for column in self._run(fit, rest):
            by_term.setdefault(column.term.name, []).append(column)
        for name, simulated in self.indistinguishable.items():
            if name in by_term and simulated in by_term:
                by_term[name] = _in_proportion(by_term[name][0], by_term[simulated])
        return [c for columns in by_term.values() for c in columns]

    def setting_in(self, fit: Fit, onset: float, skip: Collection[str] = ()) -> list[Column]:
        """Columns of terms that are off until `onset`, of middle shapes and of the orders that stand out.

        An angle's error that sets in is a jump first, which the column of one that was always there does not show.
        """
        terms = [t for t in self.terms if not t.episode and t.name not in self.indistinguishable and t.name not in skip]
        terms = [t for t in terms if any(self.problem.plant.has(t.name, r) for r in self.problem.recordings)]
        whole = [t for t in terms if any(s.whole for s in t.shapes)]
        orders = self._orders(fit, whole)
        wanted = [(t, s) for t in terms for s in (_shapes(t, orders) if t in whole else [_middle(t, orders)])]
        return self._run(fit, wanted, onset)

    def secants(self, fit: Fit, found: Sequence[Score], onset: float, part: float) -> list[Column]:
        """Columns of terms at the shapes that they were found at, over so large a part of the amplitudes found."""
        wanted = [(s.term, {shape.name: s.values[shape.name] for shape in s.term.shapes}) for s in found]
        lengths = {s.term.name: part * abs(s.values[s.term.amplitude] - s.term.neutral) for s in found}
        return self._run(fit, wanted, onset, lengths)

    def _note_indistinguishable(self, terms: Sequence[TermCandidate], first: Mapping[str, Sequence[Column]]) -> None:
        """Terms of one name in units that respond alike: the first unit's leads."""
        families: dict[str, list[TermCandidate]] = {}
        for term in terms:
            families.setdefault(term.name.split(".")[1], []).append(term)
        for simulated, *others in families.values():
            for term in others:
                columns = [first[name][0] for name in (term.name, simulated.name) if name in first]
                if _same_shapes(term, simulated) and len(columns) == 2 and _cosine(*columns) > thresholds.COLLINEAR:
                    self.indistinguishable[term.name] = simulated.name

    def alike(self, name: str) -> set[str]:
        """A term and those of other units that respond alike."""
        simulated = self.indistinguishable.get(name, name)
        return {simulated, *(t for t, other in self.indistinguishable.items() if other == simulated)}

    def _run(
        self,
        fit: Fit,
        wanted: Sequence[tuple[TermCandidate, Mapping[str, float]]],
        onset: float | None = None,
        lengths: Mapping[str, float] | None = None,
    ) -> list[Column]:
        """lengths: term -> amplitude of its runs, where that is not the probing one."""
        runs, delta = [], self.probe if lengths is None else lengths
        for term, shape in wanted:
            late = {} if onset is None else {term.amplitude: onset}
            runs += [run.with_values({}, late) for run in _probes(fit.run, term, shape, delta[term.name])]
        with self._told():
            known = self._simulated if fit.run.is_plain else None
            simulated = iter(self.problem.simulate(runs, fit.simulated, known=known))
        columns = []
        for term, shape in wanted:
            vectors = [next(simulated) for _ in range(2 if term.phase else 1)]
            if all(v is not None for v in vectors):
                moved = [(v.white - fit.simulated.white) / delta[term.name] for v in vectors]  # type: ignore[union-attr]
                columns.append(Column(term, shape, tuple(moved)))
        return [c for c in columns if all(v @ v > 0 for v in c.vectors)]

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Whoever waits is told how many simulations are done, and about how long the others take."""
        begun = time.monotonic()

        def watch(done: int, total: int) -> None:
            left = (time.monotonic() - begun) * (total - done) / done
            if self.progress:
                self.progress(f"score test: simulation {done} of {total}, {left:.0f} s left")

        before, self.problem.watch = self.problem.watch, watch
        try:
            yield
        finally:
            self.problem.watch = before

    def probes(self, fit: Fit) -> dict[str, float]:
        """Term -> probing amplitude."""
        self._adapt([t for t in self.terms if t.name not in self.probe], fit)
        return self.probe

    def _adapt(self, terms: Sequence[TermCandidate], fit: Fit) -> None:
        """Amplitudes whose responses are well above rounding and still small.

        One recording says it, unless the term does not show there.
        """
        trial = {t.name: min(PROBE.get(t.unit, 1e-6), 0.5 * (t.upper - t.neutral)) for t in terms}
        one = {t.name: self._fullest(t) for t in terms}
        left = list(terms)
        self._simulated.clear()  # they were beside another fit
        for _ in range(6):
            runs = [next(iter(_probes(fit.run, t, _middle(t, {}), trial[t.name]))) for t in left]
            again = []
            simulated = self.problem.simulate(runs, fit.simulated, [one[t.name] for t in left])
            for term, run, found in zip(left, runs, simulated, strict=True):
                size = np.sqrt(np.mean((found.white - fit.simulated.white) ** 2)) if found else np.inf
                if found and (n := one[term.name]) is not None:
                    self._simulated[run.key, n] = found.outputs[n]
                if size < 1e-3:
                    one[term.name] = None
                if LEAST <= size <= GREATEST or (
                    size < LEAST and trial[term.name] >= 0.4 * (term.upper - term.neutral)
                ):
                    continue
                factor = 1e-3 if not np.isfinite(size) else 1e3 if size < 1e-3 else float(RESPONSE / size)
                trial[term.name] = min(trial[term.name] * factor, 0.5 * (term.upper - term.neutral))
                if not 1 / IN_PROPORTION < factor < IN_PROPORTION:
                    again.append(term)
            left = again
            if not left:
                break
        self.probe |= trial

    def _fullest(self, term: TermCandidate) -> int | None:
        """The first recording of those that have most components, the term's among them."""
        there = [n for n, r in enumerate(self.problem.recordings) if self.problem.plant.has(term.name, r)]
        components = {t.component for t in self.terms}
        return max(
            there,
            key=lambda n: sum(self.problem.plant.has(c, self.problem.recordings[n]) for c in components),
            default=None,
        )

    def _orders(self, fit: Fit, terms: Sequence[TermCandidate]) -> dict[str, list[float]]:
        """Shape -> the whole orders whose order spectrum stands out, over the angles that the term's unit knows."""
        angles: dict[str, tuple[str, ...]] = {}
        for port in self.problem.plant.ports:
            angles[port.component] = tuple(dict.fromkeys((*angles.get(port.component, ()), *port.angles)))
        wanted = sorted({a for t in terms for a in angles.get(t.component, ())})
        outputs = self.problem.outputs(fit.run, wanted) if wanted else []
        found: dict[str, list[float]] = {}
        for term in terms:
            shape = next(s for s in term.shapes if s.whole)
            if len(shape.values) <= ORDERS or not angles.get(term.component):
                continue
            power = np.zeros(len(shape.values))
            for angle in angles[term.component]:
                power = np.maximum(power, order_spectrum(self.problem, fit.residual, angle, outputs, shape.values)[0])
            best = np.argsort(-power)[:ORDERS]
            found[shape.name] = [shape.values[k] for k in sorted(best)]
        return found


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


def _probes(run: Run, term: TermCandidate, shape: Mapping[str, float], delta: float) -> list[Run]:
    values = {**run.values, **shape, term.amplitude: term.neutral + delta}
    phases = [{term.phase: 0.0}, {term.phase: np.pi / 2}] if term.phase else [{}]
    return [replace(run, values={**values, **phase}, touches=(term.component,)) for phase in phases]


def _shapes(term: TermCandidate, orders: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """Every combination of scanned shapes."""
    if term.episode:  # always on: windows are cut from its response
        return [{s.name: (0.0 if s.name.endswith(".t_0") else 1e6) for s in term.shapes}]
    choices = [orders.get(s.name, s.values) for s in term.shapes]
    return [dict(zip([s.name for s in term.shapes], values, strict=True)) for values in product(*choices)]


def _middle(term: TermCandidate, orders: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """The combination in the middle."""
    shapes = _shapes(term, orders)
    return shapes[len(shapes) // 2]


def _same_shapes(a: TermCandidate, b: TermCandidate) -> bool:
    return [s.values for s in a.shapes] == [s.values for s in b.shapes]


def _renamed(shape: Mapping[str, float], old: TermCandidate, new: TermCandidate) -> dict[str, float]:
    names = {o.name: n.name for o, n in zip(old.shapes, new.shapes, strict=True)}
    return {names[name]: value for name, value in shape.items()}


def _in_proportion(own: Column, simulated: Sequence[Column]) -> list[Column]:
    """Columns of a term that responds like another: that one's, in the proportion of one that was simulated."""
    a, b = own.vectors[0], simulated[0].vectors[0]
    ratio = float(a @ b / (b @ b))
    return [
        Column(own.term, _renamed(c.shape, c.term, own.term), tuple(ratio * v for v in c.vectors)) for c in simulated
    ]


def _cosine(a: Column, b: Column) -> float:
    u, v = a.vectors[0], b.vectors[0]
    return float(abs(u @ v) / np.sqrt((u @ u) * (v @ v)))
