"""A listed term and what is on no list, chosen together: neither shows what it is while the other is left out."""

from __future__ import annotations

from dataclasses import replace
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
from cobot_joint.diagnosis.selection.unlisted.remains import remains
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Say, Unmodelled, acts_where, look_at_ports, pointed_to

TRIED = 2  # ports whose first forms are followed by a listed term


def look_together(
    problem: Problem, listed: Selection, formula: Unmodelled | None, selector: Selector, say: Say
) -> Unmodelled | None:
    """Forms at a port, the listed term that does best beside them, and what does best beside that term. None: no such
    pair explains the residual, or one of the two is not needed.

    listed: the base model, and with all listed terms that were selected without a formula. formula: the best alone.
    """
    say("looking for a listed term beside what is on no list")
    alone = formula is not None and not formula.selected and formula.is_likely
    for start in [formula.fit] if formula and alone else _first_forms(problem, listed.history[0]):
        term = selector.round(Selection([start]))
        rest = without(problem, term.fit, _is_signal) if term.selected else None
        if rest is None:
            continue
        found = look_at_ports(problem, rest, term.selected, say, thresholds.ALONE)
        if found is None or not found.is_likely or acts_where(found, rest, selector.scan.indistinguishable):
            continue
        others = [term.history[0], *([formula.fit] if formula else [])]
        if needed := _both_needed(problem, listed, others, found):
            return needed
    return None


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


def _both_needed(problem: Problem, listed: Selection, others: list[Fit], found: Unmodelled) -> Unmodelled | None:
    """The pair, with what its term takes beside the formula. None: it leaves too much of what the base model does, or
    not so much less than terms, or formulas, do without the other. others: fits with formulas alone."""
    (term,) = found.selected
    formula = without(problem, found.fit, lambda effect: isinstance(effect, ActiveTerm))
    if formula is None:
        return None
    before, left, *formulas, rest = remains(problem, listed.history[0], listed.fit, formula, *others, found.fit)
    explains = rest < thresholds.REMAINDER * before
    if not (explains and min(left / found.freedom, *formulas) > thresholds.TIMES_LESS * rest):
        return None
    term, own = Selected(term.term, formula.cost - found.fit.cost), found.finding
    pair = Selection([listed.history[0], found.fit], [term, Selected(own.term, own.gain)])
    sure = min(own.confidence, beside_background(pair.taken(problem)[own.term], unlisted=True))
    return replace(found, selected=[term], finding=replace(own, confidence=sure))
