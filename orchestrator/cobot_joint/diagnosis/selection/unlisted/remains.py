"""What fits leave above noise, by what is slow in it, or by all of it where most is quick."""

from __future__ import annotations

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem


def remains(problem: Problem, first: Fit, *others: Fit) -> list[float]:
    """Of these fits, in the measure that the first one asks for; no less than what nobody could see.

    Means over 16 samples are blind to a wave of a fast shaft; in all of it impacts count that are out of step.
    """
    slow = [problem.excess(fit.residual) for fit in (first, *others)]
    every = [problem.above(fit.residual) for fit in (first, *others)]
    if slow[0] > thresholds.HOLDS * every[0]:
        return [max(left, problem.excess_scatter) for left in slow]
    unseen = max((2 * problem.samples) ** 0.5, thresholds.LEFT_SHARE * problem.samples)
    return [max(left, unseen) for left in every]
