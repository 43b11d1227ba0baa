"""Forward selection of terms: one by one while the evidence demands it, all else free."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.candidates.columns import Column
from cobot_joint.diagnosis.candidates.scan import Scan
from cobot_joint.diagnosis.candidates.score_test import Score, scores
from cobot_joint.diagnosis.estimation.calibrate import SETTLED
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import (
    difference,
    fit,
    fit_added,
    fit_on,
    predicted_decrease,
)
from cobot_joint.diagnosis.estimation.multiscale import out_of_local_minimum
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.findings import Candidate
from cobot_joint.diagnosis.selection.competition import FITTED, Competition, finished
from cobot_joint.diagnosis.selection.elimination import loss_without, without_needless
from cobot_joint.diagnosis.selection.from_afar import look_from_afar
from cobot_joint.diagnosis.selection.left_out import predicts
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.unlisted.remains import remains
from cobot_joint.diagnosis.store import Store

POINTED = 8  # terms that are looked at again after the first was added
POSSIBLE = 4  # leading ones that are looked at as they are, where what is left stands out
BESIDE = 2  # of them that are fitted in many recordings, where a later term may take less than it leaves
PASSES = 3  # over the onsets of several terms
SECANTS = (0.1, 0.3, 1.0)  # of the amplitude that small ones lead to
LED_OUT = 4  # times at most, that a load's fit is led out of a local minimum
SUBSET = 1e-8  # of the largest singular value, below which a column is not asked to stand in for another

Progress = Callable[[str], None]


class Selector:
    """Adds terms to a calibrated base model.

    given: the recordings' motion is an input. A free run loses nothing then, so that a later term which takes less than
    it leaves may show by predicting parts that it was not fitted to that it is no patch.
    """

    def __init__(
        self,
        problem: Problem,
        scan: Scan,
        progress: Progress,
        store: Store | None = None,
        given: bool = False,
    ) -> None:
        self.problem = problem
        self.given = given
        self.scan = scan
        self.progress = progress
        self.store = store or Store(None)
        self.competition = Competition(problem)
        self._columns: list[Column] = []  # at the base model

    def select(self, calibrated: Fit, basis: object = None) -> Selection:
        """From the base model up. basis: what, beside the store's own, the result depends on."""
        so_far = self._forward(Selection([calibrated]), basis)
        instead = self._one_instead(so_far, basis)
        return self._forward(instead, basis) if instead else so_far

    def further(self, so_far: Selection) -> Selection:
        """On from some terms."""
        return self._forward(so_far, None)

    def beside(self, freed: Fit) -> Selection:
        """Beside a parameter that is let go of: none of any size in their place, which was looked for without it."""
        return self._forward(Selection([freed]), None)

    def probes(self, fit: Fit) -> Mapping[str, float]:
        """Term -> amplitude that moves a run by about its noise."""
        return self.scan.probes(fit)

    def _forward(self, so_far: Selection, basis: object) -> Selection:
        """Round by round, until one adds nothing."""
        while not so_far.done and len(so_far.selected) < thresholds.MOST_TERMS:
            if not self.problem.unexplained(so_far.fit.residual):
                break
            trail = [(s.term, s.gain) for s in so_far.selected]
            stage = f"selection-{len(so_far.ranking) + 1}"
            look = partial(self.store.remember, stage, (basis, trail), partial(self.round, so_far))
            found = self.problem.budget.spend("further listed terms", look) if so_far.ranking else look()
            if found is None:
                break
            so_far = found
            self.scan.probe, self.scan.indistinguishable = dict(so_far.probes), dict(so_far.indistinguishable)
        return so_far

    def _one_instead(self, so_far: Selection, basis: object) -> Selection | None:
        """One term, seen from afar, that leaves less than several which leave what stands out, than one that takes too
        little to stand alone, or that takes half where none takes much: a gear that gives way was a brake that fades, a
        load, and a sensor's gain (machine 157/18); of no gap at all a sensitivity says nothing."""
        base, best = so_far.history[0], so_far.fit
        if self.given or not self.problem.stands_out(best.residual):
            return None
        before, left = remains(self.problem, base, best)
        if len(so_far.selected) == 1 and left < (1 - thresholds.ALONE) * before:
            return None
        begins = [_begins(term) for term in best.settled().hypothesis.terms] if self.problem.onsets else []
        self.progress("looking for one term of any size")
        trail = [(s.term, s.gain) for s in so_far.selected]
        alone = partial(self._alone, base, dict.fromkeys([None, *begins]))
        look = partial(self.store.remember, "one-instead", (basis, trail), alone)
        one = self.problem.budget.spend("one term instead of others", look)
        late = one is not None and one.hypothesis.terms[-1].onset is not None
        worth = thresholds.WORTH if late or len(so_far.selected) == 1 else 0.0
        worth = worth if so_far.selected else thresholds.HOLDS
        if one is None or best.cost - one.cost < max(self.problem.evidence, worth * self.problem.above(best.residual)):
            return None
        name = one.hypothesis.terms[-1].name
        self.progress(f"{name} alone leaves less than the terms above")
        selected = [Selected(name, base.cost - one.cost)]
        return replace(so_far, history=[base, one], selected=selected, ranking=so_far.ranking[:1], done=False)

    def _alone(self, base: Fit, since: Collection[float | None]) -> Fit | None:
        """The best single term that is seen from afar, from the start or from about one of these times on."""
        columns = self._columns or self.scan.columns(base)
        found: list[Fit] = []
        for onset in since:
            seen = look_from_afar(self.problem, base, columns, onset).values()
            found += seen if onset is None else map(self.competition.with_onset, seen)
        best = min(found, key=attrgetter("cost"), default=None)
        return best if best is None or best.hypothesis.terms[-1].onset is None else self.competition.finished(best)

    def round(self, so_far: Selection) -> Selection:
        """One term more, or done."""
        best = self._led_out(self.with_onsets(self.to_its_end(so_far.fit)))
        so_far = replace(so_far, history=[*so_far.history[:-1], best])
        if not self.problem.unexplained(best.residual):
            return replace(so_far, done=True)
        self.progress(f"round {len(so_far.ranking) + 1}: score test of {len(self.scan.terms)} terms")
        ranked, found, winner = self.search(so_far.history)
        ranking = [*so_far.ranking, [Candidate(s.term.name, s.gain, dict(s.values), s.onset) for s in ranked[:10]]]
        probes, indistinguishable = dict(self.scan.probe), dict(self.scan.indistinguishable)
        so_far = replace(so_far, ranking=ranking, probes=probes, indistinguishable=indistinguishable)
        if winner is None:
            return replace(so_far, done=True)
        again = self.without_last(best, winner)
        if so_far.selected and best.cost - winner.cost < thresholds.HARDLY_LEFT_SHARE * self._taken(so_far):
            again = self._anew(best, again)
        if again is not None and again.cost < best.cost:
            self.progress("the last fit had not come to its end")
            best = again
            so_far = replace(so_far, history=[*so_far.history[:-1], best])
        if best.cost - winner.cost < self.problem.evidence:
            return replace(so_far, done=len(ranking) > thresholds.MOST_TERMS)
        return self._added(so_far, winner, found) if self._is_worth_it(so_far, winner) else replace(so_far, done=True)

    def _is_worth_it(self, so_far: Selection, winner: Fit) -> bool:
        """Whether the last term is more than a patch on what is there."""
        best, term = so_far.fit, winner.hypothesis.terms[-1].name
        gain, above = best.cost - winner.cost, self.problem.above(best.residual)
        if gain < (thresholds.INEXACT * self._taken(so_far) if so_far.selected else thresholds.LEAST * above):
            self.progress(f"{term} takes {share(gain, above)} of what is above noise: too little for a name")
            return False
        if so_far.selected and self._is_patch(best, winner):
            self.progress(f"{term} takes less than half of what was left: no term, but the rest of one before it")
            return False
        return True

    def _taken(self, so_far: Selection) -> float:
        """Chi-square that the terms so far take."""
        return so_far.history[0].chi2 - so_far.fit.chi2

    def _anew(self, best: Fit, again: Fit | None) -> Fit | None:
        """What a later term that takes next to nothing is held against: fits without it with a Jacobian of their own,
        and their onsets once more. Two terms that had stopped short of their end left two thousandths to a third."""
        starts = [found for found in (best, again) if found is not None]
        fits = [fit(self.problem, at.hypothesis, at.x, None, finished(3, steps=30)) for at in starts]
        ended = [self.with_onsets(found) for found in fits if found is not None]
        return min([*ended, *starts], key=attrgetter("cost"), default=None)

    def _may_predict(self, best: Fit) -> bool:
        """Whether a further term that takes less than it leaves may show by prediction that it is needed: a second."""
        return self.given and len(best.hypothesis.terms) == 1

    def _is_patch(self, best: Fit, winner: Fit) -> bool:
        """Whether a later term takes less than it leaves, and does not show otherwise that it is needed."""
        left = self.problem.excess(winner.residual), self.problem.excess(best.residual)
        if left[0] <= (1 - thresholds.HOLDS) * left[1]:
            return False
        enough = best.cost - winner.cost > thresholds.LEAST * self.problem.above(best.residual)
        return not (enough and self._may_predict(best) and predicts(self.problem, best, winner))

    def _added(self, so_far: Selection, winner: Fit, fitted: dict[str, Fit]) -> Selection:
        best, term = so_far.fit, winner.hypothesis.terms[-1].name
        gain, above = best.cost - winner.cost, self.problem.above(best.residual)
        alike = {n: f.cost - winner.cost for n, f in fitted.items() if n != term and self.as_good(f, winner)}
        self.progress(f"{term} takes {share(gain, above)} of what is above noise")
        added = Selected(term, gain, alike)
        history = [*so_far.history, self.in_every_unit(winner)]
        longer = replace(so_far, history=history, selected=[*so_far.selected, added])
        found = without_needless(self.problem, longer)
        for s in longer.selected:
            if s not in found.selected:
                self.progress(f"{s.term} is no longer needed")
        return found

    def search(self, history: Sequence[Fit]) -> tuple[list[Score], dict[str, Fit], Fit | None]:
        """(ranking, fits of the leading candidates, the best of them if the evidence demands it).

        After the first term the candidates are those that the base model's sensitivities point to; all terms are looked
        at again where these lead nowhere.
        """
        best = history[-1]
        active = {a.name for a in best.hypothesis.terms}
        ranked: list[Score] = []
        found: dict[str, Fit] = {}
        for only in (self.pointed_to(history, active), None) if active else (None,):
            columns = self.scan.columns(best, skip=active, only=only)
            if not active:
                self._columns = columns
            ranked = scores(self.problem, best, columns)
            own = [s for s in ranked if s.term.name not in self.scan.indistinguishable]  # not fitted twice
            if active and self._is_background(best, own):
                found = self._from_afar(best, active)
                first = next(iter(found.values()), best)
                return ranked, found, first if best.cost - first.cost >= self.problem.evidence else None
            beside = bool(active) and self._may_predict(best)
            some = own[:BESIDE] if beside and not self.problem.onsets else own
            found = self.competition.fits(best, some, thresholds.WORTH_FITTING * self.problem.evidence)
            may = [f for f in found.values() if not (beside and self._is_patch(best, f))]
            winner = min(may, key=lambda f: f.cost, default=None)
            if winner is not None and best.cost - winner.cost >= self.problem.evidence:
                return ranked, found, winner
            if beside:
                break
        return ranked, found, None

    def _is_background(self, best: Fit, ranked: Sequence[Score]) -> bool:
        """Whether no later term is predicted to take what it must: fits would be rejected as patches.

        Of what stands out sensitivities predict too little; there it is enough that one does well as it is.
        """
        above = self.problem.above(best.residual)
        gain = max((s.gain for s in ranked), default=0.0)
        if gain >= (thresholds.LEAST if self._may_predict(best) else thresholds.HOLDS) * above:
            return False
        if gain >= thresholds.LEAST * above and self.problem.stands_out(best.residual):
            as_they_are = best.chi2 - min(self.competition.sized(best, s.active)[1] for s in ranked[:POSSIBLE])
            gain = max(gain, as_they_are)
            if gain >= thresholds.WORTH_FITTING * above:
                return False
        self.progress(f"the best further term is predicted to take {share(gain, above)} of what is left: a background")
        return True

    def _from_afar(self, best: Fit, active: Collection[str]) -> dict[str, Fit]:
        """See look_from_afar; where what is left stands out."""
        if not self.problem.stands_out(best.residual):
            return {}
        self.progress("trying further terms at sizes far from none")
        known = {*active, *self.scan.indistinguishable}
        return look_from_afar(self.problem, best, [c for c in self._columns if c.term.name not in known])

    def setting_in(self, best: Fit, onset: float) -> Fit | None:
        """The best listed term that is off until about then, beside a fit. None: none can be simulated.

        What sets in over an angle is a jump first, of which a gap takes a part: secants of other lengths show more of
        it. An eccentric pulley that takes 97 % was turned by a radian by the first (machine 239/1).
        """
        active = {a.name for a in best.hypothesis.terms}
        self.progress(f"terms that set in at {onset:.3g} s")
        found = scores(self.problem, best, self.scan.setting_in(best, onset, skip=active))[: 2 * FITTED]
        waves = [s for s in found if s.term.phase][:FITTED]
        for part in SECANTS if waves else ():
            found += scores(self.problem, best, self.scan.secants(best, waves, onset, part))
        return self.competition.setting_in(best, found, onset)

    def predicted_share(self, best: Fit) -> float:
        """Share of what a fit leaves above noise that a term which acts for the whole time would take."""
        ranked = scores(self.problem, best, self.scan.columns(best))
        gain = max((s.gain for s in ranked if not s.term.episode), default=0.0)
        return gain / self.problem.above(best.residual)

    def in_every_unit(self, winner: Fit) -> Fit:
        """Where the last term is as large as it can be, the same term also in the unit that responds alike.

        All of a shaft's friction rests on bristles: the motor's is half of it.
        """
        at = winner.settled()
        last = at.hypothesis.terms[-1]
        k = next(k for k, c in enumerate(at.hypothesis.coordinates) if c.names[0] == last.term.amplitude)
        if at.x[k] < at.hypothesis.coordinates[k].upper - 1e-6:
            return winner
        others = self.scan.alike(last.name) - {last.name}
        for other in (t for t in self.scan.terms if t.name in others):
            values = {name.replace(last.name, other.name, 1): value for name, value in last.values.items()}
            found = fit_added(self.problem, winner, [replace(last, term=other, values=values)], finished(2, steps=15))
            if found is not None and winner.cost - found.cost > self.problem.evidence:
                self.progress(f"{other.name} as well")
                winner = found
        return winner

    def pointed_to(self, history: Sequence[Fit], active: Collection[str]) -> set[str]:
        """Terms that lead by the base model's sensitivities."""
        self._columns = self._columns or self.scan.columns(history[0])
        ranked = scores(self.problem, history[-1], [c for c in self._columns if c.term.name not in active])
        return {s.term.name for s in ranked[:POINTED]}

    def to_its_end(self, best: Fit) -> Fit:
        """The fit itself, or a better one where its Jacobian still predicts what could be taken for a term.

        A large term's claim is checked without it anyhow, so that a small share of what is above noise may be left.
        """
        doubt = 0.5 * thresholds.BEYOND_DOUBT * self.problem.evidence
        may_leave = min(SETTLED * self.problem.above(best.residual), doubt)
        if predicted_decrease(best) < max(self.problem.evidence, may_leave):
            return best
        found = fit(self.problem, best.hypothesis, best.x, None, finished(3, steps=30))
        return found if found is not None and found.cost < best.cost else best

    def _led_out(self, best: Fit) -> Fit:
        """Loads must take nearly all: where they leave what stands out, led out of local minima as often as that helps.
        One had taken 77 %, 84 % after the first time, 99 % after the second (machine 239/35)."""
        loads = any(active.term.episode for active in best.hypothesis.terms)
        if not loads or not self.problem.stands_out(best.residual):
            return best
        return out_of_local_minimum(self.problem, best, finished(1), LED_OUT)

    def with_onsets(self, best: Fit) -> Fit:
        """With the onsets of several terms looked at once more: they were found while the last was off. Of one term,
        too, where it leaves what stands out: its own was found while all else made up for it, and a sensor's low-pass a
        tenth of a second late left eighty times as much (machine 193/51). Not of a wave: free runs lose the angle that
        it goes by."""
        terms = best.hypothesis.terms
        late = [k for k, active in enumerate(terms) if active.onset is not None]
        alone = len(terms) == 1
        if alone and (terms[0].term.phase is not None or not self.problem.stands_out(best.residual)):
            return best
        for _ in range(PASSES if late else 0):
            before = best.cost
            for k in late:
                if best.hypothesis.terms[k].onset is None or not self.problem.unexplained(best.residual):
                    continue
                best = min(best, self.competition.with_onset(best, k), key=attrgetter("cost"))
                always = self.competition.from_start(best, k)
                best = always if always is not None and always.cost < best.cost + thresholds.ALIKE else best
            if before - best.cost < self.problem.evidence:
                break
        return best

    def without_last(self, best: Fit, winner: Fit) -> Fit | None:
        """What went before, fitted from where the winner has it, its last term's share taken over by the others.

        A fit that ended early, or in a local minimum, leaves room for a term that only helps it on. What may stand in
        for the term is asked of its own unit's parameters first: a gap that is too narrow is a gap. None: it is beyond
        doubt that the term is needed.
        """
        coordinates, term = winner.hypothesis.coordinates, winner.hypothesis.terms[-1].term
        count = len(best.x)  # the winner's coordinates are those of the fit before, then its last term's
        last = [k for k, c in enumerate(coordinates) if c.names[0] == term.amplitude]
        J = self.renewed(winner, [k for k in range(count) if coordinates[k].component == term.component])
        needed = loss_without(replace(winner, jacobian=J), term.name) > thresholds.BEYOND_DOUBT * self.problem.evidence
        J = J if needed else self.renewed(winner, range(len(coordinates)))
        stands_in = np.linalg.lstsq(J[:, :count], J[:, last] @ winner.x[last], rcond=SUBSET)[0]
        hypothesis = replace(winner.hypothesis, effects=winner.hypothesis.effects[:-1])
        begun = fit(self.problem, hypothesis, winner.x[:count] + stands_in, J[:, :count], finished(0, steps=4))
        if begun is None or (needed and begun.cost >= best.cost):
            return None
        early = best.cost - begun.cost < thresholds.ENDED_EARLY * (best.cost - winner.cost)
        goes_on = predicted_decrease(begun) > thresholds.HOLDS * (begun.cost - winner.cost)
        return begun if early and (needed or not goes_on) else fit_on(self.problem, begun, finished(2, steps=15))

    def renewed(self, found: Fit, columns: Sequence[int]) -> Vector:
        """The fit's Jacobian, these columns by differences where it stands; as it is where that cannot be simulated."""
        J = found.jacobian.copy()
        fresh = difference(self.problem, found.hypothesis, found.x, found.simulated, columns) if columns else None
        if fresh is not None:
            J[:, columns] = fresh
        return J

    def as_good(self, fit: Fit, best: Fit) -> bool:
        """Whether a fit cannot be told from the best."""
        left = max(self.problem.excess(best.residual), 0.0)
        return fit.cost - best.cost < thresholds.ALIKE + thresholds.ALIKE_SHARE * left


def _begins(active: ActiveTerm) -> float | None:
    """s; from when on a term acts. None: from the start."""
    return active.values[active.term.episode[0]] if active.term.episode else active.onset


def share(part: float, whole: float) -> str:
    """63 %; never more than all: a term may take what a prior held back as well."""
    return f"{100 * min(part / max(whole, 1e-300), 1.0):.3g} %"
