"""Ports at which a few forms do in one recording what they would have to do in all.

Physics is there in every part of the recordings. The one with most above noise is asked alone, all that was fitted free
in it: a formula that falls short even there is no answer, and the other recordings need not be simulated for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from cobot_joint.diagnosis.candidates.formulas import Dictionary
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.port_response import Column, respond
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.estimation.projection import Projection
from cobot_joint.diagnosis.plant.correction import Product


def promising(
    problem: Problem, start: Fit, every: Sequence[Dictionary], least: float
) -> list[tuple[Dictionary, list[Column[Product]]]]:
    """Those whose first forms take at least that share of what the fullest recording has above noise, and the forms'
    responses in all recordings."""
    above = _above_noise(problem, start.residual)
    fullest = int(np.argmax(above))
    rows = np.concatenate([np.arange(b.rows.start, b.rows.stop) for b in problem.blocks if b.recording == fullest])
    alone = replace(start, residual=start.residual[rows], jacobian=start.jacobian[rows])
    kept = []
    for dictionary in (d for d in every if problem.plant.has(d.port.name, problem.recordings[fullest])):
        ask = partial(respond, problem, start, dictionary.port, dictionary.first())
        columns = ask(only=fullest)
        if Projection(alone, [c.vector[rows] for c in columns]).together >= least * above[fullest]:
            kept.append((dictionary, columns if len(above) == 1 else ask()))
    return kept


def _above_noise(problem: Problem, residual: Vector) -> Vector:
    """Chi-square beyond the samples' number: (recordings,)"""
    above = np.zeros(len(problem.recordings))
    for block in problem.blocks:
        above[block.recording] += residual[block.rows] @ residual[block.rows] - block.weight.sum()
    return above
