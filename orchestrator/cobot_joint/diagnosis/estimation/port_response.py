"""What a signal added at a port does to the residual, and the least squares over such responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cobot_joint.diagnosis.candidates.score_test import TWINS
from cobot_joint.diagnosis.estimation.fit import PRIOR, Fit, fit
from cobot_joint.diagnosis.estimation.problem import Problem, Run, Vector
from cobot_joint.diagnosis.plant.correction import has_room
from cobot_joint.diagnosis.plant.plant import Port
from cobot_joint.diagnosis.selection.stepwise import EVIDENCE

MOST_FEATURES = 4
WORTH = 0.04  # of what is to be explained, that a further feature must take
PROBE = {"N.m": 1e-3, "V": 1e-2, "A": 1e-3, "rad": 1e-4, "N": 0.1}
Added = Mapping[str, Mapping[str, Vector]]  # recording -> port -> (n,)


@dataclass(frozen=True)
class Column:
    """Response to one feature at a port, per unit of its coefficient."""

    port: Port
    form: str
    values: Mapping[str, Vector]  # recording -> (n,)
    vector: Vector


@dataclass(frozen=True)
class Choice:
    """Features with their coefficients, and the chi-square that they take beyond what a re-fit alone does."""

    columns: tuple[Column, ...]
    coefficients: Vector
    gain: float

    @property
    def port(self) -> Port:
        """Where all of them enter."""
        return self.columns[0].port


def respond(
    problem: Problem, start: Fit, port: Port, features: Mapping[str, Mapping[str, Vector]], only: int | None = None
) -> list[Column]:
    """One run per feature (form -> recording -> values). only: the one recording that the features are of."""
    runs, sizes = [], []
    for feature in features.values():
        size = max(float(np.sqrt(np.mean(v**2))) for v in feature.values()) or 1.0
        sizes.append(PROBE.get(port.unit, 1e-3) / size)
        added = {name: {port.name: sizes[-1] * v} for name, v in feature.items()}
        runs.append(Run(start.run.values, start.run.onsets, merged(start.run.added, added), (port.component,)))
    found = problem.simulate(runs, start.simulated, [only] * len(runs))
    return [
        Column(port, form, values, (f.white - start.simulated.white) / size)
        for (form, values), f, size in zip(features.items(), found, sizes, strict=True)
        if f is not None
    ]


class LeastSquares:
    """Of a fit's residual over its own Jacobian, base parameters held by their prior, and columns."""

    def __init__(self, start: Fit, columns: Sequence[Column]) -> None:
        self.columns = list(columns)
        self.base = start.jacobian.shape[1]
        stacked = np.column_stack([start.residual, start.jacobian, *(c.vector for c in columns)])
        self.gram = stacked.T @ stacked
        self.prior = np.where([c.kind == "base" for c in start.hypothesis.coordinates], PRIOR, 1e-9)
        self.x = start.x
        self.nothing, _ = self._decrease([])

    def gain(self, chosen: Sequence[int], penalty: Vector | None = None) -> tuple[float, Vector]:
        """(chi-square that these columns take, their coefficients); penalty: (len(chosen),)*2, added to their Gram
        matrix."""
        total, coefficients = self._decrease(chosen, penalty)
        return total - self.nothing, coefficients

    def _decrease(self, chosen: Sequence[int], penalty: Vector | None = None) -> tuple[float, Vector]:
        base = self.base
        use = np.concatenate([np.arange(1, base + 1), base + 1 + np.array(chosen, dtype=int)]).astype(int)
        G, g = self.gram[np.ix_(use, use)].copy(), self.gram[use, 0].copy()
        G[:base, :base] += np.diag(self.prior)
        g[:base] -= self.prior * self.x
        held = G.copy()
        if penalty is not None:
            held[base:, base:] += penalty
        scale = np.sqrt(np.maximum(np.diag(held), 1e-300))
        step = np.linalg.lstsq(held / np.outer(scale, scale), g / scale, rcond=1e-9)[0] / scale
        return float(2 * g @ step - step @ G @ step), step[base:]


def forward(problem: Problem, start: Fit, columns: Sequence[Column]) -> Choice | None:
    """Features one by one, each the one that takes most, while it is worth it; None: none is."""
    squares = LeastSquares(start, columns)
    to_explain = max(problem.excess(start.residual), 1.0)
    chosen: list[int] = []
    total, coefficients = 0.0, np.zeros(0)
    while len(chosen) < MOST_FEATURES:
        forms = [columns[k].form for k in chosen]
        trials = {
            k: squares.gain([*chosen, k])
            for k, column in enumerate(columns)
            if k not in chosen and has_room([*forms, column.form])
        }
        k = max(trials, key=lambda k: trials[k][0], default=None)
        if k is None or trials[k][0] - total < max(EVIDENCE, WORTH * to_explain):
            break
        chosen.append(k)
        total, coefficients = trials[k]
    return Choice(tuple(columns[k] for k in chosen), coefficients, total) if chosen else None


def equally_good(problem: Problem, start: Fit, choice: Choice) -> list[Port]:
    """Ports of other components where the same signal would do the same to the residual."""
    values = total(choice)
    vector = sum(k * c.vector for k, c in zip(choice.coefficients, choice.columns, strict=True))
    others = [p for p in problem.plant.ports if p.component != choice.port.component and p.unit == choice.port.unit]
    found = [c for port in others for c in respond(problem, start, port, {"the same": values})]
    size = float(np.linalg.norm(vector))
    return [c.port for c in found if abs(c.vector @ vector) > TWINS * size * float(np.linalg.norm(c.vector))]


def total(choice: Choice) -> dict[str, Vector]:
    """What the choice adds at its port: recording -> (n,)"""
    return {
        name: np.sum([k * c.values[name] for k, c in zip(choice.coefficients, choice.columns, strict=True)], axis=0)
        for name in choice.columns[0].values
    }


def refit(problem: Problem, start: Fit, choice: Choice) -> Fit | None:
    """Base parameters and terms re-fitted beside the form. None: it cannot be simulated."""
    added = {name: {choice.port.name: values} for name, values in total(choice).items()}
    hypothesis = replace(start.hypothesis, added=merged(start.hypothesis.added, added))
    return fit(problem, hypothesis, start.x, start.jacobian, settled=5.0, roughly=0.005, most=10)


def merged(a: Added, b: Added) -> dict[str, dict[str, Vector]]:
    """Both; where both add at a port, the second."""
    return {name: {**a.get(name, {}), **b.get(name, {})} for name in {*a, *b}}
