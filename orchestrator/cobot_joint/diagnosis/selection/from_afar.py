"""Terms of whose size a sensitivity at zero says nothing: simulated as large as what is left, judged by its slow part.

A gap that is twice as wide moves every impact: its response is no multiple of that of a little more gap, and as long as
impacts are out of step the residual is no smaller for the right size. What is slow in it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.candidates.columns import Column
from cobot_joint.diagnosis.candidates.score_test import SEGMENTS
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.multiscale import Averaged, slow_first, slow_part
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.selection.competition import finished

SIZES = tuple(2.0**k for k in range(-2, 6))  # times that whose response, in proportion, were as large as what is left
OF_ITS_END = tuple(2.0**k for k in range(8))  # parts of a bound, where most of these lie beyond it
FITTED = 2  # of the leading terms
NEAR = tuple(k / 32 for k in range(-16, 17))  # segments of a run, by which another term's onset may be off: where what
# sets in leads to ringing, the slow part's valley is 0.03 s wide (machine 163/53)


def look_from_afar(
    problem: Problem, best: Fit, columns: Sequence[Column], onset: float | None = None
) -> dict[str, Fit]:
    """Fits of the leading terms beside `best`, by term, the lowest cost first; none that is no better.

    columns: one of each term is tried. Waves are not: free runs lose the angle that they go by.
    onset: s; from when on they act. None: always.
    """
    at, number = best.settled(), int(np.argmax(problem.above_noise(best.residual)))
    slow = slow_part(problem.part([number]))  # says as much as all of them
    if slow is None:
        return {}
    first = {c.term.name: c for c in reversed(columns) if c.term.phase is None and not c.term.episode}
    there = [c for c in first.values() if problem.plant.has(c.term.name, problem.recordings[number])]
    before = float(np.sum(slow.seen(at.residual[problem.rows_of([number])]) ** 2))
    tried = [replace(active, onset=onset) for column in there for active in _sizes(column, best)]
    leading = _leading(slow, at, tried)
    if onset is not None:
        segment = float(problem.times().max()) / SEGMENTS
        leading = _leading(slow, at, _nearby(leading, [onset + part * segment for part in NEAR]))
    enough = max(thresholds.WORTH_FITTING * (before - slow.samples), problem.evidence)
    fits: dict[str, Fit] = {}
    for active, left in leading[:FITTED]:
        hypothesis = at.hypothesis.with_effects(active)
        if before - left > enough and (
            found := slow_first(problem, hypothesis, np.concatenate([at.x, active.start()]), finished(1))
        ):
            fits[active.name] = found
    lower = {name: found for name, found in fits.items() if found.cost < best.cost}
    return dict(sorted(lower.items(), key=lambda item: item[1].cost))


def _nearby(leading: Sequence[tuple[ActiveTerm, float]], onsets: Sequence[float]) -> list[ActiveTerm]:
    """The first of them from these times on."""
    return [replace(active, onset=onset) for active, _ in leading[:FITTED] for onset in onsets if onset > 0]


def _leading(slow: Averaged, at: Fit, tried: Sequence[ActiveTerm]) -> list[tuple[ActiveTerm, float]]:
    """Of each term that which leaves least of the slow part, all else as it is, and how much; the least first."""
    left: dict[str, tuple[ActiveTerm, float]] = {}
    runs = [at.hypothesis.with_effects(active).run(np.concatenate([at.x, active.start()])) for active in tried]
    for active, simulated in zip(tried, slow.simulate(runs), strict=True):
        if simulated is None:
            continue
        rest = float(np.sum(slow.seen(slow.recorded - simulated.white) ** 2))
        if rest < left.get(active.name, (active, np.inf))[1]:
            left[active.name] = active, rest
    return sorted(left.values(), key=lambda each: each[1])


def _sizes(column: Column, best: Fit) -> list[ActiveTerm]:
    """The term at sizes of either sign, as far as it may be: a gear that gives way is soft from little of it on."""
    (response,), term = column.vectors, column.term
    as_large = float(np.sqrt(best.chi2 / (response @ response)))
    sizes = [x for end in (term.lower, term.upper) if end != term.neutral for x in _up_to(end, term.neutral, as_large)]
    values = {**column.shape, term.amplitude: 0.0}
    return [ActiveTerm(term, {**values, term.amplitude: x}) for x in sizes]


def _up_to(end: float, neutral: float, as_large: float) -> list[float]:
    """Sizes between what does nothing and a bound."""
    way = abs(end - neutral)
    steps = [k * as_large for k in SIZES if k * as_large <= way]
    if len(steps) < len(SIZES) // 2 and np.isfinite(way):  # a little of it does far more than its sensitivity says
        steps = [way / k for k in OF_ITS_END]
    return [neutral + float(np.copysign(step, end - neutral)) for step in steps]
