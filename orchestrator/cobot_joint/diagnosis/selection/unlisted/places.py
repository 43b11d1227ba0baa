"""Ports, and the forms there to which a residual points."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.candidates.formulas import Dictionary
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.port_response import (
    Choice,
    Column,
    respond,
    respond_if_promising,
    same_direction,
    without_signal,
)
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.estimation.projection import Projection
from cobot_joint.diagnosis.plant.correction import Product
from cobot_joint.diagnosis.plant.plant import Port
from cobot_joint.diagnosis.selection.unlisted.formula import forward


@dataclass
class Place:
    """A port: chi-square that its first forms take, base parameters in their tolerances, and the best formula there."""

    port: Port
    dictionary: Dictionary
    points: float
    columns: list[Column[Product]]
    choice: Choice[Product] | None

    at: Fit | None = None  # where the choice was made, if not where the search began

    def look_closer(self, problem: Problem, start: Fit, found: Fit | None) -> None:
        """With all forms, not a few; as they respond beside those that were found here, whose size bends what they do.

        found: a fit with these.
        """
        if found is not None:
            self.at, forms = without_signal(found), {**self.dictionary.first(), **self.dictionary.more()}
            self.choice = forward(problem, self.at, respond(problem, found, self.port, forms))
            if self.choice is not None:
                return
        self.at = None
        rest = respond(problem, start, self.port, self.dictionary.more())
        self.choice = forward(problem, start, [*self.columns, *rest])


def pointed_to(problem: Problem, start: Fit, least: float, units: Collection[str] | None = None) -> list[Place]:
    """Those to which the residual points first, by a few forms at every port, or at these units', that is promising."""
    ports = [port for port in problem.plant.ports if units is None or port.component in units]
    outputs = problem.outputs(start.run, list(dict.fromkeys(s for port in ports for s in port.signals)))
    between: dict[str, float | None] = {}
    every = [d for port in ports if (d := Dictionary(problem, start, port, outputs, between)).locals]
    places = []
    for dictionary in every:
        columns = first_forms(problem, start, dictionary, min(least, thresholds.ALONE))
        if not columns:
            continue
        points = Projection(start, [c.vector for c in columns]).inside
        places.append(Place(dictionary.port, dictionary, points, columns, forward(problem, start, columns)))
    return _distinguishable(sorted(places, key=lambda place: -place.points))


def first_forms(problem: Problem, start: Fit, dictionary: Dictionary, together: float) -> list[Column[Product]]:
    """Responses of the first forms at a port; empty: they take too little. together: see respond_if_promising."""
    return respond_if_promising(problem, start, dictionary.port, dictionary.first(), thresholds.HOLDS, together)


def _distinguishable(places: Sequence[Place]) -> list[Place]:
    """Of ports where the same signal does the same, the first; of a load's torque and force the torque."""
    kept: list[Place] = []
    for place in places:
        twin = next((p for p in kept if _same_kind(p.port, place.port) and _alike(p.columns, place.columns)), None)
        if twin is None:
            kept.append(place)
        elif (twin.port.unit, place.port.unit) == ("N", "N.m"):
            kept[kept.index(twin)] = place
    return kept


def _same_kind(a: Port, b: Port) -> bool:
    """Whether they take the same unit of measure, or are a torque and a force on one body."""
    return a.unit == b.unit or (a.component == b.component and {a.unit, b.unit} == {"N.m", "N"})


def _alike(a: Sequence[Column[Product]], b: Sequence[Column[Product]]) -> bool:
    """Whether a constant added at either port does the same to the residual."""
    constants = [[c.vector for c in columns if c.form == Product()] for columns in (a, b)]
    return all(constants) and same_direction(constants[0][0], constants[1][0], thresholds.COLLINEAR)


def expected_to_leave(problem: Problem, start: Fit, places: Sequence[Place]) -> float:
    """Chi-square above noise that the best choice leaves, by the Jacobian of the fit at which it was made."""
    chosen = [(p.at or start, p.choice) for p in places if p.choice]
    taken = [(at, Projection(at, []).inside + choice.gain) for at, choice in chosen]
    return min((problem.above(at.residual) - gain for at, gain in taken), default=np.inf)


def elsewhere(problem: Problem, start: Fit, place: Place, port: Port) -> Choice[Product] | None:
    """The forms chosen at one port, at another unit's that takes the same and turns as far; None: there are none, or
    they do the same there."""
    assert place.choice is not None
    if port.component == place.port.component or not _same_kind(place.port, port):
        return None
    chosen = place.choice.columns
    features = place.dictionary.at(Dictionary(problem, start, port), [c.form for c in chosen])
    columns = respond(problem, start, port, features)
    same = [same_direction(a.vector, b.vector, thresholds.COLLINEAR) for a, b in zip(chosen, columns, strict=False)]
    if not features or len(columns) < len(chosen) or all(same):
        return None
    gain, coefficients = Projection(start, [c.vector for c in columns]).gain(list(range(len(columns))))
    return Choice(tuple(columns), coefficients, gain)
