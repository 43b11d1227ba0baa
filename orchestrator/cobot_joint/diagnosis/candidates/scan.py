"""The scan: every term of a plant switched on by a little, at every shape that it may have."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.candidates.columns import (
    Column,
    cosine,
    in_proportion,
    middle,
    probes,
    same_shapes,
    shapes,
)
from cobot_joint.diagnosis.candidates.score_test import Score, scores
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.order_spectrum import clear_orders, order_spectrum, prewhitened
from cobot_joint.diagnosis.estimation.problem import Key, Problem
from cobot_joint.diagnosis.plant.plant import PROBE, Signals, TermCandidate

ORDERS = 3  # whole orders per term that are simulated, of those that the residual's own order spectrum shows,
CLEAR = 1  # and of those that stand out of it once it is prewhitened
RESPONSE = 0.3  # rms over noise that a probing amplitude should cause
LEAST, GREATEST = 0.1, 30.0  # the same, as it is kept; simulations are rough by some 0.002
IN_PROPORTION = 100.0  # to which a probing amplitude is made larger or smaller without trying it again


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
        first = {t.name: middle(t, orders) for t in terms}
        by_term = {c.term.name: [c] for c in self._run(fit, [(t, first[t.name]) for t in terms])}
        self._note_indistinguishable(terms, by_term)
        gains = {s.term.name: s.gain for s in scores(self.problem, fit, [c for (c,) in by_term.values()])}
        least = thresholds.PROMISING_SHAPE * max(gains.values(), default=0.0)
        rest = [
            (t, s)
            for t in terms
            if t.name not in self.indistinguishable
            if gains.get(t.name, 0.0) >= least or any(s.whole for s in t.shapes)
            for s in shapes(t, orders)
            if s != first[t.name]
        ]
        for column in self._run(fit, rest):
            by_term.setdefault(column.term.name, []).append(column)
        for name, simulated in self.indistinguishable.items():
            if name in by_term and simulated in by_term:
                by_term[name] = in_proportion(by_term[name][0], by_term[simulated])
        return [c for columns in by_term.values() for c in columns]

    def setting_in(self, fit: Fit, onset: float, skip: Collection[str] = ()) -> list[Column]:
        """Columns of terms that are off until `onset`, of middle shapes and of the orders that stand out.

        An angle's error that sets in is a jump first, which the column of one that was always there does not show.
        """
        terms = [t for t in self.terms if not t.episode and t.name not in self.indistinguishable and t.name not in skip]
        terms = [t for t in terms if any(self.problem.plant.has(t.name, r) for r in self.problem.recordings)]
        whole = [t for t in terms if any(s.whole for s in t.shapes)]
        orders = self._orders(fit, whole)
        wanted = [(t, s) for t in terms for s in (shapes(t, orders) if t in whole else [middle(t, orders)])]
        return self._run(fit, wanted, onset)

    def secants(self, fit: Fit, found: Sequence[Score], onset: float, part: float) -> list[Column]:
        """Columns of terms at the shapes that they were found at, over so large a part of the amplitudes found,
        as far as these may be."""
        wanted = [(s.term, {shape.name: s.values[shape.name] for shape in s.term.shapes}) for s in found]
        sizes = {s.term: abs(s.values[s.term.amplitude] - s.term.neutral) for s in found}
        lengths = {term.name: part * min(size, term.upper - term.neutral) for term, size in sizes.items()}
        return self._run(fit, wanted, onset, lengths)

    def _note_indistinguishable(self, terms: Sequence[TermCandidate], first: Mapping[str, Sequence[Column]]) -> None:
        """Terms of one name in units that respond alike: the first unit's leads."""
        families: dict[str, list[TermCandidate]] = {}
        for term in terms:
            families.setdefault(term.name.split(".")[1], []).append(term)
        for simulated, *others in families.values():
            for term in others:
                columns = [first[name][0] for name in (term.name, simulated.name) if name in first]
                if same_shapes(term, simulated) and len(columns) == 2 and cosine(*columns) > thresholds.COLLINEAR:
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
            runs += [run.with_values({}, late) for run in probes(fit.run, term, shape, delta[term.name])]
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
            runs = [next(iter(probes(fit.run, t, middle(t, {}), trial[t.name]))) for t in left]
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
        white = prewhitened(self.problem, fit.residual)
        for term in terms:
            shape = next(s for s in term.shapes if s.whole)
            if len(shape.values) <= ORDERS or not angles.get(term.component):
                continue
            power, clear = np.zeros(len(shape.values)), []
            for angle in angles[term.component]:
                power = np.maximum(power, order_spectrum(self.problem, fit.residual, angle, outputs, shape.values)[0])
                flat = order_spectrum(self.problem, white, angle, outputs, shape.values)
                clear += [(flat[0][k], k) for k in clear_orders(*flat)]
            best = {*np.argsort(-power)[:ORDERS].tolist(), *(k for _, k in sorted(clear)[-CLEAR:])}
            found[shape.name] = [shape.values[k] for k in sorted(best)]
        return found
