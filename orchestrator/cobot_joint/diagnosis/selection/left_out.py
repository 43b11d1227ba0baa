"""Prediction inside the training runs: a term has to fit parts of them that it was not fitted to.

In linear terms about a fit: everything free is fitted again to the other parts, and the part left out is predicted
(Stone 1974, J. R. Stat. Soc. B 36(2); in blocks, for neighbours are correlated: Roberts et al. 2017, Ecography 40(8)).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import bounded_step
from cobot_joint.diagnosis.estimation.problem import Problem, Vector

PARTS = 4  # of each recording, left out in turn
BETTER = 7 / 8  # of the parts, that an effect has to predict better: of one recording's four, all


def predicts(problem: Problem, without: Fit, with_it: Fit) -> bool:
    """Whether a fit with one effect more predicts parts left out better: nearly every one, and not one for all."""
    gain = _left_out(problem, without) - _left_out(problem, with_it)
    return bool(gain.sum() > gain.max() and np.mean(gain > 0) >= BETTER)


def _left_out(problem: Problem, found: Fit) -> Vector:
    """Chi-square of every part, everything free fitted to the others: (parts,)"""
    part = _parts(problem)
    coordinates, prior, J, r = found.hypothesis.coordinates, found.hypothesis.prior, found.jacobian, found.residual
    lower, upper = (np.array([getattr(c, side) for c in coordinates]) - found.x for side in ("lower", "upper"))
    rows = [np.flatnonzero(part == k) for k in range(int(part.max()) + 1)]
    grams, pulls = [J[own].T @ J[own] for own in rows], [J[own].T @ r[own] for own in rows]
    gram, pull = np.sum(grams, axis=0) + np.diag(prior), np.sum(pulls, axis=0) - prior * found.x
    left = []
    for own, own_gram, own_pull in zip(rows, grams, pulls, strict=True):
        step, _ = bounded_step(gram - own_gram, pull - own_pull, lower, upper)
        rest = r[own] - J[own] @ step
        left.append(float(rest @ rest))
    return np.array(left)


def _parts(problem: Problem) -> NDArray[np.intp]:
    """Of every row the number of its part: (rows,)"""
    part = np.empty(problem.rows, dtype=np.intp)
    for block in problem.blocks:
        n = block.rows.stop - block.rows.start
        part[block.rows] = PARTS * block.recording + np.arange(n) * PARTS // n
    return part
