"""Some of many recordings, where every simulation costs one per recording and a few of them tell as much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import FEW, Problem, Simulated


def some_of(whole: Problem, calibrated: Fit) -> tuple[Problem, Fit]:
    """At most `FEW` recordings, unless there are more kinds, and the calibrated base model as it stands on them.

    Of every kind that with most above noise, then whichever has most. A kind is a set-up with its parameters.
    """
    if len(whole.recordings) <= FEW or whole.is_table:
        return whole, calibrated
    fullest_first = np.argsort(-whole.above_noise(calibrated.residual), kind="stable").tolist()
    of_kind: dict[object, int] = {}
    for n in fullest_first:
        of_kind.setdefault(_kind(whole, n), n)
    numbers = sorted(list(dict.fromkeys([*of_kind.values(), *fullest_first]))[: max(FEW, len(of_kind))])
    rows = whole.rows_of(numbers)
    residual, simulated = calibrated.residual[rows], calibrated.simulated
    there = replace(
        calibrated,
        chi2=float(residual @ residual),
        residual=residual,
        simulated=Simulated(tuple(simulated.outputs[n] for n in numbers), simulated.white[rows]),
        jacobian=calibrated.jacobian[rows],
    )
    return whole.part(numbers), there


def _kind(problem: Problem, number: int) -> object:
    recording = problem.recordings[number]
    own = {name: value for name, value in recording.initial.items() if name in problem.plant.parameters}
    return recording.setup, frozenset(own.items())
