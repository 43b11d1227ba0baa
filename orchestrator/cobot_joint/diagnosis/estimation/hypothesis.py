"""Which effects act: base parameters first, then what is beyond the base model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cobot_joint.diagnosis.estimation.effects import ActiveTerm, BaseParameter, Coordinate, Effect
from cobot_joint.diagnosis.estimation.problem import Problem, Run, Vector

PRIOR = 1.0  # weight of (deviation/tolerance)^2: a healthy unit is rather inside than at the edge
FLAT = 1e-9  # the same of everything else: none, but for what the data do not see at all


@dataclass(frozen=True)
class Hypothesis:
    """Which base parameters are free, and which effects act beside them."""

    base: tuple[BaseParameter, ...]
    effects: tuple[Effect, ...] = ()

    @property
    def terms(self) -> tuple[ActiveTerm, ...]:
        """Those of the effects that are listed terms."""
        return tuple(e for e in self.effects if isinstance(e, ActiveTerm))

    @property
    def coordinates(self) -> list[Coordinate]:
        """Base parameters first."""
        return [c for effect in (*self.base, *self.effects) for c in effect.coordinates]

    @property
    def prior(self) -> Vector:
        """Weight of every coordinate's square in the cost: (len(coordinates),)"""
        return np.where([c.kind == "base" for c in self.coordinates], PRIOR, FLAT)

    def run(self, x: Sequence[float] | Vector) -> Run:
        """The simulation at a point."""
        run = Run()
        for effect, own in self._parts(np.asarray(x)):
            run = effect.apply(run, own)
        return run

    def start(self) -> Vector:
        """Where the fit begins: base parameters in the middle, effects at their own values."""
        return np.concatenate([e.start() for e in (*self.base, *self.effects)] or [np.zeros(0)])

    def settled(self, x: Vector) -> Hypothesis:
        """The same, its effects starting at what was found."""
        return replace(self, effects=tuple(effect.at(own) for effect, own in self._parts(x)[len(self.base) :]))

    def with_effects(self, *effects: Effect) -> Hypothesis:
        """With more of them."""
        return replace(self, effects=(*self.effects, *effects))

    def _parts(self, x: Vector) -> list[tuple[Effect, Vector]]:
        every = (*self.base, *self.effects)
        ends = np.cumsum([len(e.coordinates) for e in every])
        return list(zip(every, np.split(x, ends[:-1]), strict=True)) if every else []


def tolerances(problem: Problem, bounds: Mapping[str, tuple[float, float]]) -> tuple[BaseParameter, ...]:
    """Base parameters that a diagnosis may re-fit, as far as their units allow it."""
    found = []
    for name, (low, high) in bounds.items():
        p = problem.plant.parameters[name]
        base = BaseParameter(p, max(low, p.lower), min(high, p.upper))
        if base.lower < base.upper and any(problem.plant.has(name, recording) for recording in problem.recordings):
            found.append(base)
    return tuple(found)
