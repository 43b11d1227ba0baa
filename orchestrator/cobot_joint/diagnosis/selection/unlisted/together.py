"""A listed term and what is on no list, chosen together: neither shows what it is while the other is left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from operator import itemgetter

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import fit
from cobot_joint.diagnosis.estimation.port_response import refit
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.selection.confidence import beside_background
from cobot_joint.diagnosis.selection.elimination import REDUCED, without_terms
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.stepwise import Selector
from cobot_joint.diagnosis.selection.unlisted.remains import remains
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Say, Unmodelled, acts_where, look_at_ports, pointed_to

TRIED = 2  # ports whose first forms are followed by a listed term


def look_together(
    problem: Problem, listed: Selection, formula: Fit | None, selector: Selector, say: Say
) -> Unmodelled | None:
    """A formula, or else first forms at a port; the listed term that does best beside them; and what does best beside
    that term. None: no such pair explains what there is, or one of the two is not needed.

    listed: the base model, and with all listed terms that were selected without a formula.
    """
    say("looking for a listed term beside what is on no list")
    for start in [formula] if formula else _first_forms(problem, listed.history[0]):
        term = selector.round(Selection([start]))
        alone = _without_signal(problem, term.fit) if term.selected else None
        if alone is None:
            continue
        found = look_at_ports(problem, alone, term.selected, say, thresholds.ALONE)
        patch = found is None or acts_where(found, alone, selector.scan.indistinguishable)
        if found and not patch and (needed := _both_needed(problem, listed, start, found)):
            return needed
    return None


def _first_forms(problem: Problem, base: Fit) -> Iterator[Fit]:
    """Fits with the first forms at the ports to which the residual points, those first that leave least per form."""
    places = [place for place in pointed_to(problem, base, 0.0) if place.choice]
    near = [p for p in places if p.points > thresholds.NEAR_PORT * places[0].points]
    begun = [(len(p.choice.columns), refit(problem, base, p.choice)) for p in near if p.choice]
    ordered = [(problem.excess(at.residual) * forms, at) for forms, at in begun if at is not None]
    return (at for _, at in sorted(ordered, key=itemgetter(0))[:TRIED])


def _without_signal(problem: Problem, both: Fit) -> Fit | None:
    """Listed terms alone, re-fitted from where they are beside a signal. None: they cannot be simulated."""
    at = both.settled()
    less = replace(at.hypothesis, effects=at.hypothesis.terms)
    names = {c.names[0] for c in less.coordinates}
    kept = [k for k, c in enumerate(at.hypothesis.coordinates) if c.names[0] in names]
    return fit(problem, less, at.x[kept], at.jacobian[:, kept], REDUCED)


def _both_needed(problem: Problem, listed: Selection, start: Fit, found: Unmodelled) -> Unmodelled | None:
    """The pair, with what its term takes beside the formula. None: it leaves too much of what the base model does, or
    not so much less than terms, or formulas, do without the other. start: with the formula that the term was chosen
    beside."""
    (term,) = found.selected
    formula = without_terms(problem, found.fit, {term.term})
    if formula is None or not found.is_likely:
        return None
    before, left, *without, rest = remains(problem, listed.history[0], listed.fit, start, formula, found.fit)
    explains = rest < thresholds.REMAINDER * before
    needed = min(left / found.freedom, *without) > thresholds.TIMES_LESS * rest
    if not (explains and needed):
        return None
    term, own = Selected(term.term, formula.cost - found.fit.cost, term.alike), found.finding
    pair = Selection([listed.history[0], found.fit], [term, Selected(own.term, own.gain)])
    sure = min(own.confidence, beside_background(pair.taken(problem)[own.term], unlisted=True))
    return replace(found, selected=[term], finding=replace(own, confidence=sure))
