"""Courses in time that act at a port, fitted with everything else: a trapezoid in one recording, a jump in all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cobot_joint.diagnosis.estimation.fit import Fit, fit
from cobot_joint.diagnosis.estimation.port_response import PROBE, Column, LeastSquares
from cobot_joint.diagnosis.estimation.problem import Problem, Run, Vector
from cobot_joint.diagnosis.plant.plant import Port

STEPS = 12  # of a fit of courses
SETTLED = 0.01  # of what is above noise, below which a further step is not worth its runs
DAMPING = 1e-2, 1e3  # of a step, over each column's own size: first, and at most
STRIDE = 0.15  # of an episode's length, by which a step may move its times
EDGE = 2e-3  # s by which times are moved for a difference quotient


@dataclass(frozen=True)
class Hold:
    """A trapezoid in one recording: rises from t[0] to t[1], falls from t[2] to t[3]."""

    where: tuple[int, ...]
    T: float
    t: tuple[float, float, float, float]

    @property
    def x(self) -> Vector:
        """What is fitted: the amplitude, then times."""
        return np.array([self.T, *self.t])

    def at(self, x: Vector) -> Hold:
        """The same with other parameters, its times in order and not far from where they were."""
        far = STRIDE * (self.t[3] - self.t[0])
        near = np.clip(x[1:], self.x[1:] - far, self.x[1:] + far)
        t_0, t_1, t_2, t_3 = (float(t) for t in np.maximum.accumulate(near + 1e-6 * np.arange(4)))
        return replace(self, T=float(x[0]), t=(t_0, t_1, t_2, t_3))

    def signal(self, time: Vector) -> Vector:
        """What it adds: (n,)"""
        return self.T * np.interp(time, self.t, [0.0, 1.0, 1.0, 0.0])


@dataclass(frozen=True)
class Jump:
    """From t_0 on, in all recordings."""

    where: tuple[int, ...]
    A: float
    t_0: float
    step: float  # of the recordings' time: inputs are linear between samples

    @property
    def x(self) -> Vector:
        """What is fitted: the amplitude, then times."""
        return np.array([self.A, self.t_0])

    def at(self, x: Vector) -> Jump:
        """The same with other parameters."""
        return replace(self, A=float(x[0]), t_0=float(x[1]))

    def signal(self, time: Vector) -> Vector:
        """What it adds: (n,)"""
        return self.A * np.clip((time - self.t_0) / self.step + 0.5, 0.0, 1.0)


Acting = Hold | Jump


@dataclass(frozen=True)
class Inferred:
    """Courses at a port, everything else re-fitted beside them."""

    port: Port
    courses: tuple[Acting, ...]
    fit: Fit


def fitted(problem: Problem, inferred: Inferred) -> Inferred:
    """Levenberg-Marquardt over the courses' parameters and, inside their bounds, all others.

    Where steps no longer help and something is left, the others' Jacobian is renewed once.
    """
    damping, renewed = DAMPING[0], False
    for _ in range(STEPS):
        before = inferred.fit.cost
        columns = responses(problem, inferred)
        squares, size = LeastSquares(inferred.fit, columns), np.array([c.vector @ c.vector for c in columns])
        size = np.where(size > 0, size, max(size.max(), 1.0))
        further = None
        while further is None and damping <= DAMPING[1]:
            further = _stepped(problem, inferred, squares.gain(range(len(columns)), np.diag(damping * size))[1])
            damping *= 0.2 if further else 10.0
        inferred = further or inferred
        above = inferred.fit.chi2 - problem.samples
        if before - inferred.fit.cost < max(10.0, SETTLED * above):
            if renewed or not problem.unexplained(inferred.fit.residual):
                break
            at, damping, renewed = inferred.fit, DAMPING[0], True
            again = fit(problem, at.hypothesis, at.x, settled=5.0, roughly=SETTLED, most=8, fresh_most=2)
            inferred = inferred if again is None else Inferred(inferred.port, inferred.courses, again)
    return inferred


def _stepped(problem: Problem, inferred: Inferred, step: Vector) -> Inferred | None:
    """The courses moved and the rest re-fitted; None: that does not help."""
    sizes = np.cumsum([len(c.x) for c in inferred.courses])
    moved = [c.at(c.x + s) for c, s in zip(inferred.courses, np.split(step, sizes[:-1]), strict=True)]
    at = inferred.fit
    hypothesis = replace(at.hypothesis, added=added(problem, inferred.port, moved))
    found = fit(problem, hypothesis, at.x, at.jacobian, settled=5.0, roughly=SETTLED, most=4, fresh_most=0)
    return Inferred(inferred.port, tuple(moved), found) if found is not None and found.cost < at.cost else None


def responses(problem: Problem, inferred: Inferred, most: int | None = None) -> list[Column]:
    """Response to every parameter (the first `most`) of every course, by differences in the recordings it is of."""
    at, port, runs, only, steps = inferred.fit, inferred.port, [], [], []
    for n, course in enumerate(inferred.courses):
        for k in range(len(course.x))[:most]:
            size = max(1e-2 * abs(course.x[0]), 10 * PROBE[port.unit]) if k == 0 else EDGE
            moved = course.at(course.x + size * np.eye(len(course.x))[k])
            courses = [*inferred.courses[:n], moved, *inferred.courses[n + 1 :]]
            runs.append(Run(at.run.values, at.run.onsets, added(problem, port, courses), (port.component,)))
            only.append(course.where[0] if len(course.where) == 1 else None)
            steps.append(size)
    found = problem.simulate(runs, at.simulated, only)
    zero = np.zeros(problem.rows)
    return [
        Column(port, "", {}, zero if f is None else (f.white - at.simulated.white) / size)
        for f, size in zip(found, steps, strict=True)
    ]


def promised_by(problem: Problem, begun: Inferred) -> float:
    """Chi-square that a linear step of the amplitudes alone would take."""
    columns = responses(problem, begun, most=1)
    return LeastSquares(begun.fit, columns).gain(range(len(columns)))[0]


def added(problem: Problem, port: Port, courses: Sequence[Acting]) -> dict[str, dict[str, Vector]]:
    """Recording -> port -> (n,)"""
    total: dict[str, Vector] = {}
    for course in courses:
        for n in course.where:
            name = problem.recordings[n].name
            total[name] = total.get(name, 0.0) + course.signal(clock(problem, n))
    return {name: {port.name: x} for name, x in total.items()}


def outline(holds: Sequence[Hold]) -> tuple[Vector, Vector]:
    """Corners of all of a recording's episodes: (time, value)"""
    t = np.array(sorted({t for hold in holds for t in hold.t}))
    return t, np.sum([hold.signal(t) for hold in holds], axis=0)


def clock(problem: Problem, n: int) -> Vector:
    """Time of a recording since its beginning: (n,)"""
    time = problem.recordings[n].time
    return np.asarray(time - time[0], dtype=np.float64)
