"""In which operating conditions a residual is above noise: speed, load, direction, time, frequency, a shaft's angle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.order_spectrum import clear_orders, order_spectrum, whole_orders
from cobot_joint.diagnosis.estimation.problem import BLOCK, Problem, Vector, binned

SIZES = ((0.0, 0.05, "near zero"), (0.05, 0.35, "low"), (0.35, 0.7, "middle"), (0.7, np.inf, "high"))  # of the greatest
BANDS = (0.0, 1.0, 10.0, 100.0, np.inf)  # Hz
QUARTERS = ("first quarter", "second quarter", "third quarter", "last quarter")  # warmth is not logged, time is


@dataclass(frozen=True)
class Condition:
    """One level of one variable. share: of what is above noise; time: of the samples, or of the spectrum.

    lower, upper: bounds of |variable| in its unit, where there are some.
    """

    variable: str
    level: str
    share: float
    time: float
    lower: float | None = None
    upper: float | None = None

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        bounds = {} if self.lower is None else {"between": [self.lower, self.upper]}
        return {"variable": self.variable, "level": self.level, "share": self.share, "time": self.time} | bounds


@dataclass(frozen=True)
class Order:
    """So many periods per turn of a shaft stand out. share: of what is above noise, about."""

    angle: str
    order: int
    share: float

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        return {"angle": self.angle, "order": self.order, "share": self.share}


def conditions(problem: Problem, gain: Vector, signals: Sequence[Mapping[str, Vector]]) -> dict[str, list[Condition]]:
    """Variable -> its levels; first the variable on which it depends most whether there is something above noise.

    gain: what is above noise, (rows,). signals: by recording, name -> (n,).
    """
    sums = np.concatenate([binned(gain[b.rows]) for b in problem.blocks])
    total = float(sums.sum()) or 1.0
    found: dict[str, list[Condition]] = {}
    seen: list[NDArray[np.intp]] = []
    for variable, at, levels in _variables(problem, signals):
        if any(_alike(at, other) for other in seen):
            continue
        seen.append(at)
        found[variable] = [
            Condition(variable, name, float(sums[at == k].sum()) / total, float(np.mean(at == k)), *bounds)
            for k, (name, *bounds) in enumerate(levels)
            if np.any(at == k)
        ]
    return by_dependence(found)


def _alike(at: NDArray[np.intp], other: NDArray[np.intp]) -> bool:
    """Whether two variables are at the same level nearly always, where both are there."""
    both = (at >= 0) & (other >= 0)
    return bool(both.any() and np.mean(at[both] == other[both]) > thresholds.SAME_CONDITION)


def by_dependence(levels: Mapping[str, list[Condition]]) -> dict[str, list[Condition]]:
    """The same, first what matters most."""
    return dict(sorted(levels.items(), key=lambda item: -dependence(item[1])))


def dependence(levels: Sequence[Condition]) -> float:
    """How unevenly what is above noise lies over the levels: sum of share*ln(share/time), 0 where it is even."""
    share, time = np.array([max(r.share, 0.0) for r in levels]), np.array([r.time for r in levels])
    share, time = share / max(share.sum(), 1e-300), time / time.sum()
    there = share > 0
    return float(np.sum(share[there] * np.log(share[there] / time[there])))


def densest(levels: Sequence[Condition]) -> Condition | None:
    """The level in which most is above noise for its time; None: it lies too evenly to name one."""
    if dependence(levels) < thresholds.UNEVEN:
        return None
    return max((r for r in levels if r.share > thresholds.WORTH), key=lambda r: r.share / r.time, default=None)


Levels = list[tuple[Any, ...]]  # name, and bounds where there are some


def _variables(
    problem: Problem, signals: Sequence[Mapping[str, Vector]]
) -> Iterator[tuple[str, NDArray[np.intp], Levels]]:
    """(variable, level of each `BLOCK` samples of each row block or -1, levels)"""
    yield _labelled("recording", [problem.recordings[b.recording].name for b in problem.blocks], problem)
    yield _labelled("channel", [b.channel for b in problem.blocks], problem)
    if not problem.is_table:  # whose rows follow one another in no time
        rank = [np.linspace(0, 4, len(problem.recordings[b.recording].time), endpoint=False) for b in problem.blocks]
        yield "time", np.concatenate([_means(x).astype(int) for x in rank]), [(name,) for name in QUARTERS]
    for name in dict.fromkeys(n for s in signals for n in s):
        x = [_means(signals[b.recording][name]) if name in signals[b.recording] else None for b in problem.blocks]
        greatest = max(float(np.abs(v).max()) for v in x if v is not None)
        if greatest == 0:
            continue
        edges = [greatest * low for low, _, _ in SIZES[1:]]
        yield (
            name,
            _at(problem, x, lambda v, edges=edges: np.searchsorted(edges, np.abs(v))),
            [(word, greatest * low, greatest * min(high, 1.0)) for low, high, word in SIZES],
        )
        if min(float(v.min()) for v in x if v is not None) < -0.05 * greatest:
            rest = SIZES[0][1] * greatest
            yield (
                f"direction of {name}",
                _at(problem, x, lambda v, rest=rest: np.where(np.abs(v) < rest, 2, (v < 0).astype(int))),
                [("positive",), ("negative",), ("at rest",)],
            )


def _labelled(variable: str, labels: Sequence[str], problem: Problem) -> tuple[str, NDArray[np.intp], Levels]:
    names = list(dict.fromkeys(labels))
    at = [np.full(_length(b.rows), names.index(label)) for b, label in zip(problem.blocks, labels, strict=True)]
    return variable, np.concatenate(at), [(name,) for name in names]


def _at(problem: Problem, x: Sequence[Vector | None], level: Any) -> NDArray[np.intp]:
    """Levels of all row blocks, -1 where the variable is not there."""
    pairs = zip(problem.blocks, x, strict=True)
    return np.concatenate([np.full(_length(b.rows), -1) if v is None else level(v) for b, v in pairs])


def frequencies(problem: Problem, residual: Vector) -> list[Condition]:
    """By band of frequency; `time` is the band's share of the spectrum. residual: whitened, (rows,)."""
    edges = np.array(BANDS)
    above, width = np.zeros(len(edges) - 1), np.zeros(len(edges) - 1)
    for block in problem.blocks:
        r, step = residual[block.rows], problem.recordings[block.recording].step
        power = np.abs(np.fft.rfft(r)) ** 2 / len(r) * 2
        band = np.searchsorted(edges, np.fft.rfftfreq(len(r), step), side="right") - 1
        above += np.bincount(band, weights=power - 2 * block.weight.mean(), minlength=len(above))
        width += np.bincount(band, minlength=len(above))
    names = [f"{low:g} to {high:g} Hz" for low, high in pairwise(edges)]
    names[-1] = f"above {edges[-2]:g} Hz"
    return [
        Condition("frequency", name, float(a / above.sum()), float(w / width.sum()))
        for name, a, w in zip(names, above, width, strict=True)
    ]


