"""Naming: terms one by one, everything else free, while the evidence demands it; then what cannot be told apart."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter

import numpy as np
from scipy.optimize import minimize_scalar

from orchestrator.diagnosis.diagnosis import Candidate
from orchestrator.diagnosis.fit import PRIOR, Active, Fit, Hypothesis, difference, fit, promised
from orchestrator.diagnosis.problem import Problem, Vector
from orchestrator.diagnosis.scan import SEGMENTS, Column, Scan, Score, scores
from orchestrator.diagnosis.store import Store

EVIDENCE = 500.0  # chi-square that a term must take; 99 % of healthy draws: below 17 (docs/diagnosis-calibration.md)
LEADERS = 4  # of a scan's ranking that are fitted with everything else free
ABREAST = 0.9  # of the best promise, from which on twice as many are for a first term: their order says little
MOST_TERMS = 4
ALIKE = 30.0  # chi-square by which a term's fit may be worse and still not be told apart
ALIKE_SHARE = 0.05  # the same, as a share of what the best fit leaves
SIZES = (0.3, 1.0, 3.0, 10.0)  # multiples of the score test's amplitude that a fit may start from
NEEDLESS = 0.02  # of what an earlier term took, that it must still take beside a later one
CLEARLY = 10.0  # times what is needed, by the fit's own Jacobian: no fit without the term has to ask
BEYOND_DOUBT = 100.0  # times the evidence, by the fit's own Jacobian: a few steps of a fit without the term tell
POLISHED = 2  # of the leaders, that are fitted to the end
POINTED = 8  # terms that are looked at again after the first was added
HALF = 0.5  # of the structure that the terms before leave, that a later one may leave: a patch on a form leaves more
CLOSE = 0.98  # of a promise that was kept, from which on another term is tried all the same
RIVAL = 0.3  # of the best promise, that another term's promise must have to be tried against it
WORTH = 0.1  # of what the re-fit leaves above noise, that the first term must take; all, where a campaign lists them
INEXACT = 3e-5  # of what was taken before, that a later term must take: no form is known to better than half a percent
ONSET = 1e-3  # s; to which an onset is refined
SETTLED = 0.02  # of what is above noise, that a re-fit may leave to its next step
HOPELESS = 0.6  # of what another term takes, that a term falls short of
ROUGHLY = 0.01  # precision of fits that only compete, as a share of what is above noise

Progress = Callable[[str], None]
CHI2 = attrgetter("chi2")


@dataclass
class Named:
    """A term that is on, and what it stands for."""

    term: str
    gain: float  # chi-square that the fit loses without it
    alike: dict[str, float] = field(default_factory=dict)  # term -> chi-square by which its fit is worse


@dataclass
class Naming:
    """The best fit found, its terms, and what every round looked at."""

    fit: Fit
    named: list[Named]
    ranking: list[list[Candidate]]
    history: list[Fit]  # the base model, then after every term


@dataclass
class Progressed:
    """Naming so far: what a later round goes on from."""

    history: list[Fit]  # the base model, then after every term
    named: list[Named] = field(default_factory=list)
    ranking: list[list[Candidate]] = field(default_factory=list)
    probe: dict[str, float] = field(default_factory=dict)  # of the scan
    twins: dict[str, str] = field(default_factory=dict)
    done: bool = False


class Namer:
    """Adds terms to a calibrated base model."""

    def __init__(self, problem: Problem, scan: Scan, progress: Progress, store: Store | None = None) -> None:
        self.problem = problem
        self.scan = scan
        self.progress = progress
        self.store = store or Store(None)
        self._columns: list[Column] = []  # at the base model

    def name(self, calibrated: Fit, basis: object = None) -> Naming:
        """From the base model up. basis: what, beside the store's own, the result depends on."""
        so_far = Progressed([calibrated])
        while not so_far.done and len(so_far.named) < MOST_TERMS and self.unexplained(so_far.history[-1]):
            so_far = self.store.remember(
                f"naming-{len(so_far.ranking) + 1}", (basis, self._trail(so_far)), partial(self.round, so_far)
            )
            self.scan.probe, self.scan.twins = dict(so_far.probe), dict(so_far.twins)
        return Naming(so_far.history[-1], so_far.named, so_far.ranking, so_far.history)

    @staticmethod
    def _trail(so_far: Progressed) -> list[tuple[str, float]]:
        return [(n.term, n.gain) for n in so_far.named]

    def round(self, so_far: Progressed) -> Progressed:
        """One term more, or done."""
        best = self.to_its_end(so_far.history[-1])
        so_far = replace(so_far, history=[*so_far.history[:-1], best])
        if not self.unexplained(best):
            return replace(so_far, done=True)
        number = len(so_far.ranking) + 1
        self.progress(f"scan {number}: every term that the units know")
        ranked, found, winner = self.search(so_far.history)
        ranking = [*so_far.ranking, [Candidate(s.term.name, s.gain, dict(s.values), s.onset) for s in ranked[:10]]]
        so_far = replace(so_far, ranking=ranking, probe=dict(self.scan.probe), twins=dict(self.scan.twins))
        if winner is None:
            return replace(so_far, done=True)
        term = winner.hypothesis.active[-1].term.name
        again = self.without_last(best, winner)
        if again is not None and again.cost < best.cost:
            self.progress("the last fit had not come to its end")
            best = again
            so_far = replace(so_far, history=[*so_far.history[:-1], best])
        gain, above = best.cost - winner.cost, best.chi2 - self.problem.samples
        taken = so_far.history[0].chi2 - best.chi2
        if gain < EVIDENCE:
            return replace(so_far, done=len(ranking) > MOST_TERMS)
        if gain < (INEXACT * taken if so_far.named else WORTH * above):
            self.progress(f"{term} takes {gain:.0f} of {above:.0f} above noise: not worth a name")
            return replace(so_far, done=True)
        if so_far.named and self.problem.excess(winner.residual) > HALF * self.problem.excess(best.residual):
            self.progress(f"{term} takes less than it leaves: a patch on a form that is somewhat off")
            return replace(so_far, done=True)
        alike = {n: f.cost - winner.cost for n, f in found.items() if n != term and self.as_good(f, winner)}
        self.progress(f"{term} takes {gain:.0f} of {above:.0f} above noise")
        last, named = self.without_patches(winner, [*so_far.named, Named(term, gain, alike)])
        history = [*so_far.history[: len(named)], last]
        return replace(so_far, history=history, named=named)

    def search(self, history: Sequence[Fit]) -> tuple[list[Score], dict[str, Fit], Fit | None]:
        """(ranking, fits of the leaders, the best of them if the evidence demands it).

        After the first term the leaders are those that the base model's sensitivities point to; all terms are looked
        at again where these lead nowhere.
        """
        best = history[-1]
        active = {a.term.name for a in best.hypothesis.active}
        ranked: list[Score] = []
        found: dict[str, Fit] = {}
        for only in (self.pointed_to(history, active), None) if active else (None,):
            columns = self.scan.columns(best, skip=active, only=only)
            if not active:
                self._columns = columns
            ranked = scores(self.problem, best, columns)
            found = self.compete(best, ranked)
            winner = min(found.values(), key=lambda f: f.cost, default=None)
            if winner is not None and best.cost - winner.cost >= EVIDENCE:
                return ranked, found, winner
        return ranked, found, None

    def pointed_to(self, history: Sequence[Fit], active: Collection[str]) -> set[str]:
        """Terms that lead by the base model's sensitivities."""
        self._columns = self._columns or self.scan.columns(history[0])
        ranked = scores(self.problem, history[-1], [c for c in self._columns if c.term.name not in active])
        return {s.term.name for s in ranked[:POINTED]}

    def to_its_end(self, best: Fit) -> Fit:
        """The fit itself, or a better one where its Jacobian still promises what could be taken for a term.

        A large term's claim is checked without it anyhow, so that a small share of what is above noise may be left.
        """
        if promised(best) < max(
            EVIDENCE, min(SETTLED * (best.chi2 - self.problem.samples), 0.5 * BEYOND_DOUBT * EVIDENCE)
        ):
            return best
        found = fit(self.problem, best.hypothesis, best.x, settled=10.0, roughly=0.002, fresh_most=3)
        return found if found is not None and found.cost < best.cost else best

    def without_last(self, best: Fit, winner: Fit) -> Fit | None:
        """What went before, fitted from where the winner has it, its last term's share taken over by the others.

        A fit that ended early, or in a side valley, leaves room for a term that only helps it on. What may stand in for
        the term is asked of its own unit's parameters first: a gap that is too narrow is a gap. None: it is beyond
        doubt that the term is needed.
        """
        coordinates, term = winner.hypothesis.coordinates, winner.hypothesis.active[-1].term
        names = {c.names[0] for c in best.hypothesis.coordinates}
        kept = [k for k, c in enumerate(coordinates) if c.names[0] in names]
        last = [k for k, c in enumerate(coordinates) if c.names[0] == term.amplitude]
        J = self.renewed(winner, [k for k in kept if coordinates[k].component == term.component])
        needed = loss_without(replace(winner, jacobian=J), term.name) > BEYOND_DOUBT * EVIDENCE
        J = J if needed else self.renewed(winner, range(len(coordinates)))
        share = np.linalg.lstsq(J[:, kept], J[:, last] @ winner.x[last], rcond=1e-8)[0]
        hypothesis = replace(winner.hypothesis, active=winner.hypothesis.active[:-1])
        x = winner.x[kept] + share
        again = partial(fit, self.problem, hypothesis, x, J[:, kept], settled=10.0, roughly=0.002)
        if needed:
            begun = again(most=4, fresh_most=0)
            if begun is None or begun.cost >= best.cost:
                return None
        return again(most=15, fresh_most=2)

    def renewed(self, found: Fit, columns: Sequence[int]) -> Vector:
        """The fit's Jacobian, these columns by differences where it stands; as it is where that cannot be simulated."""
        J = found.jacobian.copy()
        fresh = difference(self.problem, found.hypothesis, found.x, found.simulated, columns) if columns else None
        if fresh is not None:
            J[:, columns] = fresh
        return J

    def without_patches(self, best: Fit, named: list[Named]) -> tuple[Fit, list[Named]]:
        """Without earlier terms that the last one made needless: what stood in for it while it was off."""
        for term in named[:-1]:
            needed = max(EVIDENCE, NEEDLESS * term.gain)
            if loss_without(best, term.term) > CLEARLY * needed:
                continue
            kept = tuple(a for a in best.settled().active if a.term.name != term.term)
            less = replace(best.settled(), active=kept)
            names = [c.names[0] for c in less.coordinates]
            columns = [k for k, c in enumerate(best.hypothesis.coordinates) if c.names[0] in names]
            found = fit(
                self.problem, less, base_start(less, best), _settled_jacobian(best)[:, columns],
                settled=20.0, roughly=ROUGHLY, most=8, fresh_most=1,
            )  # fmt: skip
            if found is not None and found.cost - best.cost < needed:
                self.progress(f"{term.term} is no longer needed")
                best, named = found, [n for n in named if n is not term]
        return best, named

    def unexplained(self, fit: Fit) -> bool:
        """Whether more is left than noise leaves."""
        left = self.problem.excess(fit.residual)
        return left > 3 * self.problem.excess_scatter or fit.chi2 - self.problem.samples > 0.03 * self.problem.samples

    def as_good(self, fit: Fit, best: Fit) -> bool:
        """Whether a fit cannot be told from the best."""
        left = max(self.problem.excess(best.residual), 0.0)
        return fit.cost - best.cost < ALIKE + ALIKE_SHARE * left

    def compete(self, best: Fit, ranked: Sequence[Score], leaders: int = LEADERS) -> dict[str, Fit]:
        """The leaders fitted roughly, then those that come near the best one to the end. Twins are not fitted twice."""
        above = max(best.chi2 - self.problem.samples, 0.0)
        top = max((s.gain for s in ranked), default=0.0)
        worth = max(0.3 * EVIDENCE, RIVAL * top)
        own = [s for s in ranked if s.gain > worth and s.term.name not in self.scan.twins][: 2 * leaders]
        first = not best.hypothesis.active
        tried = [s for k, s in enumerate(own) if k < leaders or (first and s.gain > ABREAST * top)]
        fits: dict[str, Fit] = {}
        enough = -np.inf  # promise from which on a term is tried
        for score in tried:
            if score.gain < enough:
                break
            found = self.with_best_onset(best, score.active, min((f.cost for f in fits.values()), default=np.inf))
            if found is None or found.cost >= best.cost:
                continue
            fits[score.term.name] = found
            if self.problem.excess(found.residual) < max(5 * self.problem.excess_scatter, 0.005 * above):
                enough = max(enough, CLOSE * score.gain)  # nothing left: only one that promises as much may do as well
        if not fits:
            return {}
        lowest = min(f.cost for f in fits.values())
        near = {n: f for n, f in fits.items() if f.cost - lowest < 0.3 * max(best.cost - lowest, 0.0)}
        near = dict(sorted(near.items(), key=lambda item: item[1].cost)[:POLISHED])
        polished = {n: self.polished(f) for n, f in near.items()}
        return dict(sorted(polished.items(), key=lambda item: item[1].cost))

    def polished(self, found: Fit) -> Fit:
        """Fitted to its end; where nothing is left, with the Jacobian at hand."""
        fresh = 3 if self.unexplained(found) else 0
        return fit_on(self.problem, found, settled=10.0, roughly=0.002, fresh=fresh) or found

    def with_best_onset(self, best: Fit, active: Active, lowest: float = np.inf) -> Fit | None:
        """The term from the start, and, where the score test says so, from later on: the better fit of both.

        lowest: cost of another term's fit; where this one comes nowhere near it, its onset need not be exact.
        """
        active = self.sized(best, active)
        rough = partial(fit_added, self.problem, best, most=10, fresh=0, settled=20.0, roughly=ROUGHLY)
        always = rough(replace(active, onset=None))
        if always is not None and active.term.episode:
            return self.with_onset(always)
        if active.onset is None or (
            always is not None and self.problem.excess(always.residual) < 5 * self.problem.excess_scatter
        ):
            return always
        later = rough(active)
        if later is None or (always is not None and always.cost <= later.cost):
            return always
        hopeless = later.cost - lowest > HOPELESS * (best.cost - lowest)
        return later if hopeless else self.with_onset(later)

    def sized(self, best: Fit, active: Active) -> Active:
        """The term at that multiple of the score test's amplitude which fits best as it is.

        Sensitivities at zero mislead far from it.
        """
        tried = [scaled(active, k) for k in SIZES]
        hypotheses = [replace(best.settled(), active=(*best.settled().active, a)) for a in tried]
        found = self.problem.simulate([h.run(base_start(h, best)) for h in hypotheses])
        costs = [np.inf if f is None else float(np.sum((self.problem.recorded - f.white) ** 2)) for f in found]
        return tried[int(np.argmin(costs))]

    def with_onset(self, found: Fit) -> Fit:
        """The last term's onset, or where it has these its beginning and length, refined with all else as it is.

        A gradient does not see an edge that lies elsewhere. What is missed or too much grows with the distance from
        the true onset, on both sides: a valley, seen from steps of a quarter segment, is gone down by golden section.
        The two edges of an episode are moved by halving.
        """
        active, best = found.settled().active[-1], found
        segment = float(self.problem.times().max()) / SEGMENTS

        def left_from(onset: float) -> float:
            nonlocal best
            trial = self.moved(found, [replace(active, onset=float(onset))])[0]
            best = best if trial is None else min(best, trial, key=CHI2)
            return np.inf if trial is None else trial.chi2

        if active.onset is not None:
            onsets = active.onset + segment * np.arange(-1.0, 1.1, 0.25)
            trials = self.moved(found, [replace(active, onset=float(t)) for t in onsets if t > 0 and t != active.onset])
            best = min((best, *filter(None, trials)), key=CHI2)
            middle = best.hypothesis.active[-1].onset or 0.0
            around = max(middle - segment / 4, 0.0), middle + segment / 4
            minimize_scalar(left_from, bounds=around, method="bounded", options={"xatol": ONSET})
        elif active.term.episode:
            width = segment / 2
            while width > ONSET:
                trials = self.moved(found, _at_other_times(best.settled().active[-1], width))
                nearest = min((best, *filter(None, trials)), key=CHI2)
                width = width / 2 if nearest is best else width
                best = nearest
        else:
            return found
        return fit_on(self.problem, best, settled=5.0, roughly=ROUGHLY, most=4) or best

    def moved(self, found: Fit, actives: Sequence[Active]) -> list[Fit | None]:
        """A fit with other last terms, all else as it is. None: that cannot be simulated."""
        settled = found.settled()
        x, J = base_start(settled, found), _settled_jacobian(found)
        hypotheses = [replace_last(settled, active) for active in actives]
        fits: list[Fit | None] = []
        for hypothesis, simulated in zip(
            hypotheses, self.problem.simulate([h.run(x) for h in hypotheses]), strict=True
        ):
            if simulated is None:
                fits.append(None)
                continue
            rest = self.problem.recorded - simulated.white
            fits.append(Fit(hypothesis, x, float(rest @ rest), rest, simulated, J, 0))
        return fits


