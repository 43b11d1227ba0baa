"""Least squares inside bounds: base parameters in their tolerances, and the terms that are switched on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import lsq_linear

from cobot_joint.diagnosis.estimation.problem import Problem, Run, Simulated, Vector
from cobot_joint.diagnosis.findings import Estimate
from cobot_joint.diagnosis.plant.plant import Parameter, TermCandidate

WIDE = 0.05  # of a value, beyond which no difference quotient goes
PRIOR = 1.0  # weight of (deviation/tolerance)^2: a healthy unit is rather inside than at the edge
LAST = 3.0  # steps not worth their run: what a fresh Jacobian has to bring, or it was the last
AS_PROMISED = 0.15  # share by which a step may gain other than the Jacobian said
OLD, OWN, FRESH = 0, 1, 2  # a Jacobian by Broyden's updates, with the terms' own columns by differences, or all of it
DAMPING = 0.03  # of the first step, over the chi-square above noise: a resonance far off is not reached in one stride


@dataclass(frozen=True)
class Free:
    """A base parameter with its tolerance."""

    parameter: Parameter
    lower: float
    upper: float


@dataclass(frozen=True)
class Active:
    """A term that is switched on: where its parameters start, and from which time within a run it acts."""

    term: TermCandidate
    values: Mapping[str, float]  # amplitude, phase and shapes
    onset: float | None = None


@dataclass(frozen=True)
class Coordinate:
    """One number that a fit moves; 0 is where it starts, 1 a natural step."""

    names: tuple[str, ...]  # a pair (amplitude, phase) or one parameter
    start: float
    scale: float
    lower: float
    upper: float
    kind: str  # "base", "linear", "log", "cos", "sin"
    component: str


@dataclass(frozen=True)
class Hypothesis:
    """Which base parameters are free and which terms are on."""

    free: tuple[Free, ...]
    active: tuple[Active, ...] = ()
    added: Mapping[str, Mapping[str, Vector]] = field(default_factory=dict)  # unlisted: recording -> port -> (n,)

    @property
    def coordinates(self) -> list[Coordinate]:
        """Base parameters first."""
        found = []
        for f in self.free:
            middle, half = (f.lower + f.upper) / 2, (f.upper - f.lower) / 2
            component = f.parameter.name.split(".")[0]
            found.append(Coordinate((f.parameter.name,), middle, half, -1.0, 1.0, "base", component))
        for active in self.active:
            found += _coordinates(active)
        return found

    def run(self, x: Sequence[float] | Vector) -> Run:
        """The simulation at a point."""
        values: dict[str, float] = {}
        onsets: dict[str, float] = {}
        coordinates = self.coordinates
        k = 0
        while k < len(coordinates):
            c = coordinates[k]
            if c.kind == "cos":
                a, b = float(x[k]) * c.scale, float(x[k + 1]) * c.scale
                values[c.names[0]] = min(float(np.hypot(a, b)), c.upper * c.scale)
                values[c.names[1]] = float(np.arctan2(b, a))
                k += 1
            elif c.kind == "log":
                values[c.names[0]] = c.start * float(np.exp(x[k]))
            else:
                values[c.names[0]] = c.start + c.scale * float(x[k])
            k += 1
        allowed = {f.parameter.name: (f.lower, f.upper) for f in self.free}
        for active in self.active:
            for name, value in active.values.items():
                values.setdefault(name, value)
            allowed[active.term.amplitude] = active.term.lower, active.term.upper
            allowed |= {shape.name: (shape.lower, shape.upper) for shape in active.term.shapes}
            if active.onset is not None:
                onsets[active.term.amplitude] = active.onset
        for name, (lower, upper) in allowed.items():
            values[name] = min(max(values[name], lower), upper)  # at a bound, rounding may be beyond it
        return Run(values, onsets, self.added)

    def start(self) -> Vector:
        """Where the fit begins: base parameters in the middle, terms at their given values."""
        x = []
        for c in self.coordinates:
            if c.kind in ("cos", "sin"):
                active = next(a for a in self.active if a.term.amplitude == c.names[0])
                amplitude, phase = active.values[c.names[0]], active.values[c.names[1]]
                x.append(amplitude / c.scale * (np.cos(phase) if c.kind == "cos" else np.sin(phase)))
            elif c.kind == "linear":
                active = next(a for a in self.active if c.names[0] in a.values)
                x.append((active.values[c.names[0]] - c.start) / c.scale)
            else:
                x.append(0.0)
        return np.array(x)


def _coordinates(active: Active) -> list[Coordinate]:
    term, values = active.term, active.values
    amplitude = values[term.amplitude] - term.neutral
    scale = abs(amplitude) or 0.01 * (term.upper - term.neutral)
    found = []
    if term.phase:
        most = term.upper / scale
        pair = (term.amplitude, term.phase)
        found += [Coordinate(pair, 0.0, scale, -most, most, kind, term.component) for kind in ("cos", "sin")]
    else:
        lower, upper = (term.lower - term.neutral) / scale, (term.upper - term.neutral) / scale
        found.append(Coordinate((term.amplitude,), term.neutral, scale, lower, upper, "linear", term.component))
    for shape in term.shapes:
        if shape.whole:
            continue
        start = values[shape.name]
        if shape.logarithmic:
            lower, upper = float(np.log(shape.lower / start)), float(np.log(shape.upper / start))
            found.append(Coordinate((shape.name,), start, start, lower, upper, "log", term.component))
        else:
            begins = term.episode is not None and shape.name == term.episode[0]  # anywhere: its length is the measure
            scale = values[term.episode[1]] if term.episode and begins else 0.1 * (shape.upper - shape.lower)
            lower, upper = (shape.lower - start) / scale, (shape.upper - start) / scale
            found.append(Coordinate((shape.name,), start, scale, lower, upper, "linear", term.component))
    return found


@dataclass
class Fit:
    """A hypothesis at its best point."""

    hypothesis: Hypothesis
    x: Vector
    chi2: float  # of the whitened residual
    residual: Vector  # (rows,)
    simulated: Simulated
    jacobian: Vector  # d(simulated)/dx, (rows, len(x))
    steps: int

    @property
    def cost(self) -> float:
        """chi-square and prior"""
        return self.chi2 + PRIOR * float(np.sum(self.x[: len(self.hypothesis.free)] ** 2))

    @property
    def run(self) -> Run:
        """The simulation at the best point."""
        return self.hypothesis.run(self.x)

    def covariance(self) -> Vector:
        """Of x, for unit noise: (len(x), len(x))"""
        weight = np.full(len(self.x), 1e-9)
        weight[: len(self.hypothesis.free)] = PRIOR
        return np.asarray(np.linalg.pinv(self.jacobian.T @ self.jacobian + np.diag(weight)), dtype=np.float64)

    def settled(self) -> Hypothesis:
        """The same hypothesis, its terms starting at what was found."""
        values = self.run.values
        active = tuple(replace(a, values={n: values[n] for n in a.values}) for a in self.hypothesis.active)
        return replace(self.hypothesis, active=active)

    def estimates(self, units: Mapping[str, str]) -> dict[str, Estimate]:
        """Every parameter that the fit moved or set, with its 95 % interval."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance()), 0.0))
        values, found = self.run.values, {}
        coordinates = self.hypothesis.coordinates
        for k, c in enumerate(coordinates):
            name = c.names[0]
            value = values[name]
            if c.kind == "sin":
                continue
            half = 1.96 * c.scale * sigma[k]
            if c.kind == "cos":
                half = 1.96 * c.scale * float(np.hypot(sigma[k], sigma[k + 1]) / np.sqrt(2))
                spread = half / max(abs(value), 1e-300)
                phase = values[c.names[1]]
                found[c.names[1]] = Estimate(
                    phase, "rad", (phase - min(spread, np.pi), phase + min(spread, np.pi)), None
                )
            if c.kind == "log":
                grow = float(np.exp(min(1.96 * sigma[k], 50.0)))
                interval = (value / grow, value * grow)
            else:
                interval = (value - half, value + half)
            at = "lower" if self.x[k] <= c.lower + 1e-6 else "upper" if self.x[k] >= c.upper - 1e-6 else None
            found[name] = Estimate(value, units.get(name, "1"), interval, at)  # type: ignore[arg-type]
        for name, value in values.items():
            found.setdefault(name, Estimate(value, units.get(name, "1"), (value, value)))
        return found


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
    problem: Problem, hypothesis: Hypothesis, x: Vector, base: Simulated, only: Sequence[int] | None = None
) -> Vector | None:
    """d(simulated)/dx by one-sided differences, inside bounds: (rows, len(x) or len(only)); None: a run failed."""
    runs, steps = [], []
    coordinates = hypothesis.coordinates
    for k in range(len(coordinates)) if only is None else only:
        c = coordinates[k]
        step = _step(problem, c, float(x[k]))
        steps.append(step if x[k] + step <= c.upper else -step)
        point = x.copy()
        point[k] += steps[-1]
        runs.append(replace(hypothesis.run(point), touches=(c.component,)))
    found = problem.simulate(runs, base)
    columns = [(f.white - base.white) / step for f, step in zip(found, steps, strict=True) if f is not None]
    return np.column_stack(columns) if len(columns) == len(runs) else None


