"""A base parameter outside its tolerance, before physics that imitates it.

On real machines a data sheet is wrong more often than physics is missing. So where a re-fitted parameter presses
against its tolerance, that bound alone is let go: where this leaves no more than listed terms do, it is the finding.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.effects import FreeParameter, PortSignal
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import fit
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.findings import Estimate, Finding
from cobot_joint.diagnosis.localization.evidence import where_it_gains
from cobot_joint.diagnosis.selection.competition import finished
from cobot_joint.diagnosis.selection.confidence import beside_background, confidence
from cobot_joint.diagnosis.selection.elimination import kept_beside, without, without_terms
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.stepwise import share
from cobot_joint.diagnosis.selection.tolerances.letting_go import (
    freed,
    held,
    in_its_place,
    leaves_least,
    left_by_parameters,
    nearby,
    needed,
    slack_of,
)
from cobot_joint.diagnosis.selection.unlisted.remains import remains
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled

LETTING_GO = "letting go of parameters, one at a time"

Select = Callable[[Fit], Selection]
Say = Callable[[str], None]


@dataclass
class Outside:
    """The base model with one parameter beyond its tolerance, and listed terms beside it.

    gain: cost that the parameter takes from the calibrated one, or from the fit with what is beside it. alike: listed
    terms and other parameters that cannot be told from it.
    """

    selection: Selection
    gain: float
    alike: tuple[str, ...]

    @property
    def fit(self) -> Fit:
        """With the terms."""
        return self.selection.fit

    @property
    def name(self) -> str:
        """`component.parameter`"""
        return next(e.name for e in self.fit.hypothesis.effects if isinstance(e, FreeParameter))

    def with_formula(self, problem: Problem, found: Unmodelled) -> Outside | None:
        """Beside what is on no list, and the listed terms that stay with it. None: beside these it is not needed."""
        gain = needed(problem, found.fit)
        if gain is None:
            return None
        selection = replace(self.selection, history=[self.selection.history[0], found.fit], selected=found.selected)
        return Outside(selection, gain, ())

    def gives_way(self, problem: Problem, formula: Unmodelled) -> bool:
        """Whether a formula is the answer instead: it leaves so much less, or less, and the parameter is no claim."""
        if formula.outdoes(problem, self.fit):
            return True
        left, rest = remains(problem, self.fit, formula.fit)
        return formula.is_likely and left > formula.freedom * rest and self.confidence(problem) < thresholds.EVEN

    def stands(self, problem: Problem, calibrated: Fit, formula: Unmodelled) -> bool:
        """Whether it leaves next to nothing by itself, and a formula not so much less: a load 30 % too heavy left
        1.1 %, a constant torque 0.6 %."""
        alone = not self.selection.selected and _leaves_next_to_nothing(problem, calibrated, self.fit)
        return alone and not formula.outdoes(problem, self.fit)

    def confidence(self, problem: Problem) -> float:
        """In the parameter: by the share that it takes, or by how little is left."""
        left, excess = problem.above(self.fit.residual), max(problem.excess(self.fit.residual), 0.0)
        rows = problem.is_table and problem.unexplained(self.fit.residual)
        much = rows or excess > thresholds.CLEARLY_LEFT * problem.excess_scatter
        return beside_background(self.gain / (self.gain + left)) if much else confidence(self.gain, excess)

    def finding(self, problem: Problem, calibrated: Fit, repaired: Mapping[str, Estimate]) -> Finding:
        """As a diagnosis says it. No claim where it ends as far off as it may be, and that is not enough: a brake
        without torque stood in for a stiffness that gave way (machine 109/28), a tenth of a gear's friction beside
        windage for a cubic drag (machine 167/49). repaired: parameters as they were fitted.
        """
        short = repaired[self.name].at and problem.unexplained(self.fit.residual)
        found = Finding(
            term=self.name,
            equivalent=self.alike[: thresholds.MOST_NAMES - 1],
            confidence=self.confidence(problem),
            onset=None,
            parameters={self.name: repaired[self.name]},
            where=where_it_gains(problem, calibrated.residual**2 - self.fit.residual**2),
            gain=self.gain,
        )
        return found.withheld("it is as far off as it may be, and that is not enough") if short else found


def look_outside(
    problem: Problem, calibrated: Fit, explained: Fit, selected: Sequence[Selected], select: Select, say: Say
) -> Outside | Selection | None:
    """None: no parameter presses against a bound, or letting go of it leaves more than the listed terms do. A
    Selection: listed terms that were found beside it, and leave less than `explained` without it.

    explained: the fit with these terms, or the calibrated one where there are none; then half of what is above noise
    has to be taken, or of what is slow in it. select: listed terms from a fit on: of several terms the first may have
    stood in for a parameter, and where they leave what stands out, both may be missing.
    """
    if not problem.unexplained(calibrated.residual):
        return None
    say(LETTING_GO)
    first = max((s.gain for s in selected), default=0.0)
    taken = calibrated.cost - explained.cost if selected else thresholds.HOLDS * problem.above(calibrated.residual)
    beside = problem.stands_out(explained.residual)
    best = leaves_least(problem, calibrated, thresholds.WORTH_FITTING * max(taken if len(selected) < 2 else first, 0.0))
    gain = calibrated.cost - best.cost if best is not None else 0.0
    if best is not None and gain >= problem.evidence:
        slack = slack_of(problem, explained)
        leads = _leads(problem, calibrated, best, selected)
        alone = leads or _does_as_well(problem, calibrated, explained, best, selected, taken)
        instead = len(selected) > 1 and gain >= thresholds.ALONE * first
        more = _with_terms(problem, calibrated, best, select) if alone or instead or beside else None
        needs_fewer = (
            more is not None and more.fit.cost <= explained.cost + slack and len(more.selected) < len(selected)
        )
        if more is not None and (alone or (instead and needs_fewer) or _leaves_less(problem, more.fit, explained)):
            without_it = _needless(problem, calibrated, best, more)
            if without_it and problem.excess(without_it.fit.residual) < problem.excess(explained.residual):
                return without_it
            as_good = len(selected) == 1 and explained.cost - best.cost < slack
            listed = (selected[0].term, *selected[0].alike) if as_good else ()
            found = Outside(more, gain, (*listed, *in_its_place(problem, calibrated, best)))
            say(f"{found.name} outside its tolerance leaves no more")
            return found
    one = _in_place_of_one(problem, calibrated, explained, selected, say) if len(selected) > 1 else None
    return one or (_beside(problem, calibrated, explained, selected, say) if beside and selected else None)


def nearly_alone(problem: Problem, listed: Selection, select: Select, say: Say) -> Outside | None:
    """A parameter that takes nearly all, where listed terms leave what stands out, and several times as much or are one
    that takes no more; and those beside it. Asked before formulas, one of which imitates a wrong inertia in minutes.

    None: there is none, or the terms leave no more without it.
    """
    calibrated = listed.history[0]
    if not problem.stands_out(listed.fit.residual):
        return None
    say(LETTING_GO)
    above = problem.above(calibrated.residual)
    best = nearby(problem, calibrated, thresholds.HOLDS * above, tried=2)
    if best is None or problem.above(best.residual) > thresholds.REMAINDER * above:
        return None
    left, rest = remains(problem, listed.fit, best)
    behind, slack = best.cost - listed.fit.cost, slack_of(problem, listed.fit)
    as_one = len(listed.selected) == 1 and behind < slack
    if left < thresholds.TIMES_LESS * rest and not as_one:
        return None
    more = _with_terms(problem, calibrated, best, select)
    if _needless(problem, calibrated, best, more):
        return None
    alike = (listed.selected[0].term, *listed.selected[0].alike) if as_one and behind > -slack else ()
    found = Outside(more, calibrated.cost - best.cost, (*alike, *in_its_place(problem, calibrated, best)))
    say(f"{found.name} outside its tolerance takes {share(found.gain, above)} of what is above noise")
    return found


def beside_load(problem: Problem, listed: Selection, say: Say) -> Outside | None:
    """A parameter with which loads take nearly all, which they must to be named, and without it do not: a hand at the
    brake took 59 % beside an inertia of twice its data sheet's (machine 233/39). None: there is no such parameter."""
    calibrated, left = listed.history[0], problem.above(listed.fit.residual)
    loads = any(active.term.episode for active in listed.fit.hypothesis.terms)
    if not loads or not problem.stands_out(listed.fit.residual):
        return None
    say(LETTING_GO)
    best = leaves_least(problem, listed.fit, thresholds.HOLDS * left, tried=1)
    enough = (1 - thresholds.LOADS_TAKE) * problem.above(calibrated.residual)
    gain = needed(problem, best) if best is not None and problem.above(best.residual) < enough else None
    worth = _worth(problem, best, listed.selected) if best is not None and gain is not None else []
    kept = len(worth) == len(listed.selected) and all(term.gain >= problem.evidence for term in worth)
    if best is None or gain is None or not kept:
        return None
    others = in_its_place(problem, listed.fit, best)
    found = Outside(replace(listed, history=[calibrated, best], selected=worth), gain, others)
    say(f"{found.name} outside its tolerance takes {share(gain, left)} of what the load leaves")
    return found