def scaled(active: Active, k: float) -> Active:
    """The term k times as large, as far as it may be."""
    term = active.term
    amplitude = term.neutral + k * (active.values[term.amplitude] - term.neutral)
    return replace(active, values={**active.values, term.amplitude: float(np.clip(amplitude, term.lower, term.upper))})


def _at_other_times(active: Active, width: float) -> list[Active]:
    """Either edge of an episode moved, or both; its impulse kept."""
    assert active.term.episode
    begin, length = active.term.episode
    t_0, T_d = active.values[begin], active.values[length]
    moves = [(t_0 + t * width, T_d + T * width) for t, T in ((-1, 0), (1, 0), (0, -1), (0, 1), (1, -1), (-1, 1))]
    moved = [(replace(active, values={**active.values, begin: t, length: T}), T_d / T) for t, T in moves if T > 0]
    return [scaled(other, k) for other, k in moved if other.values[begin] >= 0]


def loss_without(best: Fit, name: str) -> float:
    """Chi-square that a fit would lose without that term, all else re-fitted, by its Jacobian."""
    coordinates = best.hypothesis.coordinates
    term = next(a.term for a in best.hypothesis.active if a.term.name == name)
    amplitude = [k for k, c in enumerate(coordinates) if c.names[0] == term.amplitude]
    shapes = {s.name for s in term.shapes}
    free = [k for k, c in enumerate(coordinates) if c.names[0] not in shapes]
    J, x = best.jacobian[:, free], best.x[amplitude]
    weight = np.where([coordinates[k].kind == "base" for k in free], PRIOR, 1e-9)
    own = [free.index(k) for k in amplitude]
    spread = np.linalg.pinv(J.T @ J + np.diag(weight))[np.ix_(own, own)]
    return float(x @ np.linalg.pinv(spread) @ x)


