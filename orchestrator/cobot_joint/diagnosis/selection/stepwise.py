"""Naming: terms one by one, everything else free, while the evidence demands it; then what cannot be told apart."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter

import numpy as np

from cobot_joint.diagnosis.candidates.score_test import Column, Scan, Score, scores
from cobot_joint.diagnosis.estimation.fit import PRIOR, Fit, difference, fit, promised
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.findings import Candidate
from cobot_joint.diagnosis.selection.competition import ROUGHLY, Leaders, base_start, fit_added, settled_jacobian
from cobot_joint.diagnosis.store import Store

EVIDENCE = 500.0  # chi-square that a term must take; 99 % of healthy draws: below 17 (docs/diagnosis-calibration.md)
MOST_TERMS = 4
ALIKE = 30.0  # chi-square by which a term's fit may be worse and still not be told apart
ALIKE_SHARE = 0.05  # the same, as a share of what the best fit leaves
NEEDLESS = 0.02  # of what an earlier term took, that it must still take beside a later one
CLEARLY = 10.0  # times what is needed, by the fit's own Jacobian: no fit without the term has to ask
BEYOND_DOUBT = 100.0  # times the evidence, by the fit's own Jacobian: a few steps of a fit without the term tell
EARLY = 0.1  # of what a term takes that is beyond doubt, by which the fit before it may have ended early
POINTED = 8  # terms that are looked at again after the first was added
HALF = 0.5  # of the structure that the terms before leave, that a later one may leave: a patch on a form leaves more
WORTH = 0.1  # of what the re-fit leaves above noise, that the first term must take; all, where a campaign lists them
PASSES = 3  # over the onsets of several terms
INEXACT = 3e-5  # of what was taken before, that a later term must take: no form is known to better than half a percent
SETTLED = 0.02  # of what is above noise, that a re-fit may leave to its next step

Progress = Callable[[str], None]


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
        self.leaders = Leaders(problem)
        self._columns: list[Column] = []  # at the base model

    def name(self, calibrated: Fit, basis: object = None) -> Naming:
        """From the base model up. basis: what, beside the store's own, the result depends on."""
        so_far = Progressed([calibrated])
        while not so_far.done and len(so_far.named) < MOST_TERMS:
            if not self.problem.unexplained(so_far.history[-1].residual):
                break
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
        best = self.with_onsets(self.to_its_end(so_far.history[-1]))
        so_far = replace(so_far, history=[*so_far.history[:-1], best])
        if not self.problem.unexplained(best.residual):
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
        last, named = self.without_patches(self.in_twins_too(winner), [*so_far.named, Named(term, gain, alike)])
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
            own = [s for s in ranked if s.term.name not in self.scan.twins]  # twins are not fitted twice
            found = self.leaders.fits(best, own, 0.3 * EVIDENCE)
            winner = min(found.values(), key=lambda f: f.cost, default=None)
            if winner is not None and best.cost - winner.cost >= EVIDENCE:
                return ranked, found, winner
        return ranked, found, None

    def in_twins_too(self, winner: Fit) -> Fit:
        """Where the last term is as large as it can be, the same term also in the unit that responds alike.

        All of a shaft's friction rests on bristles: the motor's is half of it.
        """
        last, k = winner.settled().active[-1], self._amplitude(winner)
        if winner.x[k] < winner.hypothesis.coordinates[k].upper - 1e-6:
            return winner
        twins = self.scan.alike(last.term.name) - {last.term.name}
        for other in (t for t in self.scan.terms if t.name in twins):
            values = {name.replace(last.term.name, other.name, 1): value for name, value in last.values.items()}
            found = fit_added(
                self.problem, winner, replace(last, term=other, values=values),
                most=15, fresh=2, settled=10.0, roughly=0.002,
            )  # fmt: skip
            if found is not None and winner.cost - found.cost > EVIDENCE:
                self.progress(f"{other.name} as well")
                winner = found
        return winner

    @staticmethod
    def _amplitude(fit: Fit) -> int:
        """The coordinate of the last term's amplitude."""
        name = fit.hypothesis.active[-1].term.amplitude
        return next(k for k, c in enumerate(fit.hypothesis.coordinates) if c.names[0] == name)

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

    def with_onsets(self, best: Fit) -> Fit:
        """With the onsets of several terms looked at once more: those before the last were found while it was off."""
        late = [k for k, active in enumerate(best.hypothesis.active) if active.onset is not None]
        for _ in range(PASSES if late and len(best.hypothesis.active) > 1 else 0):
            before = best.cost
            for k in late:
                if best.hypothesis.active[k].onset is None or not self.problem.unexplained(best.residual):
                    continue
                best = min(best, self.leaders.with_onset(best, k), key=attrgetter("cost"))
                always = self.leaders.from_start(best, k)
                best = always if always is not None and always.cost < best.cost + ALIKE else best
            if before - best.cost < EVIDENCE:
                break
        return best

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
            if best.cost - begun.cost < EARLY * (best.cost - winner.cost):
                return begun
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
                self.problem, less, base_start(less, best), settled_jacobian(best)[:, columns],
                settled=20.0, roughly=ROUGHLY, most=8, fresh_most=1,
            )  # fmt: skip
            if found is not None and found.cost - best.cost < needed:
                self.progress(f"{term.term} is no longer needed")
                best, named = found, [n for n in named if n is not term]
        return best, named

    def as_good(self, fit: Fit, best: Fit) -> bool:
        """Whether a fit cannot be told from the best."""
        left = max(self.problem.excess(best.residual), 0.0)
        return fit.cost - best.cost < ALIKE + ALIKE_SHARE * left


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