def let_go(
    problem: Problem, calibrated: Fit, value: Mapping[str, float], alike: tuple[str, ...], select: Select
) -> Outside | None:
    """One parameter free of its tolerance, from a value on, and the listed terms that `select` finds beside it. None:
    it takes nothing from free runs, is not needed beside these terms, or may not go beyond its tolerance."""
    free = next((each for each in freed(calibrated, value) if each.hypothesis.effects[-1].name in value), None)
    best = fit(problem, free.hypothesis, free.x, None, finished(1)) if free else None
    if best is None or calibrated.cost - best.cost < problem.evidence:
        return None
    more = _with_terms(problem, calibrated, best, select)
    gain = needed(problem, more.fit) if more.selected else calibrated.cost - best.cost
    return Outside(more, gain, alike) if gain is not None else None


def beside_listed(problem: Problem, outside: Fit, formula: Unmodelled, select: Select) -> Outside | None:
    """A parameter with listed terms that do as well beside it as the formula does: a sensor's offset is no constant on
    no list (machine 227/26). None: there are none, or the formula outdoes them, or the parameter is not needed.

    outside: with the parameter, without the formula.
    """
    more = select(outside)
    if not more.selected or formula.outdoes(problem, more.fit):
        return None
    gain = needed(problem, more.fit)
    return Outside(more, gain, ()) if gain is not None else None


