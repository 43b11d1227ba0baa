"""What no list names, held against the listed terms: alone, in the place of one of them, or beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.effects import FreeParameter
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.selection.selection import Selection
from cobot_joint.diagnosis.selection.unlisted.remains import remains
from cobot_joint.diagnosis.selection.unlisted.unmodelled import (
    Say,
    Unmodelled,
    acts_where,
    look_at_ports,
    without_what_it_replaces,
)


def look_for_unmodelled(
    problem: Problem, calibrated: Fit, listed: Selection, say: Say, least: float = 0.0
) -> Unmodelled | None:
    """None: the list explains what there is, or no form at any port does better.

    First alone: a form that explains all of it makes listed terms patches. Else in the place of one of those that do
    most of it, or beside them.
    least: share of what is above noise that the first forms at a port are predicted to take together, or nothing else
    than one of them that takes nearly all is an answer.
    """
    before, left = problem.excess(calibrated.residual), problem.excess(listed.fit.residual)
    terms = len(listed.selected)
    explained = terms == 1 and left < thresholds.REMAINDER * before and not problem.stands_out(listed.fit.residual)
    slow = left > thresholds.CLEARLY_LEFT * problem.excess_scatter
    little = not slow and not problem.stands_out(listed.fit.residual)
    stands = terms < 2 or not (listed.imitates or problem.unexplained(listed.fit.residual))
    if little and stands:
        return None
    if explained:
        return look_beside(problem, listed, say)
    say("looking for an effect that is on no list, port by port")
    stand = terms > 0 and left < thresholds.TERMS_STAND * before
    needed = _to_outdo(problem, calibrated, listed) if stand else 0.0
    alone = look_at_ports(problem, calibrated, [], say, least, needed=needed)
    if stand:
        return _beside_what_stands(problem, alone, listed, say)
    if alone is not None and (alone.taken > thresholds.ALONE or not terms):
        return alone
    if left < (1 - thresholds.HOLDS) * before:
        beside = look_at_ports(problem, listed.fit, listed.selected, say, least)
        if beside is not None:
            return beside
    return alone if alone is not None and _outweighs(problem, alone, listed) else None


def _beside_what_stands(problem: Problem, alone: Unmodelled | None, listed: Selection, say: Say) -> Unmodelled | None:
    """In place of listed terms that do most, of some of them, or beside them, where it leaves so much less."""
    instead = _in_place(problem, alone, listed)
    return instead if instead is not None and not instead.as_good else look_beside(problem, listed, say) or instead


def look_beside(problem: Problem, listed: Selection, say: Say) -> Unmodelled | None:
    """Beside what was selected, or in place of what it makes needless: the others may be right, and that one a patch
    of what is on no list. It leaves so much less that its freedom does not account for it; as good as what it would
    replace, where it leaves less.

    One feature in place of one term is as free as that; it proves nothing wrong by leaving several times less of
    little, and is said beside it: a cubic drag was windage, 95 % sure (machine 167/22).

    Beside all of them, what they leave has to stand out: a background is no effect. Where it does not, only ports of
    their units are asked, for something to take their place; one term whose form is somewhat off stays the right name.
    """
    if not problem.unexplained(listed.fit.residual):
        return None
    stands_out, several = problem.stands_out(listed.fit.residual), len(listed.selected) > 1
    units = None if stands_out else _units(listed)
    least = thresholds.HOLDS if stands_out else thresholds.ALONE
    found = look_at_ports(problem, listed.fit, listed.selected, say, least, units, thresholds.ALONE)
    if found is None or not found.is_likely:
        return None
    instead = without_what_it_replaces(problem, found)
    replaces = len(instead.selected) < len(listed.selected)
    left, before, rest, beside = remains(problem, listed.fit, listed.history[0], instead.fit, found.fit)
    proven = max(rest, 0.0 if stands_out or several else thresholds.NO_PROOF * before)
    if replaces and left > thresholds.TIMES_LESS * found.freedom * proven:
        return instead
    if stands_out and left > thresholds.TIMES_LESS * found.freedom * beside:
        return found
    as_free = found.freedom == 1 and left > thresholds.TIMES_LESS * rest
    less = left > found.freedom * rest if stands_out or several else as_free
    return replace(instead, as_good=True) if replaces and less else None


def _units(listed: Selection) -> set[str]:
    """Where the listed terms are, or others that equal them."""
    on = {s.term for s in listed.selected}
    twins = {twin for twin, leader in listed.indistinguishable.items() if leader in on}
    return {name.split(".")[0] for name in on | twins}


def within_reach(
    problem: Problem, formula: Unmodelled, select: Callable[[Fit], Selection]
) -> Callable[[Fit], Selection]:
    """`select`, but of no terms beside a fit where they would have to take more than ENOUGH of what it leaves for the
    formula not to outdo it: of gravity on an elbow a formula leaves a thousandth, a freed inertia half, and the rounds
    beside that took as long as all before them."""

    def selected(fit: Fit) -> Selection:
        left, rest = remains(problem, fit, formula.fit)
        needed = thresholds.TIMES_LESS * formula.freedom * rest
        return Selection([fit]) if needed < (1 - thresholds.ENOUGH) * left else select(fit)

    return selected


def look_beside_parameter(problem: Problem, outside: Selection, say: Say) -> Unmodelled | None:
    """Beside a base parameter outside its tolerance: in place of the listed terms that were selected beside it (see
    _in_place), or beside them as well.

    outside: the fit with the parameter alone, then those with terms; or, where terms were there before it, the base
    model, then that with both.
    """
    start = outside.history[0]
    if outside.selected and start.hypothesis.effects and problem.unexplained(outside.fit.residual):
        needed = _to_outdo(problem, start, outside)
        alone = look_at_ports(problem, start, [], say, thresholds.ALONE, needed=needed)
        instead = _in_place(problem, alone, outside) if alone and not acts_where(alone, start, {}) else None
        if instead and instead.is_likely and not instead.as_good:
            return instead
    found = look_beside(problem, outside, say)
    units = {e.component for e in outside.fit.hypothesis.effects if isinstance(e, FreeParameter)}
    return None if found and found.finding.component in units else found


def _to_outdo(problem: Problem, start: Fit, listed: Selection) -> float:
    """Share of what is above noise that one feature has to take to leave less than listed terms do (see _in_place)."""
    left, before = remains(problem, listed.fit, start)
    return 1 - len(listed.selected) * left / before


def _in_place(problem: Problem, alone: Unmodelled | None, listed: Selection) -> Unmodelled | None:
    """Alone instead of listed terms, where it leaves so much less that its freedom does not account for it; as good as
    one that leaves what stands out, where it leaves less.

    A formula follows whatever the data show; one term whose form is somewhat off is still the right name, unless what
    it leaves stands out, while several may be patches. What is left counts once per feature or term.
    """
    if alone is None:
        return None
    terms, stands_out = len(listed.selected), problem.stands_out(listed.fit.residual)
    if terms > 1:
        return alone if _outweighs(problem, alone, listed) else None
    left, before, rest = remains(problem, listed.fit, listed.history[0], alone.fit)
    proven = max(rest, 0.0 if stands_out else thresholds.NO_PROOF * before)
    if left > thresholds.TIMES_LESS * alone.freedom * proven:
        return alone
    less = stands_out and alone.is_likely and left > alone.freedom * rest
    return replace(alone, as_good=True) if less else None


def _outweighs(problem: Problem, alone: Unmodelled, listed: Selection) -> bool:
    """Whether it leaves less than listed terms do, per feature or term; anything does where there is none."""
    left, rest = remains(problem, listed.fit, alone.fit)
    terms = len(listed.selected)
    return terms == 0 or left * terms > rest * alone.freedom