def replace_last(hypothesis: Hypothesis, active: Active) -> Hypothesis:
    """The hypothesis with another last term."""
    return replace(hypothesis, active=(*hypothesis.active[:-1], active))


def base_start(hypothesis: Hypothesis, best: Fit) -> Vector:
    """The start of a hypothesis, base parameters where another fit has them."""
    x = hypothesis.start()
    base = len(hypothesis.free)
    x[:base] = best.x[:base]
    return x


def fit_on(
    problem: Problem, found: Fit, *, settled: float, roughly: float = 0.0, most: int = 12, fresh: int = 3
) -> Fit | None:
    """The same hypothesis, fitted on from where it stands. fresh: Jacobians by differences at most."""
    hypothesis, x, J = found.hypothesis, found.x, found.jacobian
    return fit(problem, hypothesis, x, J, settled=settled, roughly=roughly, most=most, fresh_most=fresh)


def fit_added(
    problem: Problem, best: Fit, active: Active, *, most: int, fresh: int, settled: float, roughly: float
) -> Fit | None:
    """`best` with one more term; its Jacobian is that of `best` and the new term's own, so that few runs are needed."""
    hypothesis = replace(best.settled(), active=(*best.settled().active, active))
    x = base_start(hypothesis, best)
    own = list(range(len(best.x), len(hypothesis.coordinates)))
    base = problem.simulate([hypothesis.run(x)])[0]
    added = difference(problem, hypothesis, x, base, own) if base is not None else None
    if added is None:
        return None
    J = np.column_stack([_settled_jacobian(best), added])
    return fit(problem, hypothesis, x, J, settled=settled, roughly=roughly, most=most, fresh_most=fresh)


