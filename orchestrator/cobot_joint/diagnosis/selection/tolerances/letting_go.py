"""Fits in which one base parameter goes beyond its tolerance, and those in which another does as well in its place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.effects import BaseParameter, FreeParameter
from cobot_joint.diagnosis.estimation.fit import AT_BOUND, Fit
from cobot_joint.diagnosis.estimation.least_squares import difference, fit, predicted_decrease
from cobot_joint.diagnosis.estimation.multiscale import slow_first
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.estimation.projection import solve
from cobot_joint.diagnosis.plant.plant import Parameter
from cobot_joint.diagnosis.selection.competition import Competition, finished
from cobot_joint.diagnosis.selection.tolerances.far_off import values_from_afar

TRIED = 4  # parameters that are fitted, of those from which the Jacobian expects most; beside listed terms one
SEEN = 0.1  # share of what it has to take, by which one that is 0 moves what is simulated for a fit to begin there
DECADES = 6  # in which the size of a parameter that is 0 is looked for: a gear of 1000 lies between two shafts


def slack_of(problem: Problem, found: Fit) -> float:
    """Cost by which another may differ from it, and cannot be told from it."""
    return thresholds.ALIKE + thresholds.ALIKE_SHARE * max(problem.excess(found.residual), 0.0)


def leaves_least(problem: Problem, calibrated: Fit, least: float, tried: int = TRIED) -> Fit | None:
    """A fit with that parameter free which leaves least, of the few that promise most; None: none promises so much.

    Where the best leaves what stands out, also of those that take most of it from afar.
    """
    best = nearby(problem, calibrated, least, tried)
    if not problem.stands_out((best or calibrated).residual):
        return best
    values, most = values_from_afar(problem, calibrated)[:tried], calibrated.cost - least
    far = [free for name, value in values for free in freed(calibrated, {name: value}, at_bounds=False)]
    fits = [slow_first(problem, free.hypothesis, free.x, finished(1), most) for free in far]
    return lowest([best, *(each for each in fits if each and each.cost < most)])


def nearby(problem: Problem, calibrated: Fit, least: float, tried: int) -> Fit | None:
    """The same, of those that promise so much by their sensitivities."""
    promising = sorted(((predicted_decrease(free), k, free) for k, free in enumerate(freed(calibrated))), reverse=True)
    enough = max(least, thresholds.WORTH_FITTING * promising[0][0]) if promising else least
    near = [each[2] for each in promising if each[0] > enough][:tried]
    best = lowest([fit(problem, free.hypothesis, free.x, free.jacobian, finished(1)) for free in near])
    return Competition(problem).finished(best) if best is not None and problem.unexplained(best.residual) else best


def left_by_parameters(found: Fit, term: str) -> float:
    """Chi-square of what a term does that all base parameters, wherever their bounds are, and all other terms leave of
    it, in linear terms: where that is most of it, no parameter stands in for it."""
    at = found.settled()
    (active,) = (a for a in at.hypothesis.terms if a.name == term)
    coordinates = at.hypothesis.coordinates
    own = np.array([c.names[0].startswith(f"{term}.") for c in coordinates])
    sizes = np.array([active.term.amplitude in c.names for c in coordinates])
    does, others = at.jacobian[:, sizes] @ at.x[sizes], at.jacobian[:, ~own]
    rest = does - others @ solve(others.T @ others, others.T @ does)
    return float(rest @ rest)


def in_its_place(problem: Problem, calibrated: Fit, best: Fit) -> tuple[str, ...]:
    """Parameters that, let go of in its place, leave as little: a carriage of 8.4 kg for 6 was a rotor of 3.7 times its
    inertia, 95 %, on a shaft that turns as if stiff."""
    name, gain = best.hypothesis.effects[-1].name, calibrated.cost - best.cost
    slack = slack_of(problem, best)
    bound = [free for free in freed(calibrated) if free.hypothesis.effects[-1].name != name]
    every = [*bound, *_without_tolerance(problem, calibrated, name, gain)]
    likely = sorted(every, key=predicted_decrease, reverse=True)[: TRIED - 1]
    found = []
    for free in (each for each in likely if predicted_decrease(each) > thresholds.ALONE * gain):
        other = fit(problem, free.hypothesis, free.x, free.jacobian, finished(1))
        if other is not None and Competition(problem).finished(other).cost - best.cost < slack:
            found.append(free.hypothesis.effects[-1].name)
    return tuple(found)


def _without_tolerance(problem: Problem, calibrated: Fit, name: str, gain: float) -> list[Fit]:
    """The fit with each parameter of the same unit of measure free that the campaign holds at its value, which may be
    as wrong: a conveyor's roller had the viscous friction, 0 in its system, that went to its motor, 95 %.

    gain: cost that it has to take.
    """
    plant, at = problem.plant, calibrated.settled()
    of_terms = {n for t in plant.terms for n in (t.amplitude, t.phase, *(s.name for s in t.shapes))}
    known = of_terms | {effect.name for effect in (*at.hypothesis.base, *at.hypothesis.effects)}
    same = [p for p in plant.parameters.values() if p.unit == plant.parameters[name].unit]
    there = [p for p in same if any(plant.has(p.name, recording) for recording in problem.recordings)]
    least = min(abs(p.nominal) for p in same if p.nominal) if any(p.nominal for p in same) else 1.0
    fits = [_released(problem, at, p, least, SEEN * gain) for p in there if p.name not in known]
    return [free for free in fits if free is not None]


def _released(problem: Problem, at: Fit, p: Parameter, least: float, seen: float) -> Fit | None:
    """The fit with a parameter that had no tolerance free at its value; None: it moves nothing that is recorded.

    least, seen: of one that is 0, the size from which on it is tried, and chi-square by which it has to move the rows.
    """
    sizes = [abs(p.nominal) / 3] if p.nominal else [least * 10.0**k for k in range(DECADES)]
    for size in sizes:
        free = FreeParameter(BaseParameter(p, max(p.nominal - size, p.lower), p.nominal + size), p.nominal)
        hypothesis, x = at.hypothesis.with_effects(free), np.append(at.x, free.start())
        column = difference(problem, hypothesis, x, at.simulated, [len(at.x)])
        if column is None:
            return None
        if p.nominal or float(np.sum(column**2)) > seen:
            return replace(at, hypothesis=hypothesis, x=x, jacobian=np.column_stack([at.jacobian, column]))
    return None


def lowest(fits: Sequence[Fit | None]) -> Fit | None:
    """The one of lowest cost."""
    return min((each for each in fits if each is not None), key=lambda each: each.cost, default=None)


def freed(calibrated: Fit, values: Mapping[str, float] | None = None, at_bounds: bool = True) -> list[Fit]:
    """The fit with each base parameter that is at a bound free of it, in the fit's own linear terms. values: of those
    that begin elsewhere, at a bound or not. at_bounds: the others, too."""
    at, known, found = calibrated.settled(), values or {}, []
    hypothesis, count = at.hypothesis, len(at.x)
    for k, base in enumerate(hypothesis.base):
        (c,) = base.coordinates
        if base.name not in known and (not at_bounds or abs(at.x[k]) < 1 - AT_BOUND):
            continue
        free = FreeParameter(base, known.get(base.name, c.start + c.scale * float(at.x[k])))
        if free.coordinates[0].lower > c.lower - AT_BOUND and free.coordinates[0].upper < c.upper + AT_BOUND:
            continue  # it may go no farther
        order = [*(j for j in range(count) if j != k), k]
        others = tuple(other for other in hypothesis.base if other is not base)
        less = replace(hypothesis, base=others, effects=(*hypothesis.effects, free))
        x = np.append(np.delete(at.x, k), free.start())
        found.append(replace(at, hypothesis=less, x=x, jacobian=np.asarray(at.jacobian[:, order])))
    return found


def needed(problem: Problem, outside: Fit) -> float | None:
    """Cost that the parameter takes from all that is beside it. None: too little for a name."""
    inside = held(problem, outside)
    gain = inside.cost - outside.cost if inside is not None else np.inf
    return gain if np.isfinite(gain) and gain >= problem.evidence else None


def held(problem: Problem, outside: Fit) -> Fit | None:
    """The same with the parameter inside its tolerance again, all else re-fitted. None: it cannot be simulated."""
    at = outside.settled()
    hypothesis, count = at.hypothesis, len(at.hypothesis.base)
    n, free = next((n, e) for n, e in enumerate(hypothesis.effects) if isinstance(e, FreeParameter))
    others = tuple(e for e in hypothesis.effects if e is not free)
    k = count + sum(len(e.coordinates) for e in hypothesis.effects[:n])
    order = [*range(count), k, *(j for j in range(count, len(at.x)) if j != k)]
    inside = replace(hypothesis, base=(*hypothesis.base, free.base), effects=others)
    x = at.x[order]
    x[count] = np.clip(x[count], -1, 1)
    return fit(problem, inside, x, np.asarray(at.jacobian[:, order]), finished(1))
