"""Backward elimination: terms that a later one made needless, and last terms that explain too little to be named."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.effects import ActiveTerm, Effect
from cobot_joint.diagnosis.estimation.fit import Fit, marginal_covariance
from cobot_joint.diagnosis.estimation.least_squares import Precision, fit
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.selection.selection import Selected, Selection

REDUCED = Precision(settled=20.0, roughly=0.01, steps=8, jacobians=1)  # of a fit without an earlier term


def without_needless(problem: Problem, found: Selection) -> Selection:
    """Without earlier terms that the last one made needless: what stood in for it while it was off."""
    best, kept = kept_beside(problem, found.fit, found.selected[:-1])
    kept = [*kept, found.selected[-1]]
    if len(kept) == len(found.selected):
        return found
    shorter = _shorter(problem, best, kept)
    return found if shorter is None else replace(found, history=[found.history[0], *shorter, best], selected=kept)


def kept_beside(problem: Problem, best: Fit, terms: Sequence[Selected]) -> tuple[Fit, list[Selected]]:
    """(the fit without those of these terms that something later made needless, those that are left)."""
    kept, named = list(terms), {t.term for t in terms}
    for term in terms:
        needed = max(problem.evidence, thresholds.STILL_NEEDED * term.gain)
        if loss_without(best, term.term) > thresholds.NEEDS_NO_FIT * needed:
            continue
        less = without_terms(problem, best, {term.term, *_twins(best, term.term) - named})
        if less is not None and less.cost - best.cost < needed:
            best, kept = less, [s for s in kept if s is not term]
    return best, kept


def _twins(best: Fit, name: str) -> set[str]:
    """The same term in other units."""
    return {a.name for a in best.hypothesis.terms if a.name.split(".", 1)[1] == name.split(".", 1)[1]}


def _shorter(problem: Problem, best: Fit, kept: Sequence[Selected]) -> list[Fit] | None:
    """Fits with the first of these terms, one more each: those of before have terms that are gone. None: one cannot be
    simulated."""
    on, fits = [active.name for active in best.hypothesis.terms], list[Fit]()
    for later in kept[1:]:
        fewer = without_terms(problem, best, on[on.index(later.term) :])
        if fewer is None:
            return None
        fits.append(fewer)
    return fits


def without_terms(problem: Problem, best: Fit, names: Collection[str]) -> Fit | None:
    """A fit without some of its terms, all else re-fitted. None: it cannot be simulated."""
    return without(problem, best, lambda effect: isinstance(effect, ActiveTerm) and effect.name in names)


def without(problem: Problem, best: Fit, gone: Callable[[Effect], bool]) -> Fit | None:
    """A fit without some of its effects, all else re-fitted. None: it cannot be simulated."""
    at = best.settled()
    less = replace(at.hypothesis, effects=tuple(e for e in at.hypothesis.effects if not gone(e)))
    left = [c.names[0] for c in less.coordinates]
    kept = [k for k, c in enumerate(at.hypothesis.coordinates) if c.names[0] in left]
    return fit(problem, less, at.x[kept], at.jacobian[:, kept], REDUCED)


def loss_without(best: Fit, name: str) -> float:
    """Chi-square that a fit would lose without that term, all else re-fitted, by its Jacobian (a Wald test).

    Its shapes stay as they are: without an amplitude they are nothing.
    """
    coordinates = best.hypothesis.coordinates
    term = next(a.term for a in best.hypothesis.terms if a.name == name)
    shapes = {s.name for s in term.shapes}
    free = [k for k, c in enumerate(coordinates) if c.names[0] not in shapes]
    own = [n for n, k in enumerate(free) if coordinates[k].names[0] == term.amplitude]
    spread = marginal_covariance(best.jacobian[:, free], best.hypothesis.prior[free])[np.ix_(own, own)]
    x = best.x[free][own]
    return float(x @ np.linalg.pinv(spread) @ x)


def prune(problem: Problem, selection: Selection) -> Selection:
    """Without the last terms that explain less than what stays unexplained: patches, not explanations."""
    left = problem.excess(selection.fit.residual) - thresholds.LEFT_SIGMA * problem.excess_scatter
    return _worth(selection, left)


def worth_naming(problem: Problem, calibrated: Fit, selection: Selection) -> Selection:
    """Where a campaign says what to look at: without the last terms that take little of what the re-fit leaves.

    No model of a real machine leaves nothing but noise, so what stays unexplained is no measure there.
    """
    above = problem.above(calibrated.residual)
    kept = _worth(selection, thresholds.WORTH * above)
    return kept if kept.selected else _worth(selection.up_to(1), thresholds.LEAST * above)


def _worth(selection: Selection, least: float) -> Selection:
    """Without the last terms that take less."""
    count = len(selection.selected)
    while count and selection.selected[count - 1].gain < least:
        count -= 1
    return selection.up_to(count)
