"""What no signal announces: somebody holds or pushes the machine for a while, or something gives way at one moment.

Where the difference is confined to short times that no listed term explains, courses in time are fitted at a port:
per recording and episode a trapezoid, or for all recordings one jump.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.candidates.load_histories import (
    Hold,
    Inferred,
    Jump,
    clock,
    fitted,
    outline,
    promised_by,
    responses,
)
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.port_response import PROBE
from cobot_joint.diagnosis.estimation.problem import BLOCK, Problem, Vector
from cobot_joint.diagnosis.findings import Course, Estimate, Feature, Finding, Form
from cobot_joint.diagnosis.localization.evidence import locate_gain
from cobot_joint.diagnosis.plant.plant import Port
from cobot_joint.diagnosis.selection.confidence import confidence
from cobot_joint.diagnosis.selection.stepwise import EVIDENCE, Named, Naming
from cobot_joint.diagnosis.selection.unmodelled import FLOOR, STANDS, Unlisted

HELD = 0.9  # of what is above noise, that the short times hold
BRIEF = 0.1  # of all the time, that they may take
APART = 0.3  # s without a difference, that part one episode from the next
RISEN = 0.01  # of an episode's largest residual energy, up to which it has not begun
TAKEN = 0.9  # of what is above noise, that a jump must take, which has two numbers
HELD_UP = 0.98  # the same for trapezoids, which have five each
MOST = 4  # ports and kinds of courses that are fitted
PROMISING = 0.3  # of what is above noise, that a linear step from nothing must promise
CLEAR = 0.8  # the same, for a hand to be asked before any term
UNLOGGED = 1.1  # times its promise, for an input of the system: it is there for something to enter

Spans = dict[int, list[tuple[float, float]]]  # recording -> (from, to), s


def look_for_episodes(
    problem: Problem, listed: Naming, name: Callable[[Fit], Naming], say: Callable[[str], None]
) -> Unlisted | None:
    """None: listed terms explain it, it is not confined to short times, or no course takes TAKEN of it.

    First in place of what is listed, then beside it. name: listed terms from a fit on, for what is left beside courses.
    """
    before, left = (problem.excess(fit.residual) for fit in (listed.history[0], listed.fit))
    if left < 10 * problem.excess_scatter:
        return None
    found = None
    if not listed.named or left > STANDS * before:
        found = _beside(problem, replace(listed, fit=listed.history[0], named=[]), name, say)
    if found is None and listed.named and left > FLOOR * before:
        found = _beside(problem, listed, name, say)
    return found


def look_for_a_hand(
    problem: Problem, calibrated: Fit, name: Callable[[Fit], Naming], say: Callable[[str], None]
) -> Unlisted | None:
    """Holds at an input that nobody logged, where these and listed terms beside them explain all there is.

    Asked before any term is named: a hand that comes and goes as it likes leaves terms nothing but patches.
    """
    above, spans = calibrated.chi2 - problem.samples, short_times(problem, calibrated.residual)
    if not spans or not problem.unexplained(calibrated.residual):
        return None
    begun = [b for port in _unlogged(problem) for b in _holds(problem, calibrated, port, spans)]
    likely = [b for b in begun if promised_by(problem, b) > CLEAR * above]
    for hand in likely:
        best, named = _named_on(problem, fitted(problem, hand), [], name, say)
        if not problem.unexplained(best.fit.residual):
            taken = _taken(problem, calibrated, best)
            return Unlisted(best.fit, named, _finding(problem, calibrated, best, taken), taken)
    return None


def _taken(problem: Problem, start: Fit, best: Inferred) -> float:
    """Share of the slow structure."""
    return 1 - problem.excess(best.fit.residual) / problem.excess(start.residual)


def _named_on(
    problem: Problem, best: Inferred, named: list[Named], name: Callable[[Fit], Naming], say: Callable[[str], None]
) -> tuple[Inferred, list[Named]]:
    """Courses and terms, where listed terms take what courses leave."""
    say(f"{best.port.name}, {_said(best)}: leaves {best.fit.chi2 - problem.samples:.0f} above noise")
    if problem.unexplained(best.fit.residual):
        further = name(best.fit)
        if further.named:
            return fitted(problem, replace(best, fit=further.fit)), [*named, *further.named]
    return best, named


def _unlogged(problem: Problem) -> list[Port]:
    """Inputs of the system that no recording has."""
    inputs = [p for p in problem.plant.inputs if p.unit in PROBE]
    return [p for p in inputs if not any(p.connector in r.inputs for r in problem.recordings)]


def _beside(
    problem: Problem, listed: Naming, name: Callable[[Fit], Naming], say: Callable[[str], None]
) -> Unlisted | None:
    """Courses beside the terms of a naming's fit; None: none takes enough of what these leave."""
    start, named = listed.fit, listed.named
    spans = short_times(problem, start.residual)
    best = _best(problem, start, spans, say) if spans else None
    if best is None or start.cost - best.fit.cost < EVIDENCE:
        return None
    if isinstance(best.courses[0], Hold):
        best, named = _named_on(problem, best, named, name, say)
    taken = _taken(problem, start, best)
    enough = TAKEN if isinstance(best.courses[0], Jump) else HELD_UP
    return Unlisted(best.fit, named, _finding(problem, start, best, taken), taken) if taken > enough else None


