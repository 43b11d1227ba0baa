"""Data sheets that are wrong: base parameters beyond their tolerances, by as much as an effect is drawn."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.evaluation.synthetic import Bench, size_after_refit

FARTHEST = 4.0  # times the nominal value, or a fraction of it, that a data sheet is off by at most
FIRST = 0.5  # of the tolerance, that a value is beyond it at first
ROUNDS = 5  # of coming nearer to the wanted size
CLOSE = 0.2  # share to which it is met


@dataclass(frozen=True)
class Misstated:
    """A base parameter outside its tolerance. size: as that of Concealed, the parameter held at its tolerance's end."""

    name: str
    value: float
    size: float


def misstate(bench: Bench, wanted: float, rng: np.random.Generator) -> Misstated | None:
    """A parameter drawn, and its value, so that a re-fit inside tolerances leaves about that root of chi-square.

    None: none can be so far off.
    """
    for k in rng.permutation(len(bench.healthy.hypothesis.base)):
        side = 1 if rng.random() < 0.5 else -1
        found = _beyond(bench, int(k), side, wanted)
        if abs(found.size / wanted - 1) < CLOSE:
            return found
    return None


def _beyond(bench: Bench, k: int, side: int, wanted: float) -> Misstated:
    """Base parameter k beyond that side of its tolerance."""
    base, x = bench.healthy.hypothesis.base, bench.healthy.x.copy()
    x[k] = side
    (c,), p = base[k].coordinates, base[k].parameter
    end, step = c.start + side * c.scale, FIRST * c.scale
    lowest, highest = sorted((p.nominal / FARTHEST, p.nominal * FARTHEST))
    value, size = end, 0.0
    for _ in range(ROUNDS):
        value = float(np.clip(end + side * step, max(lowest, p.lower), min(highest, p.upper)))
        size = _size(bench, k, bench.healthy.hypothesis, x, value)
        if abs(size / wanted - 1) < CLOSE or (size < wanted and value != end + side * step):
            break
        step = side * (value - end) * float(np.clip(wanted / max(size, 1e-6), 0.1, 10.0))
    return Misstated(p.name, value, size)


def _size(bench: Bench, k: int, hypothesis: Hypothesis, x: np.ndarray, value: float) -> float:
    """Root of the chi-square that a re-fit of the others leaves; 0 where it cannot be simulated."""
    at_end = hypothesis.run(x)
    there, off = bench.problem.simulate([at_end, at_end.with_values({hypothesis.base[k].name: value})])
    if there is None or off is None:
        return 0.0
    others = [n for n in range(len(x)) if n != k]
    less = replace(hypothesis, base=tuple(hypothesis.base[n] for n in others))
    healthy: Fit = replace(bench.healthy, hypothesis=less, x=x[others], jacobian=bench.healthy.jacobian[:, others])
    return size_after_refit(healthy, off.white - there.white)