def _step(problem: Problem, coordinate: Coordinate, x: float) -> float:
    """Of a difference quotient: short where a tolerance is wide, for what is fitted may bend over it."""
    value = abs(coordinate.start + coordinate.scale * x)
    if coordinate.kind != "base" or value == 0:
        return problem.step
    return min(problem.step, max(WIDE * value / coordinate.scale, 0.1 * problem.step))


def fit(
    problem: Problem,
    hypothesis: Hypothesis,
    x: Vector | None = None,
    jacobian: Vector | None = None,
    *,
    settled: float = 1.0,
    roughly: float = 0.0,
    most: int = 30,
    fresh_most: int = 100,
) -> Fit | None:
    """Levenberg-Marquardt inside bounds; Broyden's update where a step came as promised, differences where not: first
    of the terms' own columns, which are few and bend most, then of all.

    x, jacobian: where to start, and an approximate Jacobian there (rows, len(x)). settled: chi-square below which a
    further step is not worth its run; roughly: the same as a share of what is above noise. fresh_most: Jacobians by
    differences at most. None: the start cannot be simulated.
    """
    coordinates = hypothesis.coordinates
    lower, upper = np.array([c.lower for c in coordinates]), np.array([c.upper for c in coordinates])
    prior = np.where([c.kind == "base" for c in coordinates], PRIOR, 1e-9)
    own = [k for k, c in enumerate(coordinates) if c.kind != "base"]
    at = np.clip(hypothesis.start() if x is None else x, lower, upper)
    base = problem.simulate([hypothesis.run(at)])[0]
    if base is None:
        return None
    residual = problem.recorded - base.white
    cost = float(residual @ residual + prior @ at**2)
    J, age = (difference(problem, hypothesis, at, base), FRESH) if jacobian is None else (jacobian, OLD)
    damping = DAMPING * max(cost - problem.samples, 0.0)
    begun = np.inf  # cost with the last fresh Jacobian
    for step_number in range(1, most + 1):  # noqa: B007 - the last one is told below
        if J is None:
            return None
        begun = cost if age == FRESH else begun
        gram, gradient = J.T @ J + np.diag(prior), J.T @ residual - prior * at
        step, _ = bounded_step(gram + damping * np.eye(len(at)), gradient, lower - at, upper - at)
        promised = float(2 * gradient @ step - step @ gram @ step)
        trial = np.clip(at + step, lower, upper)
        found = problem.simulate([hypothesis.run(trial)])[0]
        rest = problem.recorded - found.white if found is not None else residual
        new = float(rest @ rest + prior @ trial**2) if found is not None else np.inf
        gained = cost - new
        youngest = FRESH if fresh_most > 0 else OWN if own else OLD  # that can be had
        worth = max(settled, roughly * max(min(cost, new) - problem.samples, 0.0))
        enough = roughly > 0 and begun - min(cost, new) < LAST * worth  # a damped step's small gain is no end
        if found is None or gained <= 0:
            if promised < settled or (age == OLD and enough):
                break
            if age < youngest:
                J, age, fresh_most = _renewed(problem, hypothesis, at, base, J, own, age, fresh_most)
            elif age == OLD:
                break
            else:
                damping = max(5 * damping, 1e-2 * max(cost - problem.samples, settled))
            continue
        moved, used = trial - at, age
        J = J + np.outer(found.white - base.white - J @ moved, moved) / float(moved @ moved)
        at, base, residual, cost, age = trial, found, rest, new, OLD
        slow = gained < worth
        if slow and (used >= youngest or enough):
            break
        kept = gained / promised
        damping *= 0.01 if abs(kept - 1) < AS_PROMISED else 0.15 if kept > 0.7 else 0.5 if kept > 0.4 else 1.5
        if slow or kept < 1 - AS_PROMISED:
            if slow and used == OWN and fresh_most > 0:
                age = OWN  # own columns have been renewed, and that was not enough
            J, age, fresh_most = _renewed(problem, hypothesis, at, base, J, own, age, fresh_most)
    if J is None:
        return None
    return Fit(hypothesis, at, float(residual @ residual), residual, base, J, step_number)