def _best(problem: Problem, start: Fit, spans: Spans, say: Callable[[str], None]) -> Inferred | None:
    """Of the ports and courses that promise most; None: none promises much."""
    unlogged = _unlogged(problem)
    additive = [port for port in problem.plant.ports if port.unit in PROBE]
    if not unlogged and not additive:
        return None
    say("the difference is confined to short times: looking for what acts then")
    begun = [b for port in (*unlogged, *additive) for b in _holds(problem, start, port, spans)]
    begun += [b for port in additive for b in _jumps(problem, start, port, spans)]
    promise = [promised_by(problem, b) * (UNLOGGED if b.port in unlogged else 1.0) for b in begun]
    above = start.chi2 - problem.samples
    best: Inferred | None = None
    for k in np.argsort(promise)[::-1][:MOST]:
        if promise[k] > PROMISING * above and (best is None or problem.unexplained(best.fit.residual)):
            found = fitted(problem, begun[k])
            say(f"{begun[k].port.name}: {found.fit.chi2 - problem.samples:.0f} above noise are left")
            best = found if best is None or found.fit.cost < best.fit.cost else best
    return best


def short_times(problem: Problem, residual: Vector) -> Spans:
    """Recording -> (from, to) of the times that hold HELD of what is above noise; empty: these are not short."""
    energies = [_energy(problem, residual, n) for n in range(len(problem.recordings))]
    flat = np.sort(np.concatenate(energies))[::-1]
    count = int(np.searchsorted(np.cumsum(flat), HELD * flat.sum())) + 1
    if count > BRIEF * len(flat):
        return {}
    spans = {}
    for n, energy in enumerate(energies):
        time = clock(problem, n)
        joined: list[tuple[float, float]] = []
        for k in np.flatnonzero(energy >= flat[count - 1]):
            a, b = float(time[k * BLOCK]), float(time[(k + 1) * BLOCK - 1])
            if joined and a - joined[-1][1] < APART:
                joined[-1] = joined[-1][0], b
            else:
                joined.append((a, b))
        if joined:
            spans[n] = joined
    return spans


def _holds(problem: Problem, start: Fit, port: Port, spans: Spans) -> list[Inferred]:
    """A trapezoid over every span, of no height yet."""
    there = {n: s for n, s in spans.items() if problem.plant.has(port.name, problem.recordings[n])}
    courses = [
        Hold((n,), 0.0, (a - 0.1 * (b - a), a + 0.1 * (b - a), b - 0.1 * (b - a), b + 0.1 * (b - a)))
        for n, each in there.items()
        for a, b in each
    ]
    return [Inferred(port, tuple(courses), start)] if courses else []