def in_place_of(problem: Problem, calibrated: Fit, formula: Unmodelled, say: Say) -> Outside | None:
    """The parameter that does as well as a formula beside listed terms, which does not outdo it: a voltage that goes as
    the current is a resistance (machine 127/12). None: there are no such terms, or no such parameter."""
    rest = without(problem, formula.fit, lambda effect: isinstance(effect, PortSignal)) if formula.selected else None
    least = thresholds.HOLDS * problem.above(rest.residual) if rest is not None else 0.0
    best = leaves_least(problem, rest, least) if rest is not None else None
    if best is None or rest is None or formula.outdoes(problem, best):
        return None
    found = Outside(Selection([calibrated, best], formula.selected), rest.cost - best.cost, ())
    say(f"{found.name} outside its tolerance does as well as the signal at {formula.finding.component}")
    return found


def _does_as_well(
    problem: Problem, calibrated: Fit, explained: Fit, best: Fit, selected: Sequence[Selected], taken: float
) -> bool:
    """Whether a parameter alone takes what the listed terms do, or what was to be taken where there are none."""
    gain = calibrated.cost - best.cost
    if not selected:
        return gain >= taken or _takes_what_is_slow(problem, calibrated, explained, best)
    nearly = max(slack_of(problem, explained), _hardly_less(problem, explained, selected, taken))
    strained = [found.is_strained(problem.stretches(found.residual)) for found in (explained, best)]
    return gain >= taken - nearly or (strained == [True, False] and gain >= thresholds.ABREAST * taken)


def _leads(problem: Problem, calibrated: Fit, best: Fit, selected: Sequence[Selected]) -> bool:
    """Whether it takes more than the first of several listed terms and leaves next to nothing: that they leave less
    proves nothing. A load 30 % too heavy was two frictions."""
    more = calibrated.cost - best.cost >= max((s.gain for s in selected), default=0.0)
    return len(selected) > 1 and more and _leaves_next_to_nothing(problem, calibrated, best)


def _leaves_next_to_nothing(problem: Problem, calibrated: Fit, best: Fit) -> bool:
    return problem.above(best.residual) < thresholds.NO_PROOF * problem.above(calibrated.residual)


def _with_terms(problem: Problem, calibrated: Fit, best: Fit, select: Select) -> Selection:
    """Listed terms beside a parameter, where it leaves something; of next to nothing they have to take half: a friction
    by direction had taken 40 % of the hundredth that a load leaves that was too heavy, and the mass with it."""
    if not problem.unexplained(best.residual):
        return Selection([best])
    more, half = select(best), (1 - thresholds.HOLDS) * problem.above(best.residual)
    patches = _leaves_next_to_nothing(problem, calibrated, best) and problem.above(more.fit.residual) > half
    return Selection([best]) if patches else more


