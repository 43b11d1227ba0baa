"""Base parameters that are far off, of whose value a sensitivity says nothing: simulated there, judged by what is slow.

An inertia of twice its data sheet's moves every resonance. Least squares out of step with them damps or softens
something else instead, and all else ends at the edge of its tolerance (machine 191/2 of drawn wrong data sheets: a
brake's inertia, 2.3 times, was a belt's stiffness, 0.3 times, that left fifteen times as much).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.effects import BaseParameter, FreeParameter
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import predicted_decrease
from cobot_joint.diagnosis.estimation.multiscale import slow_part
from cobot_joint.diagnosis.estimation.problem import Problem

TIMES = (0.25, 0.35, 0.5, 0.7, 1.4, 2.0, 2.8, 4.0)  # its value; a resonance, by the root of it, moves by a fifth a step
FROM_ZERO = (-8.0, -4.0, -2.0, 2.0, 4.0, 8.0)  # half widths of its tolerance, of a value that is 0


def values_from_afar(problem: Problem, best: Fit) -> list[tuple[str, float]]:
    """Parameters and the value of each that leaves least of what is slow, all else re-fitted in linear terms; the least
    first, as far as they are predicted to take a share of it that is worth a fit.

    The recording with most above noise is asked: it says as much as all of them.
    """
    at, number = best.settled(), int(np.argmax(problem.above_noise(best.residual)))
    part, rows = problem.part([number]), problem.rows_of([number])
    slow = slow_part(part) or part
    points = [(k, v) for k, base in enumerate(at.hypothesis.base) for v in _values(base, float(at.x[k]))]
    runs = [at.run.with_values({at.hypothesis.base[k].name: value}) for k, value in points]
    least: dict[str, tuple[float, float]] = {}
    for (k, value), simulated in zip(points, slow.simulate(runs), strict=True):
        if simulated is None:
            continue
        rest, name = slow.seen(slow.recorded - simulated.white), at.hypothesis.base[k].name
        left = float(rest @ rest) - predicted_decrease(_held(at, k, rest, slow.seen(at.jacobian[rows])))
        least[name] = min(least.get(name, (np.inf, value)), (left, value))
    before = slow.seen(at.residual[rows])
    enough = (1 - thresholds.WORTH_FITTING) * float(before @ before)
    ranked = sorted((left, name, value) for name, (left, value) in least.items() if left < enough)
    return [(name, value) for _, name, value in ranked]


def _held(at: Fit, k: int, rest: np.ndarray, jacobian: np.ndarray) -> Fit:
    """The fit with that residual, in which coordinate k stays where it is."""
    others = jacobian.copy()
    others[:, k] = 0.0
    return replace(at, residual=rest, jacobian=others)


def _values(base: BaseParameter, x: float) -> Sequence[float]:
    """Beyond its tolerance, as far as it may be let go."""
    (c,) = base.coordinates
    value, (lower, upper) = c.start + c.scale * x, FreeParameter(base, c.start).bounds
    far = [value * times for times in TIMES] if value else [c.scale * halves for halves in FROM_ZERO]
    return [v for v in far if lower <= v <= upper and not base.lower <= v <= base.upper]
