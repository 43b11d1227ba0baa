"""A base parameter outside its tolerance, before physics that imitates it.

On real machines a data sheet is wrong more often than physics is missing. So where a re-fitted parameter presses
against its tolerance, that bound alone is let go: where this leaves no more than listed terms do, it is the finding.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.effects import FreeParameter
from cobot_joint.diagnosis.estimation.fit import AT_BOUND, Fit
from cobot_joint.diagnosis.estimation.least_squares import fit, predicted_decrease
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.findings import Estimate, Finding
from cobot_joint.diagnosis.localization.evidence import where_it_gains
from cobot_joint.diagnosis.selection.competition import finished
from cobot_joint.diagnosis.selection.confidence import beside_background, confidence
from cobot_joint.diagnosis.selection.stepwise import Selected, Selection

TRIED = 2  # parameters that are fitted, of those from which the Jacobian expects most

Select = Callable[[Fit], Selection]
Say = Callable[[str], None]


@dataclass
class Outside:
    """The base model with one parameter beyond its tolerance, and listed terms beside it.

    gain: cost that the parameter takes from the calibrated one. alike: listed terms that cannot be told from it.
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

    def finding(self, problem: Problem, calibrated: Fit, repaired: Mapping[str, Estimate]) -> Finding:
        """As a diagnosis says it. repaired: parameters as they were fitted."""
        left, excess = max(self.fit.chi2 - problem.samples, 0.0), max(problem.excess(self.fit.residual), 0.0)
        rows = problem.is_table and problem.unexplained(self.fit.residual)
        much = rows or excess > thresholds.CLEARLY_LEFT * problem.excess_scatter
        sure = beside_background(self.gain / (self.gain + left)) if much else confidence(self.gain, excess)
        return Finding(
            term=self.name,
            equivalent=self.alike[: thresholds.MOST_NAMES - 1],
            confidence=sure,
            onset=None,
            parameters={self.name: repaired[self.name]},
            where=where_it_gains(problem, calibrated.residual**2 - self.fit.residual**2),
            gain=self.gain,
        )


def look_outside(
    problem: Problem, calibrated: Fit, explained: Fit, selected: Sequence[Selected], select: Select, say: Say
) -> Outside | None:
    """None: no parameter presses against a bound, or letting go of it leaves more than the listed terms do.

    explained: the fit with these terms, or the calibrated one where there are none; then half of what is above noise
    has to be taken. select: listed terms from a fit on: of several terms the first may have stood in for a parameter.
    """
    if not problem.unexplained(calibrated.residual):
        return None
    above, first = max(calibrated.chi2 - problem.samples, 0.0), max((s.gain for s in selected), default=0.0)
    taken = calibrated.cost - explained.cost if selected else thresholds.HOLDS * above
    best = _best(problem, calibrated, thresholds.WORTH_FITTING * max(taken if len(selected) < 2 else first, 0.0))
    if best is None or (gain := calibrated.cost - best.cost) < problem.evidence:
        return None
    slack = thresholds.ALIKE + thresholds.ALIKE_SHARE * max(problem.excess(explained.residual), 0.0)
    alone = gain >= taken - (slack if selected else 0.0)
    if not alone and (len(selected) < 2 or gain < thresholds.ALONE * first):
        return None
    more = select(best) if problem.unexplained(best.residual) else Selection([best])
    if not alone and (more.fit.cost > explained.cost + slack or len(more.selected) >= len(selected)):
        return None
    as_good = len(selected) == 1 and explained.cost - best.cost < slack
    found = Outside(more, gain, (selected[0].term, *selected[0].alike) if as_good else ())
    say(f"{found.name} outside its tolerance leaves no more")
    return found


def _best(problem: Problem, calibrated: Fit, least: float) -> Fit | None:
    """The base model with that parameter free which leaves least; None: none promises so much."""
    promising = sorted(((predicted_decrease(free), k, free) for k, free in enumerate(_freed(calibrated))), reverse=True)
    best: Fit | None = None
    for _, _, free in [each for each in promising if each[0] > least][:TRIED]:
        trial = fit(problem, free.hypothesis, free.x, free.jacobian, finished(1))
        best = trial if trial is not None and (best is None or trial.cost < best.cost) else best
    return best


def _freed(calibrated: Fit) -> list[Fit]:
    """The calibrated fit with each parameter that is at a bound free of it, in the fit's own linear terms."""
    hypothesis, found = calibrated.hypothesis, []
    for k, base in enumerate(hypothesis.base):
        (c,) = base.coordinates
        if abs(calibrated.x[k]) < 1 - AT_BOUND or hypothesis.effects:
            continue
        free = FreeParameter(base, c.start + c.scale * float(calibrated.x[k]))
        if free.coordinates[0].lower > c.lower - AT_BOUND and free.coordinates[0].upper < c.upper + AT_BOUND:
            continue  # its unit allows no more
        others = [j for j in range(len(hypothesis.base)) if j != k]
        order = [*others, k]
        less = replace(hypothesis, base=tuple(hypothesis.base[j] for j in others), effects=(free,))
        x, J = calibrated.x[order], np.asarray(calibrated.jacobian[:, order])
        found.append(replace(calibrated, hypothesis=less, x=x, jacobian=J))
    return found