def _renewed(
    problem: Problem,
    hypothesis: Hypothesis,
    x: Vector,
    base: Simulated,
    J: Vector,
    own: Sequence[int],
    age: int,
    fresh_most: int,
) -> tuple[Vector | None, int, int]:
    """(Jacobian, its age, fresh ones left): the next younger one of an old Jacobian; itself where none is left."""
    if age == OLD and own:
        columns = difference(problem, hypothesis, x, base, own)
        if columns is None:
            return None, OLD, fresh_most
        J = J.copy()
        J[:, own] = columns
        return J, OWN, fresh_most
    if fresh_most > 0:
        return difference(problem, hypothesis, x, base), FRESH, fresh_most - 1
    return J, age, fresh_most


def promised(found: Fit) -> float:
    """Cost that a further step would take, by the fit's own Jacobian."""
    coordinates = found.hypothesis.coordinates
    prior = np.where([c.kind == "base" for c in coordinates], PRIOR, 1e-9)
    lower, upper = np.array([c.lower for c in coordinates]), np.array([c.upper for c in coordinates])
    gram, gradient = found.jacobian.T @ found.jacobian + np.diag(prior), found.jacobian.T @ found.residual
    return bounded_step(gram, gradient - prior * found.x, lower - found.x, upper - found.x)[1]


def tolerances(problem: Problem, bounds: Mapping[str, tuple[float, float]]) -> tuple[Free, ...]:
    """Base parameters that a diagnosis may re-fit, as far as their units allow it."""
    parameters = problem.plant.parameters
    found = [Free(p, max(low, p.lower), min(high, p.upper)) for p, (low, high) in
             ((parameters[name], both) for name, both in bounds.items())]  # fmt: skip
    return tuple(
        free
        for free in found
        if free.lower < free.upper and any(problem.plant.has(free.parameter.name, r) for r in problem.recordings)
    )
