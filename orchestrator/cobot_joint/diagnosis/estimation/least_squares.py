"""Bounded non-linear least squares over rough simulations: Levenberg-Marquardt with Broyden's updates.

More, J. J. (1978), The Levenberg-Marquardt algorithm: implementation and theory, Lecture Notes in Mathematics 630;
Broyden, C. G. (1965), A class of methods for solving nonlinear simultaneous equations, Math. Comp. 19(92).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.effects import Coordinate, Effect
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.problem import Problem, Run, Simulated, Vector

ALIKE = 5e-3  # of unit columns' information: differences along a few percent of a value may be off by about as much
PART = 0.1  # of such a direction, from which on a coordinate has a part in it
WIDE = 0.05  # of a value, beyond which no difference quotient goes
LAST = 3.0  # steps not worth their run: what a fresh Jacobian has to bring, or it was the last
AS_PREDICTED = 0.15  # share by which a step may gain other than the Jacobian predicted
OLD, OWN, FRESH = 0, 1, 2  # a Jacobian by Broyden's updates, with the effects' columns by differences, or all of it
FINER = 0.1  # of the differences' span, for the next Jacobian, where no step by a fresh one helps
REFINED = 3  # times at most
DAMPED = 2  # steps by it that may fail, each shorter, before that
DAMPING = 0.03  # of the first step, over the chi-square above noise: a resonance far off is not reached in one stride


@dataclass(frozen=True)
class Precision:
    """When a fit is good enough.

    settled: chi-square below which a further step is not worth its run; roughly: the same as a share of what is above
    noise. steps: at most. jacobians: by differences at most, beside those of the effects' own columns.
    """

    settled: float = 1.0
    roughly: float = 0.0
    steps: int = 30
    jacobians: int = 100


def bounded_step(gram: Vector, gradient: Vector, lower: Vector, upper: Vector) -> tuple[Vector, float]:
    """min |r - J s|^2 over lower <= s <= upper, from gram = J'J and gradient = J'r. Gives s, what |r|^2 falls by."""
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-30))
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    root = np.sqrt(np.maximum(values, 1e-12))
    matrix = (root[:, None] * vectors.T) * scale
    target = (vectors.T @ (gradient / scale)) / root
    free = np.linalg.lstsq(matrix, target, rcond=None)[0]
    if np.all(free >= lower) and np.all(free <= upper):
        step = free
    else:
        step = lsq_linear(matrix, target, bounds=(lower, np.maximum(upper, lower + 1e-12)), method="bvls").x
    return step, float(2 * gradient @ step - step @ gram @ step)


def difference(
    problem: Problem,
    hypothesis: Hypothesis,
    x: Vector,
    base: Simulated,
    only: Sequence[int] | None = None,
    finer: float = 1.0,
) -> Vector | None:
    """d(simulated)/dx by one-sided differences, inside bounds: (rows, len(x) or len(only)); None: a run failed, and so
    did that of the opposite step. finer: share of the usual step."""
    wanted = range(len(x)) if only is None else only
    runs, steps, where = _stepped(problem, hypothesis, x, wanted, finer)
    found = problem.simulate(runs, base, where)
    failed = [k for k, run in enumerate(found) if run is None]
    if failed:
        back, opposite, where = _stepped(problem, hypothesis, x, [wanted[k] for k in failed], -finer)
        for k, run, step in zip(failed, problem.simulate(back, base, where), opposite, strict=True):
            found[k], steps[k] = run, step
    return _quotients(found, base, steps)


def sharpened(problem: Problem, found: Fit) -> Fit:
    """The fit with short central differences, and what they may be off, for coordinates that act so alike that the
    error of a long one would pass for knowledge: of a rotor that coasts the recordings tell only ratios to its inertia,
    and that had been known to 0.7 %. Itself where there are none, or they cannot be simulated."""
    J, x, coordinates = found.jacobian, found.x, found.hypothesis.coordinates
    columns = _alike(J, found.hypothesis.prior)
    if not columns:
        return found
    ahead, back = (
        difference(problem, found.hypothesis, x, found.simulated, columns, times) for times in (FINER, -FINER)
    )
    if ahead is None or back is None:
        return found
    steps = FINER * np.array([_step(problem, coordinates[k], float(x[k])) for k in columns])
    ends = np.array([(coordinates[k].lower, coordinates[k].upper) for k in columns])
    inside = (ends[:, 0] <= x[columns] - steps) & (x[columns] + steps <= ends[:, 1])
    exact, errors = J.copy(), np.zeros(len(x))
    exact[:, columns] = np.where(inside, (ahead + back) / 2, ahead)
    errors[columns] = np.linalg.norm(np.where(inside, (ahead - back) / 2, ahead - J[:, columns]), axis=0)
    return replace(found, jacobian=exact, errors=errors)


def _alike(J: Vector, prior: Vector) -> list[int]:
    """Coordinates whose part in a direction that hardly shows is more than their prior says of it."""
    size = np.linalg.norm(J, axis=0)
    seen = np.flatnonzero(size > 1)
    unit = J[:, seen] / size[seen]
    shares, directions = np.linalg.eigh(unit.T @ unit)
    way = directions / size[seen][:, None]
    told = shares > np.sum(prior[seen][:, None] * way**2, axis=0)  # by the rows, more than by the prior
    part = np.abs(directions[:, (shares < ALIKE) & told]).max(axis=1, initial=0.0)
    return [int(k) for k in seen[part > PART]]


def _stepped(
    problem: Problem, hypothesis: Hypothesis, x: Vector, only: Sequence[int], times: float = 1.0
) -> tuple[list[Run], list[float], list[int | None]]:
    """Per coordinate: the run a step further, the step, and the one recording in which it acts, None: in all.

    times: the usual step; negative: the other way.
    """
    runs, steps, where = [], [], []
    names = [recording.name for recording in problem.recordings]
    for k in only:
        c = hypothesis.coordinates[k]
        step = times * _step(problem, c, float(x[k]))
        steps.append(step if x[k] + step <= c.upper else -step)
        point = x.copy()
        point[k] += steps[-1]
        runs.append(replace(hypothesis.run(point), touches=(c.component,) if c.component else ()))
        where.append(names.index(c.recording) if c.recording else None)
    return runs, steps, where


def _quotients(found: Sequence[Simulated | None], base: Simulated, steps: Sequence[float]) -> Vector | None:
    """(rows, runs); None: a run failed."""
    columns = [(f.white - base.white) / step for f, step in zip(found, steps, strict=True) if f is not None]
    if len(columns) < len(steps):
        return None
    return np.column_stack(columns) if columns else np.empty((len(base.white), 0))


def _step(problem: Problem, coordinate: Coordinate, x: float) -> float:
    """Of a difference quotient: short where a tolerance is wide, for what is fitted may bend over it."""
    if coordinate.step is not None:
        return coordinate.step
    value = abs(coordinate.start + coordinate.scale * x)
    if coordinate.kind != "base" or value == 0:
        return problem.step
    return min(problem.step, max(WIDE * value / coordinate.scale, 0.1 * problem.step))


def fit(
    problem: Problem,
    hypothesis: Hypothesis,
    x: Vector | None = None,
    jacobian: Vector | None = None,
    precision: Precision = Precision(),
    simulated: Simulated | None = None,
) -> Fit | None:
    """The hypothesis at its best point near the start. None: the start, or a step from it, cannot be simulated.

    x, jacobian, simulated: where to start, an approximate Jacobian there (rows, len(x)), and its run where that is
    known. Broyden's update where a step came as predicted, differences where not: first of the effects' own columns,
    which are few and bend most, then of all.
    """
    search = _Search(problem, hypothesis, precision)
    if not search.begin(hypothesis.start() if x is None else x, jacobian, simulated):
        return None
    number = 0
    for number in range(1, precision.steps + 1):  # noqa: B007 - the last one is told below
        if search.J is None or search.ended():
            break
    if search.J is None or search.base is None:
        return None
    residual, seen = search.residual, problem.seen(search.residual)
    J = search.J if search.coarse is None else search.coarse  # finer ones that do not lead on show roughness
    return Fit(hypothesis, search.at, float(seen @ seen), residual, search.base, J, number)


class _Search:
    """A fit on its way."""

    def __init__(self, problem: Problem, hypothesis: Hypothesis, precision: Precision) -> None:
        self.problem, self.hypothesis, self.precision = problem, hypothesis, precision
        coordinates = hypothesis.coordinates
        self.lower, self.upper = np.array([c.lower for c in coordinates]), np.array([c.upper for c in coordinates])
        self.prior = hypothesis.prior
        self.own = [k for k, c in enumerate(coordinates) if c.kind != "base"]
        self.jacobians = precision.jacobians  # that are left
        self.settled = precision.settled * problem.evidence / thresholds.EVIDENCE  # a table's few rows are soon fitted
        self.refined, self.failed = 0, 0  # times that differences were made finer; steps by this Jacobian that failed
        self.coarse: Vector | None = None  # before finer ones, until one of these leads on
        self.begun = np.inf  # cost with the last fresh Jacobian
        self.own_at: Vector | None = None  # the point at which the effects' columns were found last
        self.base: Simulated | None = None
        self.J: Vector | None = None

    def begin(self, x: Vector, jacobian: Vector | None, simulated: Simulated | None) -> bool:
        """Whether the start can be simulated."""
        self.at = np.clip(x, self.lower, self.upper)
        known = simulated is not None and np.array_equal(self.at, x)
        self.base = simulated if known else self.problem.simulate([self.hypothesis.run(self.at)])[0]
        if self.base is None:
            return False
        self.residual = self.problem.recorded - self.base.white
        self.cost = self._cost(self.residual, self.at)
        self.J, self.age = jacobian, OLD
        if jacobian is None:
            self.J, self.age = difference(self.problem, self.hypothesis, self.at, self.base), FRESH
        self.damping = DAMPING * self._above(self.cost)
        return True

    def ended(self) -> bool:
        """One step; whether it was the last."""
        assert self.J is not None
        assert self.base is not None
        self.begun = self.cost if self.age == FRESH else self.begun
        trial, predicted = self._trial(self.J)
        found = self.problem.simulate([self.hypothesis.run(trial)])[0]
        rest = self.problem.recorded - found.white if found is not None else self.residual
        new = self._cost(rest, trial) if found is not None else np.inf
        worth = max(self.settled, self.precision.roughly * self._above(min(self.cost, new)))
        # a damped step's small gain is no end
        enough = self.precision.roughly > 0 and self.begun - min(self.cost, new) < LAST * worth
        if found is None or new >= self.cost:
            return self._after_failure(predicted, enough)
        self.failed, self.coarse = 0, None
        moved, used, gained = trial - self.at, self.age, self.cost - new
        self.J = self.J + np.outer(found.white - self.base.white - self.J @ moved, moved) / float(moved @ moved)
        self.at, self.base, self.residual, self.cost, self.age = trial, found, rest, new, OLD
        slow, kept = gained < worth, gained / predicted
        if slow and (used >= self._youngest or enough):
            return True
        self.damping *= 0.01 if abs(kept - 1) < AS_PREDICTED else 0.15 if kept > 0.7 else 0.5 if kept > 0.4 else 1.5
        if slow or kept < 1 - AS_PREDICTED:
            if slow and used == OWN and self.jacobians > 0:
                self.age = OWN  # own columns have been renewed, and that was not enough
            self._renew()
        return False

    def _trial(self, J: Vector) -> tuple[Vector, float]:
        """The next point, and the decrease of the cost that the Jacobian predicts for it."""
        J, residual = self.problem.seen(J), self.problem.seen(self.residual)
        gram, gradient = J.T @ J + np.diag(self.prior), J.T @ residual - self.prior * self.at
        damped = gram + self.damping * np.eye(len(self.at))
        step, _ = bounded_step(damped, gradient, self.lower - self.at, self.upper - self.at)
        return np.clip(self.at + step, self.lower, self.upper), float(2 * gradient @ step - step @ gram @ step)

    def _after_failure(self, predicted: float, enough: bool) -> bool:
        """A step that did not help: a younger Jacobian, else more damping. Whether neither is worth trying."""
        if predicted < self.settled or (self.age == OLD and enough):
            return True
        if self.age < self._youngest:
            self._renew()
        elif self.age == OLD:
            return True
        elif self.failed >= DAMPED and self.refined < REFINED and self.precision.jacobians > 0:
            self.refined, self.coarse = self.refined + 1, self.J if self.coarse is None else self.coarse
            self._difference()
        else:
            self.failed += 1
            self.damping = max(5 * self.damping, 1e-2 * max(self.cost - self.problem.samples, self.settled))
        return False

    @property
    def _youngest(self) -> int:
        """The youngest Jacobian that can be had."""
        return FRESH if self.jacobians > 0 else OWN if self.own else OLD

    @property
    def _finer(self) -> float:
        """Share of the usual span that differences have."""
        return FINER**self.refined

    def _renew(self) -> None:
        """The next younger Jacobian; as it is where none is left."""
        assert self.base is not None
        assert self.J is not None
        if self.age == OLD and self.own:
            self.J, self.age = self._with(self.J, self.own), OWN
            self.own_at = self.at
        elif self.jacobians > 0:
            self.jacobians -= 1
            self._difference()

    def _difference(self) -> None:
        """All columns by differences, but for those that have just been."""
        assert self.J is not None
        there = self.own if self.own_at is self.at and self.refined == 0 else []
        rest = [k for k in range(len(self.at)) if k not in there]
        self.J, self.age, self.failed = self._with(self.J, rest), FRESH, 0

    def _with(self, J: Vector, columns: Sequence[int]) -> Vector | None:
        """With these columns by differences. None: they cannot be simulated."""
        assert self.base is not None
        found = difference(self.problem, self.hypothesis, self.at, self.base, columns, self._finer)
        if found is None:
            return None
        J = J.copy()
        J[:, columns] = found
        return J

    def _cost(self, residual: Vector, x: Vector) -> float:
        seen = self.problem.seen(residual)
        return float(seen @ seen + self.prior @ x**2)

    def _above(self, cost: float) -> float:
        """Above what noise leaves."""
        return max(cost - self.problem.samples, 0.0)


def fit_on(problem: Problem, found: Fit, precision: Precision) -> Fit | None:
    """The same hypothesis, fitted on from where it stands."""
    return fit(problem, found.hypothesis, found.x, found.jacobian, precision, found.simulated)


def fit_added(problem: Problem, best: Fit, effects: Sequence[Effect], precision: Precision) -> Fit | None:
    """`best` with further effects; its Jacobian is that of `best` and the effects' own, so that few runs are needed."""
    before = best.settled()
    hypothesis = before.hypothesis.with_effects(*effects)
    x = np.concatenate([before.x, *(effect.start() for effect in effects)])
    own = range(len(before.x), len(x))
    components = {hypothesis.coordinates[k].component for k in own}
    touches = tuple(sorted(c for c in components if c)) if all(components) else ()
    runs, steps, where = _stepped(problem, hypothesis, x, own)
    at_once = [replace(run, touches=touches) for run in (hypothesis.run(x), *runs)]
    base, *found = problem.simulate(at_once, before.simulated, [None, *where])
    added = _quotients(found, base, steps) if base is not None else None
    if added is None:
        return None
    return fit(problem, hypothesis, x, np.column_stack([before.jacobian, added]), precision, base)


def predicted_decrease(found: Fit) -> float:
    """Cost that a further step would take, by the fit's own Jacobian."""
    coordinates, prior, J = found.hypothesis.coordinates, found.hypothesis.prior, found.jacobian
    lower, upper = np.array([c.lower for c in coordinates]), np.array([c.upper for c in coordinates])
    gram, gradient = J.T @ J + np.diag(prior), J.T @ found.residual - prior * found.x
    return bounded_step(gram, gradient, lower - found.x, upper - found.x)[1]
