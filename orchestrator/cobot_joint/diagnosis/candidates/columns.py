"""Columns: what a run changes by, per amplitude of a term that is switched on at a scanned shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from cobot_joint.diagnosis.estimation.problem import Run, Vector
from cobot_joint.diagnosis.plant.plant import TermCandidate

FIRST = 24  # orders


@dataclass(frozen=True)
class Column:
    """d(simulated)/d(amplitude) of a term at one scanned shape; two for a pair of sine and cosine."""

    term: TermCandidate
    shape: Mapping[str, float]
    vectors: tuple[Vector, ...]


def probes(run: Run, term: TermCandidate, shape: Mapping[str, float], delta: float) -> list[Run]:
    """Runs with a term of that amplitude: one, or of a wave its sine and its cosine."""
    values = {**run.values, **shape, term.amplitude: term.neutral + delta}
    phases = [{term.phase: 0.0}, {term.phase: np.pi / 2}] if term.phase else [{}]
    return [replace(run, values={**values, **phase}, touches=(term.component,)) for phase in phases]


def shapes(term: TermCandidate, orders: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """Every combination of scanned shapes."""
    if term.episode:  # always on: windows are cut from its response
        return [{s.name: (0.0 if s.name.endswith(".t_0") else 1e6) for s in term.shapes}]
    choices = [orders.get(s.name, s.values) for s in term.shapes]
    return [dict(zip([s.name for s in term.shapes], values, strict=True)) for values in product(*choices)]


def middle(term: TermCandidate, orders: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """The combination in the middle; of many orders, of the first ones, that any shaft shows."""
    first = {s.name: s.values[:FIRST] for s in term.shapes if s.whole}
    choices = shapes(term, {**first, **orders})
    return choices[len(choices) // 2]


def same_shapes(a: TermCandidate, b: TermCandidate) -> bool:
    """Whether both are scanned at the same values."""
    return [s.values for s in a.shapes] == [s.values for s in b.shapes]


def _renamed(shape: Mapping[str, float], old: TermCandidate, new: TermCandidate) -> dict[str, float]:
    names = {o.name: n.name for o, n in zip(old.shapes, new.shapes, strict=True)}
    return {names[name]: value for name, value in shape.items()}


def in_proportion(own: Column, simulated: Sequence[Column]) -> list[Column]:
    """Columns of a term that responds like another: that one's, in the proportion of one that was simulated."""
    a, b = own.vectors[0], simulated[0].vectors[0]
    ratio = float(a @ b / (b @ b))
    return [
        Column(own.term, _renamed(c.shape, c.term, own.term), tuple(ratio * v for v in c.vectors)) for c in simulated
    ]


def cosine(a: Column, b: Column) -> float:
    """Of the angle between the responses: 1 where they cannot be told apart."""
    u, v = a.vectors[0], b.vectors[0]
    return float(abs(u @ v) / np.sqrt((u @ u) * (v @ v)))
