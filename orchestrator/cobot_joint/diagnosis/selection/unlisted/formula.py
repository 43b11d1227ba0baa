"""A formula at a port: features one by one, each the one that takes most, while it is worth it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.port_response import Choice, Column
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.estimation.projection import Projection
from cobot_joint.diagnosis.plant.correction import Product, has_room


def forward(problem: Problem, start: Fit, columns: Sequence[Column[Product]]) -> Choice[Product] | None:
    """Orthogonal least squares (Chen, Billings, Luo 1989, Int. J. Control 50(5)), while the unit has room for another.
    None: no feature is worth it."""
    squares = Projection(start, [c.vector for c in columns])
    worth = max(problem.evidence, thresholds.LEAST * max(problem.excess(start.residual), 1.0))
    chosen: list[int] = []
    total, coefficients = 0.0, np.zeros(0)
    while True:
        forms = [columns[k].form for k in chosen]
        trials = {
            k: squares.gain([*chosen, k])
            for k, column in enumerate(columns)
            if k not in chosen and has_room([*forms, column.form])
        }
        k = max(trials, key=lambda k: trials[k][0], default=None)
        if k is None or trials[k][0] - total < worth:
            break
        chosen.append(k)
        total, coefficients = trials[k]
    return Choice(tuple(columns[k] for k in chosen), coefficients, total) if chosen else None
