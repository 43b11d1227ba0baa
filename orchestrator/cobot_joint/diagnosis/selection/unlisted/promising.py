"""Ports at which a few forms do in some recordings what they would have to do in all.

Physics is there in every part of the recordings. These are asked one by one, the one with most above noise first, all
that was fitted free in those asked so far: a formula that falls short there is no answer, and the others need not be
simulated for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.candidates.formulas import Dictionary
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.port_response import Column, respond
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.estimation.projection import Projection
from cobot_joint.diagnosis.plant.correction import Product

Columns = list[Column[Product]]


def promising(
    problem: Problem, start: Fit, every: Sequence[Dictionary], least: float, together: float
) -> list[tuple[Dictionary, Columns]]:
    """Those whose first forms take enough, and the forms' responses in all recordings.

    least: share of what the first recording has above noise; together: of what all asked so far have.
    """
    asked = ((dictionary, _responses(problem, start, dictionary, least, together)) for dictionary in every)
    return [(dictionary, columns) for dictionary, columns in asked if columns]


def _responses(problem: Problem, start: Fit, dictionary: Dictionary, least: float, together: float) -> Columns:
    """Empty: the forms fall short."""
    forms, above = dictionary.first(), problem.above_noise(start.residual)
    found: Columns = []
    asked: list[int] = []
    for n in np.argsort(-above, kind="stable").tolist():
        if not problem.plant.has(dictionary.port.name, problem.recordings[n]):
            if not asked:  # most lies where the port is not
                return []
            continue
        here = respond(problem, start, dictionary.port, forms, only=n)
        found = _together(found, here) if asked else here
        asked.append(n)
        needed = together if len(asked) > 1 else max(least, together)
        if above[n] > 0 and _taken(problem, start, found, asked) < needed * float(np.sum(above[asked])):
            return []
    return found


def _taken(problem: Problem, start: Fit, columns: Columns, recordings: Sequence[int]) -> float:
    """Chi-square of these recordings that the columns take together, all that was fitted free there."""
    rows = problem.rows_of(recordings)
    there = replace(start, residual=start.residual[rows], jacobian=start.jacobian[rows])
    return Projection(there, [c.vector[rows] for c in columns]).together


def _together(some: Columns, others: Columns) -> Columns:
    """Responses of the forms that both have, in the recordings of both."""
    by_form = {c.form: c for c in others}
    return [replace(c, vector=c.vector + by_form[c.form].vector) for c in some if c.form in by_form]
