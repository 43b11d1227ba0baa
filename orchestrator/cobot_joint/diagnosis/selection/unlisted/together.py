"""What is on no list, and a listed term or a parameter outside its tolerance, chosen together: neither shows what it is
while the other is left out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import itemgetter

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.effects import ActiveTerm, Effect, PortSignal
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.port_response import refit
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.selection.confidence import beside_background
from cobot_joint.diagnosis.selection.elimination import without
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.stepwise import Selector
from cobot_joint.diagnosis.selection.tolerances.letting_go import held, leaves_least
from cobot_joint.diagnosis.selection.tolerances.outside import Outside, beside_listed
from cobot_joint.diagnosis.selection.unlisted.places import pointed_to
from cobot_joint.diagnosis.selection.unlisted.remains import remains
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Say, Unmodelled, acts_where, look_at_ports

TRIED = 2  # ports whose first forms are followed by something else


@dataclass(frozen=True)
class Pair:
    """What is on no list, with the listed term that it has beside it, or else with this parameter."""

    formula: Unmodelled
    outside: Outside | None = None


def look_together(
    problem: Problem, listed: Selection, formula: Unmodelled | None, selector: Selector, say: Say
) -> Pair | Outside | None:
    """Forms at a port, the parameter or the listed term that does best beside them, and what does best beside that.
    None: no such pair explains the residual, or one of the two is not needed. Outside: listed terms do as well as the
    forms beside the parameter.

    listed: the base model, and with all listed terms that were selected without a formula. formula: the best alone.
    """
    say("looking for a parameter or a listed term beside what is on no list")
    alone = formula is not None and not formula.selected and formula.is_likely
    starts = [formula.fit] if formula and alone else _first_forms(problem, listed.history[0])
    others = [formula.fit] if formula else []
    for start in starts:
        if pair := _with_parameter(problem, listed, start, others, selector, say):
            return pair
    for start in starts:
        term = selector.round(Selection([start]))
        rest = without(problem, term.fit, _is_signal) if term.selected else None
        if rest is None or _too_little(problem, listed, start, term.fit, alone):
            continue
        found = look_at_ports(problem, rest, term.selected, say, thresholds.ALONE)
        if found is None or not found.is_likely or acts_where(found, rest, selector.scan.indistinguishable):
            continue
        if needed := _term_needed(problem, listed, [term.history[0], *others], found):
            return Pair(needed)
    return None


def _with_parameter(
    problem: Problem, listed: Selection, start: Fit, others: list[Fit], selector: Selector, say: Say
) -> Pair | Outside | None:
    """The parameter outside its tolerance that does best beside these forms, and what does best beside it."""
    if not problem.unexplained(start.residual):
        return None
    free = leaves_least(problem, start, thresholds.WORTH_FITTING * problem.above(start.residual))
    if free is None or _too_little(problem, listed, start, free, any(start is at for at in others)):
        return None
    rest = without(problem, free, _is_signal)
    found = look_at_ports(problem, rest, [], say, thresholds.ALONE) if rest is not None else None
    if found is None or rest is None or not found.is_likely or acts_where(found, rest, {}):
        return None
    inside = held(problem, found.fit)
    if inside is None or not _both_needed(problem, listed, [start, inside, *others], found):
        return None
    if terms := beside_listed(problem, rest, found, selector.beside):
        say(f"{terms.name} outside its tolerance, and listed terms beside it")
        return terms
    gain = inside.cost - found.fit.cost
    outside = Outside(Selection([listed.history[0], found.fit]), gain, ())
    say(f"{outside.name} outside its tolerance, and beside it a signal at {found.finding.component}")
    return Pair(found, outside)


def _is_signal(effect: Effect) -> bool:
    return isinstance(effect, PortSignal)


def _first_forms(problem: Problem, base: Fit) -> list[Fit]:
    """Fits with the first forms at the ports to which the residual points, fewest leftovers per form first."""
    places = pointed_to(problem, base, 0.0)
    near = [p for p in places if p.points > thresholds.NEAR_PORT * places[0].points]
    chosen = [choice for place in near if (choice := place.choice) is not None]
    begun = [(len(choice.columns), refit(problem, base, choice)) for choice in chosen]
    ordered = [(max(remains(problem, base, at)[1], 0.0) * forms, at) for forms, at in begun if at is not None]
    return [at for _, at in sorted(ordered, key=itemgetter(0))[:TRIED]]


def _too_little(problem: Problem, listed: Selection, start: Fit, with_it: Fit, alone: bool) -> bool:
    """Whether a search for other forms beside it cannot lead to a pair: forms and it leave half of what the base model
    does, or, of a formula that may stand alone, half of what that leaves."""
    before, forms, left = remains(problem, listed.history[0], start, with_it)
    return left > thresholds.HOLDS * (forms if alone else before)


def _both_needed(problem: Problem, listed: Selection, others: list[Fit], found: Unmodelled) -> bool:
    """Whether the pair leaves little of what the base model does, and so much less than terms, or formulas, do without
    the other. others: fits with formulas alone."""
    before, left, *formulas, rest = remains(problem, listed.history[0], listed.fit, *others, found.fit)
    explains = rest < thresholds.REMAINDER * before
    return explains and min(left / found.freedom, *formulas) > thresholds.TIMES_LESS * rest


def _term_needed(problem: Problem, listed: Selection, others: list[Fit], found: Unmodelled) -> Unmodelled | None:
    """The pair, with what its term takes beside the formula; None: one of them is not needed."""
    (term,) = found.selected
    formula = without(problem, found.fit, lambda effect: isinstance(effect, ActiveTerm))
    if formula is None or not _both_needed(problem, listed, [formula, *others], found):
        return None
    term, own = Selected(term.term, formula.cost - found.fit.cost), found.finding
    pair = Selection([listed.history[0], found.fit], [term, Selected(own.term, own.gain)])
    sure = min(own.confidence, beside_background(pair.taken(problem)[own.term], unlisted=True))
    return replace(found, selected=[term], finding=replace(own, confidence=sure))
