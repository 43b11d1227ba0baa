"""A formula at a port: features one by one, each the one that takes most, while it is worth it; two alike as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.candidates.formulas import Dictionary
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.port_response import Choice, Column, respond
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.estimation.projection import Projection
from cobot_joint.diagnosis.plant.correction import SGN, Product, has_room

SCALED = ("eddy", "exp", "tanh")  # functions that a dictionary has with a few scales only
BETWEEN = (1 / 8, 1 / 4, 3 / 8, 1 / 2, 5 / 8, 3 / 4, 7 / 8)  # of the way from one scale to the next, in logarithms


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


def joined(problem: Problem, start: Fit, dictionary: Dictionary, choice: Choice[Product]) -> Choice[Product] | None:
    """Two features of one form and sign that differ by a scale, as one whose scale lies between: the drag of eddy
    currents is largest at one speed. None: there are no two."""
    for a, b in combinations(range(len(choice.columns)), 2):
        scales = _scales(choice.columns[a].form, choice.columns[b].form)
        if scales is None or choice.coefficients[a] * choice.coefficients[b] <= 0:
            continue
        others = [c for k, c in enumerate(choice.columns) if k not in (a, b)]
        columns = respond(problem, start, choice.port, dictionary.values(scales))
        trials = []
        for column in columns:
            gain, coefficients = Projection(start, [c.vector for c in (*others, column)]).gain(range(len(others) + 1))
            trials.append((gain, Choice((*others, column), coefficients, gain)))
        return max(trials, key=lambda trial: trial[0])[1] if trials else None
    return None


def _scales(a: Product, b: Product) -> list[Product] | None:
    """What lies between two products that differ by one factor's scale; None: they differ by more."""
    apart = [k for k, (f, g) in enumerate(zip(a.factors, b.factors, strict=False)) if f != g]
    if len(a.factors) != len(b.factors) or len(apart) != 1:
        return None
    (k,) = apart
    f, g = a.factors[k], b.factors[k]
    if (f.signal, f.function) != (g.signal, g.function) or f.function not in SCALED or SGN in (f.p, g.p):
        return None
    between = [replace(f, p=float(f"{f.p * (g.p / f.p) ** way:.4g}")) for way in BETWEEN]
    return [Product((*a.factors[:k], factor, *a.factors[k + 1 :])) for factor in between]
