"""Forms of an unmodelled effect that set in during the runs, at the same time in all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter

import numpy as np
from scipy.optimize import minimize_scalar

from cobot_joint.diagnosis.candidates.score_test import SEGMENTS
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.port_response import Choice, Column, respond
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.estimation.projection import Projection
from cobot_joint.diagnosis.plant.correction import Product
from cobot_joint.diagnosis.selection.competition import ONSET
from cobot_joint.diagnosis.selection.unlisted.formula import forward

# of what an onset has to take: as if simulated, and simulated at the nearest of some
SCANNED, COARSELY = 0.5, 0.8
Columns = Sequence[Column[Product]]


def look_late(
    problem: Problem, start: Fit, columns: Columns, worth: float = 0.0
) -> tuple[Choice[Product], float] | None:
    """(the best choice of one port's columns, its onset in s); None: none takes anything from any onset on, or none
    this chi-square, or what takes most is there from the start.

    First as if a response from an onset on were the later part of the whole response; then simulated.
    """
    times = problem.times()
    width = float(times.max()) / SEGMENTS
    trials = []
    for k in range(1, SEGMENTS - 1):
        late = [replace(c, vector=np.where(times >= k * width, c.vector, 0.0)) for c in columns]
        if choice := forward(problem, start, [c for c in late if np.any(c.vector)]):
            trials.append((choice.gain, k * width, [c.form for c in choice.columns]))
    gain, near, forms = max(trials, key=itemgetter(0), default=(0.0, 0.0, []))
    if not forms or gain < SCANNED * worth:
        return None
    whole = [c for c in columns if c.form in forms]

    def loss(onset: float) -> float:
        return -_from(problem, start, whole, onset)[0]

    around = near - width, near + width
    least, coarse = min((loss(onset), float(onset)) for onset in np.linspace(*around, 9))
    if coarse <= 0 or -least < COARSELY * worth:
        return None
    bounds = coarse - width / 4, coarse + width / 4
    onset = float(minimize_scalar(loss, bounds=bounds, method="bounded", options={"xatol": ONSET}).x)
    gain, coefficients, responses = _from(problem, start, whole, onset)
    return (Choice(tuple(responses), coefficients, gain), onset) if gain > 0 else None


def _from(problem: Problem, start: Fit, columns: Columns, onset: float) -> tuple[float, Vector, list[Column[Product]]]:
    """(chi-square taken, coefficients, responses) of features that act from the onset on."""
    clock = {r.name: r.time - r.time[0] for r in problem.recordings}
    late = {c.form: {n: np.where(clock[n] >= onset, v, 0.0) for n, v in c.values.items()} for c in columns}
    responses = respond(problem, start, columns[0].port, late)
    gain, coefficients = Projection(start, [c.vector for c in responses]).gain(range(len(responses)))
    return gain, coefficients, responses