def prune(problem: Problem, calibrated: Fit, naming: Naming) -> tuple[Fit, list[Named]]:
    """Without the last terms that explain less than what stays unexplained: patches, not explanations."""
    left = problem.excess(naming.fit.residual) - 3 * problem.excess_scatter
    named = list(naming.named)
    while named and named[-1].gain < left:
        named.pop()
    return naming.history[len(named)], named


def worth_naming(problem: Problem, calibrated: Fit, naming: Naming) -> tuple[Fit, list[Named]]:
    """Where a campaign says what to look at: without the last terms that take little of what the re-fit leaves.

    No model of a real machine leaves nothing but noise, so what stays unexplained is no measure there.
    """
    named = list(naming.named)
    while named and named[-1].gain < WORTH * (calibrated.chi2 - problem.samples):
        named.pop()
    return naming.history[len(named)], named


def _settled_jacobian(best: Fit) -> Vector:
    """Jacobian in the coordinates of the settled hypothesis: scales of linear coordinates follow their start values."""
    old, new = best.hypothesis.coordinates, best.settled().coordinates
    J = best.jacobian.copy()
    for k, (a, b) in enumerate(zip(old, new, strict=True)):
        if a.kind in ("linear", "cos", "sin") and a.scale > 0:
            J[:, k] *= b.scale / a.scale
    return J