def orders(
    problem: Problem, residual: Vector, angles: Sequence[str], signals: Sequence[Mapping[str, Vector]]
) -> list[Order]:
    """Orders of the shafts' angles that stand out of the residual's order spectrum, strongest first."""
    total = float(sum(np.sum(residual[b.rows] ** 2 - b.weight) for b in problem.blocks))
    found = []
    whole = whole_orders(signals, angles)
    for angle in _different(angles, signals):
        power, windows = order_spectrum(problem, residual, angle, signals, whole[angle])
        found += [Order(angle, k + 1, float(3 * power[k] / total)) for k in clear_orders(power, windows)]
    return sorted(found, key=lambda o: -o.share)


def _different(angles: Sequence[str], signals: Sequence[Mapping[str, Vector]]) -> list[str]:
    """Angles without those that follow another one up to a twist."""
    kept: list[str] = []
    for angle in angles:
        same = [
            all(np.ptp(s[angle] - s[k]) < 0.05 * np.ptp(s[k]) for s in signals if angle in s and k in s) for k in kept
        ]
        if any(angle in s for s in signals) and not any(same):
            kept.append(angle)
    return kept


def _length(rows: slice) -> int:
    return int(rows.stop - rows.start) // BLOCK


def _means(x: Vector) -> Vector:
    return binned(np.nan_to_num(x)) / BLOCK
