"""What signals added at a port do to the residual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from cobot_joint.diagnosis.estimation.effects import PortSignal
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import Precision, fit
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.estimation.projection import Projection
from cobot_joint.diagnosis.plant.plant import PROBE, Port

Form = TypeVar("Form")
REFIT = Precision(settled=5.0, roughly=0.005, steps=10)


@dataclass(frozen=True)
class Column(Generic[Form]):
    """Response to one feature at a port, per unit of its coefficient."""

    port: Port
    form: Form
    values: Mapping[str, Vector]  # recording -> (n,)
    vector: Vector  # (rows,)


@dataclass(frozen=True)
class Choice(Generic[Form]):
    """Features at one port with their coefficients, and the chi-square that they take beyond what a re-fit does."""

    columns: tuple[Column[Form], ...]
    coefficients: Vector
    gain: float

    @property
    def port(self) -> Port:
        """Where all of them enter."""
        return self.columns[0].port

    @property
    def effects(self) -> tuple[PortSignal]:
        """Their sum, its coefficients free."""
        forms, values = tuple(str(c.form) for c in self.columns), tuple(c.values for c in self.columns)
        return (PortSignal(self.port, forms, values, tuple(float(k) for k in self.coefficients)),)

    def summed(self, form: Form) -> Choice[Form]:
        """Their sum as one feature: of a shape that is kept, only the size is free."""
        weighted = list(zip(self.coefficients, self.columns, strict=True))
        names = self.columns[0].values
        values = {n: np.asarray(sum(k * c.values[n] for k, c in weighted)) for n in names}
        vector = np.asarray(sum(k * c.vector for k, c in weighted))
        return Choice((Column(self.port, form, values, vector),), np.ones(1), self.gain)


def respond(
    problem: Problem,
    start: Fit,
    port: Port,
    features: Mapping[Form, Mapping[str, Vector]],
    only: int | None = None,
) -> list[Column[Form]]:
    """One run per feature (form -> recording -> values); what cannot be simulated is left out.

    only: the number of the one recording that is looked at; in the others nothing responds then.
    """
    runs, sizes = [], []
    for feature in features.values():
        size = max(float(np.sqrt(np.mean(v**2))) for v in feature.values()) or 1.0
        sizes.append(PROBE.get(port.unit, 1e-3) / size)
        run = start.run.with_signals(port.name, {name: sizes[-1] * v for name, v in feature.items()})
        runs.append(run.beside(port.component))
    found = problem.simulate(runs, start.simulated, () if only is None else [only] * len(runs))
    return [
        Column(port, form, values, (f.white - start.simulated.white) / size)
        for (form, values), f, size in zip(features.items(), found, sizes, strict=True)
        if f is not None
    ]


def respond_if_promising(
    problem: Problem,
    start: Fit,
    port: Port,
    features: Mapping[Form, Mapping[str, Vector]],
    least: float,
    together: float,
) -> list[Column[Form]]:
    """`respond` in all recordings, one by one, the one with most above noise first. Empty: they fall short.

    Physics is there in every part of the recordings: features that do not take there what they would have to take of
    all are no answer, and the others need not be simulated. least: share of what the first recording has above noise;
    together: of what all asked so far have, all that was fitted free in those.
    """
    above = problem.above_noise(start.residual)
    found: list[Column[Form]] = []
    asked: list[int] = []
    for n in np.argsort(-above, kind="stable").tolist():
        if not problem.plant.has(port.name, problem.recordings[n]):
            if not asked:  # most lies where the port is not
                return []
            continue
        here = respond(problem, start, port, features, only=n)
        found = _added(found, here) if asked else here
        asked.append(n)
        needed = together if len(asked) > 1 else max(least, together)
        if above[n] > 0 and _taken(problem, start, found, asked) < needed * float(np.sum(above[asked])):
            return []
    return found


def _taken(problem: Problem, start: Fit, columns: Sequence[Column[Form]], recordings: Sequence[int]) -> float:
    """Chi-square of these recordings that the columns take together, all that was fitted free there."""
    rows = problem.rows_of(recordings)
    there = replace(start, residual=start.residual[rows], jacobian=start.jacobian[rows])
    return Projection(there, [c.vector[rows] for c in columns]).together


def _added(some: Sequence[Column[Form]], others: Sequence[Column[Form]]) -> list[Column[Form]]:
    """Responses of the forms that both have, in the recordings of both."""
    by_form = {c.form: c for c in others}
    return [replace(c, vector=c.vector + by_form[c.form].vector) for c in some if c.form in by_form]


def refit(problem: Problem, start: Fit, choice: Choice[Form]) -> Fit | None:
    """Base parameters and terms re-fitted beside the features. None: they cannot be simulated."""
    (effect,) = choice.effects
    scales = [c.scale for c in effect.coordinates]
    own = np.column_stack([scale * c.vector for scale, c in zip(scales, choice.columns, strict=True)])
    x = np.concatenate([start.x, effect.start()])
    hypothesis = start.hypothesis.with_effects(effect)
    return fit(problem, hypothesis, x, np.column_stack([start.jacobian, own]), REFIT)


def without_signal(found: Fit) -> Fit:
    """What a fit's Jacobian says of it without its last effect, all else as it is: where others may take its place."""
    (*others, last) = found.hypothesis.effects
    count = len(last.coordinates)
    residual = found.residual + found.jacobian[:, -count:] @ found.x[-count:]
    return replace(
        found,
        hypothesis=replace(found.hypothesis, effects=tuple(others)),
        x=found.x[:-count],
        chi2=float(residual @ residual),
        residual=residual,
        jacobian=found.jacobian[:, :-count],
    )


def indistinguishable_ports(problem: Problem, start: Fit, choice: Choice[Form], cosine: float) -> list[Port]:
    """Ports of other components where the same signal would do the same to the residual. cosine: from which on."""
    (whole,) = choice.summed(choice.columns[0].form).columns
    others = [p for p in problem.plant.ports if p.component != choice.port.component and p.unit == choice.port.unit]
    found = [c for port in others for c in respond(problem, start, port, {"the same": whole.values})]
    return [c.port for c in found if same_direction(c.vector, whole.vector, cosine)]


def same_direction(u: Vector, v: Vector, cosine: float) -> bool:
    """Whether two responses are one, up to size and sign."""
    return bool(abs(u @ v) > cosine * np.linalg.norm(u) * np.linalg.norm(v))
