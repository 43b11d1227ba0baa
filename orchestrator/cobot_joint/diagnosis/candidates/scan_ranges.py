"""Speeds and orders at which terms are scanned, where those that a unit proposes are not what was driven."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from operator import attrgetter

import numpy as np

from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.order_spectrum import whole_orders
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.plant.plant import SPEEDS, Port, ScannedShape, TermCandidate

SLOW, FAST = 0.02, 0.5  # of the highest speed driven, between which a curve over speed can bend and be seen to
HARDLY = 0.1  # of it, that a scan has to reach
FURTHER = 30.0  # times beyond the scanned range, that a fit may go: as units' own shapes


def driven(problem: Problem, fit: Fit, terms: Sequence[TermCandidate]) -> list[TermCandidate]:
    """The terms, with shapes that are speeds scanned over those that the recordings reach, and any order of a shaft as
    far as their samples resolve it. fit: of the base model."""
    speeds, angles = _by_component(problem, attrgetter("speeds")), _by_component(problem, attrgetter("angles"))
    wanted = {name for term in terms for name in speeds.get(term.component, ())}
    any_order = any(s.is_any_order for term in terms for s in term.shapes)
    shafts = sorted({name for names in angles.values() for name in names}) if any_order else []
    runs = problem.outputs(fit.run, sorted(wanted.union(shafts))) if wanted or shafts else []
    orders = whole_orders(runs, shafts)
    found = []
    for term in terms:
        own = speeds.get(term.component, ())
        fastest = max((float(np.abs(run[n]).max()) for run in runs for n in own if n in run), default=0.0)
        resolved = max((orders[n] for n in angles.get(term.component, ()) if n in orders), key=len, default=[])
        found.append(replace(term, shapes=tuple(_resolved(_reached(s, fastest), resolved) for s in term.shapes)))
    return found


def _by_component(problem: Problem, names: Callable[[Port], Sequence[str]]) -> dict[str, tuple[str, ...]]:
    """Of all its ports."""
    found: dict[str, tuple[str, ...]] = {}
    for port in problem.plant.ports:
        found[port.component] = tuple(dict.fromkeys((*found.get(port.component, ()), *names(port))))
    return found


def _resolved(shape: ScannedShape, orders: Sequence[float]) -> ScannedShape:
    """With all orders, as far as the parameter may go."""
    if not shape.is_any_order or len(orders) <= len(shape.values):
        return shape
    return replace(shape, values=tuple(n for n in orders if shape.lower <= n <= shape.upper))


def _reached(shape: ScannedShape, fastest: float) -> ScannedShape:
    """With the highest speed driven; scanned as it is, where its scan and the speeds driven overlap."""
    if shape.given or shape.unit not in SPEEDS or not shape.logarithmic or fastest <= 0:
        return shape
    shape = replace(shape, reached=fastest)
    if shape.values[0] < fastest and shape.values[-1] > HARDLY * fastest:
        return shape
    values = tuple(float(v) for v in np.geomspace(SLOW * fastest, FAST * fastest, len(shape.values)))
    lower, upper = min(shape.lower, values[0] / FURTHER), max(shape.upper, values[-1] * FURTHER)
    return replace(shape, values=values, lower=lower, upper=upper)