def _jumps(problem: Problem, start: Fit, port: Port, spans: Spans) -> list[Inferred]:
    """A jump where the longest trace begins, of no height yet."""
    there = [n for n, r in enumerate(problem.recordings) if problem.plant.has(port.name, r)]
    shown = [(n, span) for n in there if n in spans for span in spans[n]]
    if not shown:
        return []
    n, (a, b) = max(shown, key=lambda each: _held(problem, start.residual, each[0], *each[1]))
    return [
        Inferred(port, (Jump(tuple(there), 0.0, _begins(problem, start.residual, n, a, b), _step(problem, n)),), start)
    ]


def _held(problem: Problem, residual: Vector, n: int, a: float, b: float) -> float:
    time = clock(problem, n)[::BLOCK]
    energy = _energy(problem, residual, n)
    inside = (time[: len(energy)] >= a - 1e-9) & (time[: len(energy)] <= b)
    return float(energy[inside].sum())


def _begins(problem: Problem, residual: Vector, n: int, a: float, b: float) -> float:
    """When the trace of a span begins: at the sample before the first that has RISEN of its largest energy."""
    time = clock(problem, n)
    total = np.asarray(sum(residual[block.rows] ** 2 for block in problem.blocks if block.recording == n))
    inside = np.flatnonzero((time >= a - BLOCK * _step(problem, n)) & (time <= b))
    first = inside[int(np.argmax(total[inside] > RISEN * total[inside].max()))]
    return float(time[max(first - 1, 0)])


def _energy(problem: Problem, residual: Vector, n: int) -> Vector:
    """Chi-square above its expectation per block of a recording: (blocks,)"""
    count = len(problem.recordings[n].time) // BLOCK
    total = np.zeros(count)
    for block in problem.blocks:
        if block.recording == n:
            total += np.sum(residual[block.rows][: count * BLOCK].reshape(-1, BLOCK) ** 2, axis=1) - BLOCK
    return np.maximum(total, 0.0)


def _step(problem: Problem, n: int) -> float:
    return float(np.median(np.diff(problem.recordings[n].time)))


def _said(found: Inferred) -> str:
    if isinstance(found.courses[0], Jump):
        return f"a jump of {found.courses[0].A:.4g} {found.port.unit} at {found.courses[0].t_0:.4f} s"
    largest = max(abs(float(c.x[0])) for c in found.courses)
    return f"{len(found.courses)} times for a while, up to {largest:.4g} {found.port.unit}"


def _finding(problem: Problem, start: Fit, best: Inferred, taken: float) -> Finding:
    """A jump is on no list; a hold at an input that was not logged, or at one port, is what the unit lists as such."""
    port, gain = best.port, start.cost - best.fit.cost
    where, words = locate_gain(problem, start.residual**2 - best.fit.residual**2)
    jump = best.courses[0] if isinstance(best.courses[0], Jump) else None
    listed = (
        None
        if jump
        else next((t.name for t in problem.plant.terms if t.episode and t.component == port.component), None)
    )
    form, course = None, None
    if jump:
        feature = Feature("1", Estimate(jump.A, port.unit, _interval(problem, best)))
        form = Form(port.name, port.unit, (), f"{jump.A:.4g}", (feature,), round(taken, 3))
    else:
        holds = [c for c in best.courses if isinstance(c, Hold)]
        courses = {n: outline([c for c in holds if n in c.where]) for n in sorted({n for c in holds for n in c.where})}
        course = Course(port.name, port.unit, {problem.recordings[n].name: xy for n, xy in courses.items()})
    left = max(problem.excess(best.fit.residual), 0.0)
    return Finding(
        term=listed or f"{port.component}.unlisted",
        equivalent=(),
        confidence=confidence(gain, left, unlisted=listed is None),
        onset=jump.t_0 if jump else None,
        parameters={},
        where=where,
        gain=gain,
        shape=form,
        course=course,
        words=f"at {port.name}, {_said(best)}; {words}",
    )


def _interval(problem: Problem, best: Inferred) -> tuple[float, float]:
    """95 % of the first course's amplitude, all else free."""
    vectors = np.column_stack([best.fit.jacobian, *(c.vector for c in responses(problem, best))])
    k = best.fit.jacobian.shape[1]
    half = 1.96 * float(np.sqrt(np.linalg.pinv(vectors.T @ vectors)[k, k].clip(0.0)))
    A = float(best.courses[0].x[0])
    return A - half, A + half