def _in_place_of_one(
    problem: Problem, calibrated: Fit, explained: Fit, selected: Sequence[Selected], say: Say
) -> Outside | None:
    """A parameter that does as well as one of several listed terms, beside the others: a sensor's gain of 3 % had stood
    in for a brake's torque per ampere, and a dead time without an edge for a winding's resistance. As well: the term
    leaves less by no more than a further one would need to take."""
    slack = _worth_a_term(problem, explained)
    for term in sorted(selected, key=lambda s: s.gain):
        if not _parameters_do(problem, explained, term):
            continue
        rest = without_terms(problem, explained, {term.term})
        best = nearby(problem, rest, thresholds.ALONE * (rest.cost - explained.cost), 1) if rest is not None else None
        if (
            rest is None
            or best is None
            or best.cost > explained.cost + slack
            or rest.cost - best.cost < problem.evidence
        ):
            continue
        kept = [s for s in selected if s is not term]
        alike = (term.term, *term.alike) if explained.cost - best.cost < slack else ()
        alike = *alike, *in_its_place(problem, rest, best)
        found = Outside(Selection([calibrated, best], kept), rest.cost - best.cost, alike)
        say(f"{found.name} outside its tolerance does as well as {term.term}")
        return found
    return None


def _beside(
    problem: Problem, calibrated: Fit, explained: Fit, selected: Sequence[Selected], say: Say
) -> Outside | None:
    """A parameter that listed terms need as well: beside them, or those that it makes needless, it leaves a third."""
    best = leaves_least(problem, explained, thresholds.WORTH * problem.above(explained.residual), tried=1)
    if best is None or not _leaves_less(problem, best, explained):
        return None
    fewer, kept = kept_beside(problem, best, selected)
    if not _leaves_less(problem, fewer, explained):
        fewer, kept = best, list(selected)
    gain = needed(problem, fewer)
    if gain is None:
        return None
    found = Outside(Selection([calibrated, fewer], kept), gain, in_its_place(problem, explained, best))
    say(f"{found.name} outside its tolerance leaves a third of what the terms leave")
    return found


def _hardly_less(problem: Problem, explained: Fit, selected: Sequence[Selected], taken: float) -> float:
    """Cost by which one listed term has to leave less than a parameter to be the answer: where parameters do most of
    what it does, as much as a further number would need to take. A load 30 % too heavy was a friction by direction."""
    if len(selected) == 1 and _parameters_do(problem, explained, selected[0]):
        return _worth_a_term(problem, explained)
    return thresholds.HARDLY_LEFT_SHARE * taken if _beyond_what_was_driven(explained) else 0.0


def _worth_a_term(problem: Problem, explained: Fit) -> float:
    return thresholds.ALIKE + thresholds.WORTH * problem.above(explained.residual)


def _parameters_do(problem: Problem, explained: Fit, term: Selected) -> bool:
    """Whether all base parameters together, wherever their bounds are, do half of what a listed term does."""
    return left_by_parameters(explained, term.term) <= thresholds.HOLDS * max(term.gain, problem.evidence)


def _beyond_what_was_driven(explained: Fit) -> bool:
    """Whether it has one term, whose curve over speed bends beyond the highest speed driven: it acts as a base
    parameter does, and its number more takes what is left of other things."""
    terms = explained.settled().hypothesis.terms
    return len(terms) == 1 and any(terms[0].values[s.name] > s.reached for s in terms[0].term.shapes)


def _takes_what_is_slow(problem: Problem, calibrated: Fit, explained: Fit, best: Fit) -> bool:
    """Whether it takes half of a slow part that stands out, and no less of it than `explained`: impacts, out of step
    with a gap that grew, are the larger part of chi-square, and no parameter's (machine 163/42)."""
    slow, other, left = (problem.excess(each.residual) for each in (calibrated, explained, best))
    much = slow > thresholds.LEFT_SIGMA**2 * problem.samples
    return much and left < (1 - thresholds.HOLDS) * slow and left <= other


def _needless(problem: Problem, calibrated: Fit, alone: Fit, more: Selection) -> Selection | None:
    """The listed terms beside a parameter, without it, where it leaves far more without them, and they no more without
    it: it stood in for them while they were found (machine 151/10). None: it is needed."""
    if not more.selected or not _leaves_less(problem, more.fit, alone):
        return None
    inside = held(problem, more.fit)
    if inside is None or _leaves_less(problem, more.fit, inside):
        return None
    inside, kept = kept_beside(problem, inside, more.selected)
    worth = _worth(problem, inside, kept)
    return replace(more, history=[calibrated, inside], selected=worth) if worth and len(worth) == len(kept) else None


def _worth(problem: Problem, fit: Fit, selected: Sequence[Selected]) -> list[Selected]:
    """Terms, each with what the fit loses without it now; those that it can be simulated without."""
    rests = [without_terms(problem, fit, {term.term}) for term in selected]
    return [replace(s, gain=r.cost - fit.cost) for s, r in zip(selected, rests, strict=True) if r is not None]


def _leaves_less(problem: Problem, fit: Fit, other: Fit) -> bool:
    """Whether it leaves so much less that one number more does not account for it."""
    left = max(problem.excess(fit.residual), problem.excess_scatter)
    return thresholds.TIMES_LESS * left < problem.excess(other.residual)
