"""What listed terms leave: to a formula, to a formula and a term together, to the recorded motion, or to nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from operator import attrgetter

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.anchored.follow import can_follow, follow, motion_is_given, where_it_lies
from cobot_joint.diagnosis.anchored.free_runs import beside_listed, felt, freely
from cobot_joint.diagnosis.anchored.search import Search, confidence
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.estimation.calibrate import basis
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.explanation.closed_loop import chi2_in_closed_loop
from cobot_joint.diagnosis.explanation.explanation import Explanation, sure_beside_background
from cobot_joint.diagnosis.explanation.waves import hides_a_wave, in_place_of, repeats, without_waves
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.selection.confidence import beside_background
from cobot_joint.diagnosis.selection.elimination import prune, worth_naming
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.some_recordings import some_of
from cobot_joint.diagnosis.selection.stepwise import Selector
from cobot_joint.diagnosis.selection.tolerances.outside import Outside
from cobot_joint.diagnosis.selection.unlisted.held_against import look_beside, look_for_unmodelled
from cobot_joint.diagnosis.selection.unlisted.remains import remains
from cobot_joint.diagnosis.selection.unlisted.together import Pair, look_together
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled
from cobot_joint.diagnosis.store import Store

Progress = Callable[[str], None]
MOTIONS = 0.3  # of a time that is limited, that formulas leave to the recorded motion, which else is never asked


class BeyondTheList:
    """Asks in turn for what listed terms may have missed.

    listed: the base model, and what was selected. beside: selects terms beside something else.
    """

    def __init__(
        self, campaign: Campaign, problem: Problem, listed: Selection, beside: Selector, say: Progress, store: Store
    ) -> None:
        self.campaign, self.problem, self.listed = campaign, problem, listed
        self.beside, self.say, self.store = beside, say, store
        self.calibrated, self.stage = listed.history[0], problem.budget.stage
        self.left, self.before = (problem.excess(fit.residual) for fit in (listed.fit, self.calibrated))
        self.stands_out = problem.stands_out(listed.fit.residual)
        self.follows, self.given = can_follow(campaign, problem.plant), motion_is_given(campaign)
        self.takes_most, self.much = takes_most(problem, listed), much_is_left(problem, listed)
        self._freely: tuple[Search, tuple[Fit, list[Selected]] | None] | None = None

    def explanation(self) -> Explanation:
        """The listed terms alone where nothing else does better.

        Where terms that take most leave what stands out, the recorded motion is asked for others beside them. A formula
        over an angle gives way to a listed wave that does as well by the recorded angle, and to what the motion claims.
        """
        formula, rival = self._formula()
        if formula and (not self._beside_background or self._leaves_nothing(formula)):
            return self._of(formula)
        if formula and formula.is_likely and self._is_lost(formula) and (wave := self._listed_wave(formula)):
            return wave
        outdone = bool(formula and formula.is_likely and formula.outdoes(self.problem, self.listed.fit))
        if pair := self._pair(formula, rival):
            if isinstance(pair, Outside):
                return self._of_outside(pair)
            if pair.outside or not self._is_lost(pair.formula):
                return self._of(pair.formula, pair.outside)
            formula, outdone = pair.formula, True
        lost = outdone and bool(formula and formula.is_wave)
        found = self._along_the_motion(formula, outdone, lost)
        lost = lost and not self._outdoes_claimed(formula, found)
        if found and (better := self._from_the_motion(found, formula)):
            return better
        if found and self.takes_most:
            if (lost or not formula) and (both := beside_listed(self.problem, self.listed, found)):
                return Explanation(self.calibrated, both[0], self.listed, both[1], anchored=found, rival=rival)
            found = found if lost else None
        if found and self._supports_listed(found, formula):
            return self._of_listed(self._stands, anchored=found, rival=rival)
        if formula and formula.is_likely and ((outdone and not (found and lost)) or not self._claims(found, formula)):
            pair = self._together(formula, formula) if self._is_lost(formula) else None
            if isinstance(pair, Outside):
                return self._of_outside(pair)
            return self._of(pair.formula, pair.outside) if pair else self._of(formula)
        if found and (any(n.shows for n in found.named) or not self._stands):
            return self._beside_the_claimed(found) or self._closest(found)
        named = self._of_what_is_worth_a_name(rival)
        return replace(named, gave_way=formula if formula and formula.is_likely else None)

    @property
    def _beside_background(self) -> bool:
        """A formula has to be predicted to take as much as listed terms take, and most of it."""
        return self.takes_most or self.follows

    @property
    def _stands(self) -> list[Selected]:
        """Listed terms, where they leave little."""
        return self.listed.selected if self.left < thresholds.REMAINDER * self.before else []

    def _closest(self, found: Search) -> Explanation:
        """What the motion says. Where it names nothing, with listed terms that take half of what is above noise: no
        claim, yet not to be called diffuse (machine 227/9: a gear's error that took 68 %)."""
        sure, least = sure_beside_background(self.problem, self.listed), beside_background(thresholds.HOLDS)
        selected = self.listed.selected
        if found.named or not selected or any(sure.get(s.term, 0.0) < least for s in selected):
            return self._of_listed([], anchored=found)
        return replace(self._of_listed(selected, anchored=found), background=found.background)

    def _formula(self) -> tuple[Unmodelled | None, Unmodelled | None]:
        """(what is on no list, or a rival of listed terms that does not prove them wrong), one of them or neither."""
        doubtful = self.listed.imitates or self.stands_out
        taken = 0.0 if doubtful else 1 - self.left / max(self.before, 1e-9)
        least = max(thresholds.ALONE, taken) if self._beside_background else 0.0
        look = partial(look_for_unmodelled, self.problem, self.calibrated, self.listed, self.say, least)
        found = self.stage("formulas", look, MOTIONS if self.follows else 0.0) if self.much else None
        if found and self._fails_in_closed_loop(found):
            found = None
        return (None, found) if found and found.as_good else (found, None)

    def _fails_in_closed_loop(self, formula: Unmodelled) -> bool:
        """Whether listed terms leave less than the formula does by the motion that it leads to: of a machine that
        sticks, a formula along the recorded motion knows when, and took the place of Stribeck friction. Of one that
        goes by an angle that free runs lose, the whole, or what goes by no angle, has to leave no more than the base
        model does."""
        if not self.listed.selected or not formula.goes_by_signals:
            return False
        lost, rest = self._is_lost(formula), without_waves(formula)
        if lost and rest is None:
            return False
        if not isinstance(self.problem.plant, FmuPlant):
            return False
        other, words = (self.calibrated, "nothing added") if lost else (self.listed.fit, "listed terms")
        for tested in (formula, rest) if lost and rest else (formula,):
            left = chi2_in_closed_loop(self.problem, self.campaign.systems(), tested)
            if left is not None and left <= other.chi2:
                return False
        why = "cannot be simulated" if left is None else f"leaves more than {words}"
        self.say(f"{formula.finding.term} by the motion that it leads to {why}")
        return True

    def _leaves_nothing(self, formula: Unmodelled) -> bool:
        """Whether it leaves no background, which a formula follows as well as an effect."""
        return self.problem.excess(formula.fit.residual) < thresholds.UNDECIDED * self.problem.excess_scatter

    def _is_lost(self, formula: Unmodelled) -> bool:
        """Whether it goes by an angle that free runs lose and the recorded motion has."""
        return self.follows and formula.is_wave

    def _listed_wave(self, formula: Unmodelled) -> Explanation | None:
        """A listed wave that does as well as a formula whose angle free runs have lost, both by the recorded angle.
        None: the formula leaves so much less that its freedom does not account for it."""
        look = partial(in_place_of, self.problem, formula, self.beside.probes(self.calibrated))
        fits = self.stage("listed waves", look) or []
        if not fits or formula.outdoes(self.problem, fits[0]):
            return None
        best, *others = fits
        alike = {f.hypothesis.terms[-1].name: f.cost - best.cost for f in others if self.beside.as_good(f, best)}
        name = best.hypothesis.terms[-1].name
        self.say(f"{name}, by the recorded angle, does as well as the formula")
        gain = formula.finding.gain + formula.fit.cost - best.cost
        selected = [*formula.selected, Selected(name, gain, alike)]
        listed = replace(self.listed, history=[self.calibrated, best], selected=selected)
        return Explanation(self.calibrated, best, listed, selected)

    def _pair(self, formula: Unmodelled | None, rival: Unmodelled | None) -> Pair | Outside | None:
        """What is on no list, and a listed term or a parameter, where listed terms leave what stands out, and the best
        formula does, too: neither may show what it is without the other. Where listed terms take most, beside such a
        formula only. What goes by an angle that free runs lose is asked of the motion first."""
        likely = next((f for f in (formula, rival) if f and f.is_likely), None)
        return None if likely and self._is_lost(likely) else self._together(formula, likely)

    def _together(self, formula: Unmodelled | None, likely: Unmodelled | None) -> Pair | Outside | None:
        """likely: the formula, or a rival of listed terms, if one of them is."""
        if not self.much or self.given or self.problem.is_table:
            return None
        out = self.stands_out and (likely is None or self.problem.stands_out(likely.fit.residual))
        alone = likely is not None and not likely.selected
        if not out or not (alone or self.left > thresholds.TERMS_STAND * self.before):
            return None
        look = partial(look_together, self.problem, self.listed, likely or formula, self.beside, self.say)
        return self.stage("a formula and something beside it", look)

    def _along_the_motion(self, formula: Unmodelled | None, outdone: bool, lost: bool) -> Search | None:
        """What the recorded motion says, where it may change the answer. Where motion is an input, free runs lose
        nothing."""
        if not self.much or not self.follows or self.given:
            return None
        settled = outdone and not lost and (self.takes_most or not self._stands)
        if settled and not (formula and hides_a_wave(self.problem, formula.fit)):
            return None
        if self.takes_most and not (lost or self.listed.imitates or self.stands_out):
            return None
        found = self.problem.budget.spend("the recorded motion", self._followed)
        return felt(self.problem, self.calibrated, self.listed.fit, found) if found and found.named else found

    def _followed(self) -> Search | None:
        in_runs = [c.term for ranked in self.listed.ranking[:1] for c in ranked]
        start = self.calibrated.run.values

        def on_the_way(words: str) -> None:
            self.problem.budget.check()
            self.say(words)

        along = partial(follow, self.campaign, self.problem.plant, on_the_way, in_runs, start)
        return self.store.remember("anchored", (basis(self.campaign), start), along)

    def _supports_listed(self, found: Search, formula: Unmodelled | None) -> bool:
        """Whether the motion names one of the listed terms that stand, other than those that stay with a formula."""
        heard = self._stands if self.takes_most else self._stands[:1]
        return any(found.supports(s.term) for s in heard if s.term not in staying(formula))

    def _from_the_motion(self, found: Search, formula: Unmodelled | None) -> Explanation | None:
        """The listed terms that take most, fitted from where the motion has them, where that leaves less: free runs
        that drift had cogging at another order. None: it names others, or a formula outdoes that."""
        selected = self.listed.selected if self.takes_most else []
        if not selected or {n.name for n in found.named} != {s.term for s in selected}:
            return None
        fit = freely(self.problem, found, self.calibrated)
        if fit is None or self.listed.fit.cost - fit.cost < self.problem.evidence:
            return None
        if formula and formula.is_likely and formula.outdoes(self.problem, fit):
            return None
        more = (self.listed.fit.cost - fit.cost) / len(selected)
        selected = [replace(s, gain=s.gain + more, alike={}) for s in selected]
        listed = replace(self.listed, history=[*self.listed.history[:-1], fit], selected=selected)
        return Explanation(self.calibrated, fit, listed, selected, anchored=found)

    def _claims(self, found: Search | None, formula: Unmodelled) -> bool:
        """Whether the motion claims a term other than those that stay with a formula; where it was not asked, whether
        listed terms take most."""
        if found is None:
            return self.takes_most
        if self._is_lost(formula) and self._outdoes_claimed(formula, found):
            return False
        stay = staying(formula)
        others = [n for n in found.named if not {n.name, *n.alike} & stay]
        return found.claims and (not stay or any(confidence(n) >= thresholds.EVEN for n in others))

    def _outdoes_claimed(self, formula: Unmodelled | None, found: Search | None) -> bool:
        """Whether all that the motion claims, fitted to free runs at the angles that the recordings have, takes less
        than half of them, or a formula leaves so much less. A wave that turns with the direction is no cogging
        (machines 163/88, 223/1)."""
        if formula is None or found is None:
            return False
        every = {n.name for n in found.named if n.shows}
        if not every or any(name in self.problem.plant.parameters for name in every):
            return False
        both = self._freely_with(found)
        fits = [both[0] if both else self.calibrated]
        if every == {s.term for s in self.listed.selected}:
            fits.append(self.listed.fit)
        claimed = min(fits, key=attrgetter("cost"))
        before, left = remains(self.problem, self.calibrated, claimed)
        return left > thresholds.HOLDS * before or formula.outdoes(self.problem, claimed)

    def _claimed_freely(self, found: Search) -> tuple[Fit, list[Selected]] | None:
        """All that the motion names, fitted to free runs; None: some of it does not help them."""
        both = self._freely_with(found)
        every = {n.name for n in found.named if n.shows}
        return both if both is not None and {s.term for s in both[1]} == every else None

    def _freely_with(self, found: Search) -> tuple[Fit, list[Selected]] | None:
        """What of it helps free runs, fitted once; None: nothing does."""
        if self._freely is None or self._freely[0] is not found:
            self._freely = found, beside_listed(self.problem, self.listed.up_to(0), found)
        return self._freely[1]

    def _beside_the_claimed(self, found: Search) -> Explanation | None:
        """What the motion names, and a formula where free runs with all of it leave what stands out: along the motion
        none is looked for. Not where it takes next to nothing of them: what they leave is then its own, its angle lost.
        """
        both = self._claimed_freely(found)
        above = self.problem.above(self.calibrated.residual)
        if both is None or self.calibrated.cost - both[0].cost < thresholds.WORTH * above:
            return None
        claimed = replace(self.listed.up_to(0), history=[self.calibrated, both[0]], selected=both[1])
        out = self.problem.stands_out(both[0].residual)
        formula = self.stage("formulas", partial(look_beside, self.problem, claimed, self.say)) if out else None
        if formula is None or formula.as_good or len(formula.selected) < len(both[1]) or repeats(formula, found):
            return None
        return Explanation(self.calibrated, formula.fit, claimed, formula.selected, formula, anchored=found)

    def _of(self, formula: Unmodelled, outside: Outside | None = None) -> Explanation:
        found = Explanation(self.calibrated, formula.fit, self.listed, formula.selected, formula)
        return replace(found, outside=outside)

    def _of_outside(self, found: Outside) -> Explanation:
        return Explanation(self.calibrated, found.fit, found.selection, found.selection.selected, outside=found)

    def _of_listed(self, selected: list[Selected], anchored: Search, rival: Unmodelled | None = None) -> Explanation:
        return Explanation(self.calibrated, self.listed.fit, self.listed, selected, anchored=anchored, rival=rival)

    def _of_what_is_worth_a_name(self, rival: Unmodelled | None) -> Explanation:
        """Listed terms without the last that explain too little. Where motion is an input, the one that does best is
        said to come nearest, and the recorded motion says where the rest lies."""
        problem, listed = self.problem, self.listed
        proven = worth_naming(problem, self.calibrated, listed) if problem.is_table else listed
        kept = proven if self.given else prune(problem, listed)
        some = replace(self.campaign, recordings=some_of(problem, self.calibrated)[0].recordings)
        lies = partial(where_it_lies, some, problem.plant, kept.fit.run, self.say)
        asked = self.given and self.much and self.follows and not self.takes_most
        rest = self.stage("where the rest lies", lies) if asked else None
        return Explanation(self.calibrated, kept.fit, listed, kept.selected, background=rest or [], rival=rival)


def staying(formula: Unmodelled | None) -> set[str]:
    """Listed terms that stay with a formula."""
    return {s.term for s in formula.selected} if formula else set()


def much_is_left(problem: Problem, listed: Selection) -> bool:
    """Whether listed terms leave more than noise does: several hardly do, unless together they imitate something."""
    left = listed.fit.residual
    several = len(listed.selected) > 1 and (listed.imitates or problem.unexplained(left))
    much = problem.excess(left) > thresholds.CLEARLY_LEFT * problem.excess_scatter
    return several or much or problem.stands_out(left)


def takes_most(problem: Problem, listed: Selection) -> bool:
    """Whether a listed term takes so much that, though more than noise is left, it is more likely right than not."""
    return max(sure_beside_background(problem, listed).values(), default=0.0) >= thresholds.EVEN
