"""Speeds at which terms are scanned, where those that a unit proposes are not what was driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.plant.plant import SPEEDS, ScannedShape, TermCandidate

SLOW, FAST = 0.02, 0.5  # of the highest speed driven, between which a curve over speed can bend and be seen to
HARDLY = 0.1  # of it, that a scan has to reach
FURTHER = 30.0  # times beyond the scanned range, that a fit may go: as units' own shapes


def driven(problem: Problem, fit: Fit, terms: Sequence[TermCandidate]) -> list[TermCandidate]:
    """The terms, with shapes that are speeds scanned over those that the recordings reach. fit: of the base model."""
    own = {port.component: port.speeds for port in problem.plant.ports if port.speeds}
    wanted = sorted({name for term in terms for name in own.get(term.component, ())})
    runs = problem.outputs(fit.run, wanted) if wanted else []
    fastest = {c: max((float(np.abs(run[n]).max()) for run in runs for n in names if n in run), default=0.0)
               for c, names in own.items()}  # fmt: skip
    return [replace(t, shapes=tuple(_reached(s, fastest.get(t.component, 0.0)) for s in t.shapes)) for t in terms]


def _reached(shape: ScannedShape, fastest: float) -> ScannedShape:
    """With the highest speed driven; scanned as it is, where its scan and the speeds driven overlap."""
    if shape.unit not in SPEEDS or not shape.logarithmic or fastest <= 0:
        return shape
    shape = replace(shape, reached=fastest)
    if shape.values[0] < fastest and shape.values[-1] > HARDLY * fastest:
        return shape
    values = tuple(float(v) for v in np.geomspace(SLOW * fastest, FAST * fastest, len(shape.values)))
    lower, upper = min(shape.lower, values[0] / FURTHER), max(shape.upper, values[-1] * FURTHER)
    return replace(shape, values=values, lower=lower, upper=upper)
