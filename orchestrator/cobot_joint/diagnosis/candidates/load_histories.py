"""What no signal announces: loads that come and go in one recording, and offsets that set in at one moment in all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cobot_joint.diagnosis.data.conditioning import runs
from cobot_joint.diagnosis.estimation.effects import LoadPulse, StepOffset
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import Precision, difference, fit_added, fit_on
from cobot_joint.diagnosis.estimation.problem import BLOCK, Problem, Vector
from cobot_joint.diagnosis.estimation.projection import Projection
from cobot_joint.diagnosis.plant.plant import Port

RISE = 0.1  # of a span, by which a pulse begins before it, and in which it rises
BEGUN = 0.01  # of a trace's largest residual energy, up to which it has not begun
LOCATED = 0.05  # s to which the beginning of a trace is known
ROUNDS = 4  # of a fit: in each, times move by a part of a pulse's length
FIRST, FURTHER = Precision(5.0, 0.01, steps=8, jacobians=0), Precision(5.0, 0.01, steps=8, jacobians=2)
COVERS = 0.9  # of all loads of a recording, that one stretch of an input covers
BY_CHANCE = 0.2  # probability below which it is no accident that it does: by hand, of one frozen log it is 0.10

Spans = Mapping[int, Sequence[tuple[float, float]]]  # recording -> (from, to), s
Acting = LoadPulse | StepOffset


@dataclass(frozen=True)
class Loads:
    """Loads or an offset at one port, beside a fit: `gain` is the chi-square that a linear step predicts."""

    port: Port
    effects: tuple[Acting, ...]
    gain: float


def pulses(problem: Problem, start: Fit, port: Port, spans: Spans) -> Loads | None:
    """A trapezoid over every span in which the port is there, of the size that fits best; None: there is no span."""
    found = []
    for n, each in spans.items():
        recording = problem.recordings[n]
        for a, b in each if problem.plant.has(port.name, recording) else ():
            rise = RISE * (b - a)
            found.append(
                LoadPulse(port, recording.name, clock(problem, n), 0.0, (a - rise, a + rise, b - rise, b + rise))
            )
    return _sized(problem, start, port, found)


def step_offset(problem: Problem, start: Fit, port: Port, spans: Spans) -> Loads | None:
    """An offset that sets in where the largest trace begins; None: there is no span."""
    there = [n for n, r in enumerate(problem.recordings) if problem.plant.has(port.name, r)]
    shown = {n: spans[n] for n in there if n in spans}
    if not shown:
        return None
    times = {problem.recordings[n].name: clock(problem, n) for n in there}
    return _sized(problem, start, port, [StepOffset(port, times, 0.0, begins(problem, start, shown), LOCATED)])


def begins(problem: Problem, start: Fit, spans: Spans) -> float:
    """When the largest trace does."""
    shown = [(n, span) for n, of in spans.items() for span in of]
    n, (a, b) = max(shown, key=lambda each: _held(problem, start.residual, each[0], *each[1]))
    return _begins(problem, start.residual, n, a, b)


def _sized(problem: Problem, start: Fit, port: Port, effects: Sequence[Acting]) -> Loads | None:
    """The effects with the heights of a linear step from nothing."""
    if not effects:
        return None
    base = start.settled()
    hypothesis = base.hypothesis.with_effects(*effects)
    x = np.concatenate([base.x, *(e.start() for e in effects)])
    sizes = [len(e.coordinates) for e in effects]
    heights = (len(base.x) + np.cumsum([0, *sizes[:-1]])).tolist()  # the first coordinate of every effect
    columns = difference(problem, hypothesis, x, start.simulated, heights)
    if columns is None:
        return None
    gain, found = Projection(base, list(columns.T)).gain_beyond_bounds(range(len(effects)))
    sized = [e.at(np.concatenate([[k], e.start()[1:]])) for e, k in zip(effects, found, strict=True)]
    return Loads(port, tuple(sized), gain)


def fitted(problem: Problem, start: Fit, effects: Sequence[Acting]) -> Fit | None:
    """Heights and times, with everything else, beside `start`. None: that cannot be simulated.

    A fit moves times by a part of a pulse's length only, so that it is repeated while that helps.
    """
    best = fit_added(problem, start, effects, FIRST)
    for _ in range(ROUNDS if best else 0):
        assert best is not None
        if not problem.unexplained(best.residual):
            break
        further = fit_on(problem, best.settled(), FURTHER)
        if further is None or best.cost - further.cost < max(10.0, FURTHER.roughly * problem.above(best.residual)):
            best = further if further is not None and further.cost < best.cost else best
            break
        best = further
    return best


def acting(fit: Fit) -> tuple[Acting, ...]:
    """The loads and offsets of a fit, as it found them."""
    return tuple(e for e in fit.settled().hypothesis.effects if isinstance(e, LoadPulse | StepOffset))


def outline(loads: Sequence[LoadPulse]) -> tuple[Vector, Vector]:
    """Corners of all loads of one recording: (time, value)"""
    t = np.array(sorted({t for load in loads for t in load.t}))
    return t, np.sum([load.signal(t) for load in loads], axis=0)


def frozen_meanwhile(problem: Problem, loads: Sequence[LoadPulse]) -> str:
    """An input that is one value during all loads of a recording, and would hardly be by chance; "": none.

    The value that it stays at is one stretch per recording: what froze does not come back and freeze again.
    """
    names = dict.fromkeys(name for r in problem.recordings for name in r.inputs)
    return next((name for name in names if _by_chance(problem, name, loads) < BY_CHANCE), "")


def _by_chance(problem: Problem, name: str, loads: Sequence[LoadPulse]) -> float:
    """How probable it is that loads at any times lie within stretches of one value as these do; 1: these do not."""
    probable = 1.0
    for n, r in enumerate(problem.recordings):
        own = [load for load in loads if load.recording == r.name]
        if not own:
            continue
        time, u = clock(problem, n), r.inputs.get(name, np.zeros(0))
        begins, ends = min(load.t[0] for load in own), max(load.t[3] for load in own)
        still = [(time[a - 1], time[b - 1]) for a, b in runs(np.diff(u, prepend=np.inf) == 0)] if len(u) else []
        lengths = [b - a for a, b in still if min(b, ends) - max(a, begins) > COVERS * (ends - begins)]
        probable *= (lengths[0] / time[-1]) ** len(own) if lengths else np.inf
    return float(min(probable, 1.0))


def clock(problem: Problem, n: int) -> Vector:
    """Time of a recording since its beginning: (n,)"""
    time = problem.recordings[n].time
    return np.asarray(time - time[0], dtype=np.float64)


def energy(problem: Problem, residual: Vector, n: int) -> Vector:
    """Chi-square above its expectation per `BLOCK` samples of a recording, all channels: (blocks,)"""
    count = len(problem.recordings[n].time) // BLOCK
    total = np.zeros(count)
    for block in problem.blocks:
        if block.recording == n:
            above = residual[block.rows] ** 2 - block.weight
            total += above[: count * BLOCK].reshape(-1, BLOCK).sum(axis=1)
    return np.maximum(total, 0.0)


def _held(problem: Problem, residual: Vector, n: int, a: float, b: float) -> float:
    time, there = clock(problem, n)[::BLOCK], energy(problem, residual, n)
    inside = (time[: len(there)] >= a - 1e-9) & (time[: len(there)] <= b)
    return float(there[inside].sum())


def _begins(problem: Problem, residual: Vector, n: int, a: float, b: float) -> float:
    """When the trace of a span begins: at the sample before the first that has BEGUN of its largest energy."""
    time, step = clock(problem, n), problem.recordings[n].step
    total = np.asarray(sum(residual[block.rows] ** 2 for block in problem.blocks if block.recording == n))
    inside = np.flatnonzero((time >= a - BLOCK * step) & (time <= b))
    first = inside[int(np.argmax(total[inside] > BEGUN * total[inside].max()))]
    return float(time[max(first - 1, 0)])
