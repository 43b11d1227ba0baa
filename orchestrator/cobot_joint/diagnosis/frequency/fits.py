"""Fits of a frequency response: first on the frequencies that cost little, then on all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cobot_joint.diagnosis.data.campaign_file import Alternative
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import Precision, fit
from cobot_joint.diagnosis.estimation.problem import Problem, Run
from cobot_joint.diagnosis.findings import Candidate
from cobot_joint.diagnosis.frequency.ranking import WITHIN_REACH, rank, start
from cobot_joint.diagnosis.frequency.response import Response, problems
from cobot_joint.diagnosis.plant.frequency_plant import CHANNEL
from cobot_joint.errors import UserError

ROUGH = Precision(roughly=0.03)  # of fits that only compete
SHORT = Precision(steps=4)  # on all frequencies, after a fit on those that cost little
FINISHED = Precision(settled=0.1, steps=12)  # a term and what it stands in for leave a narrow valley
ROUNDS, GAINED = 8, 0.5  # of such fits at most, and chi-square that one has to gain; two that do not are the end


def rms_log(problem: Problem, outcome: Fit | Run) -> float:
    """rms of ln(simulated/measured)"""
    run = outcome.run if isinstance(outcome, Fit) else outcome
    misfit = [
        simulated[CHANNEL] - recording.outputs[CHANNEL]
        for simulated, recording in zip(problem.outputs(run), problem.recordings, strict=True)
    ]
    return float(np.sqrt(np.mean(np.square(misfit))))


def calibrate(response: Response, alternative: Alternative) -> tuple[float, Fit]:
    """rms of ln(simulated/measured) as specified, and the base model re-fitted inside its tolerances."""
    with problems(response, alternative) as (problem, fast):
        nominal = rms_log(problem, Run({}))
        parameters = problem.plant.parameters
        bounds = {n: t.bounds(parameters[n].nominal) for n, t in response.given.tolerances.items() if n in parameters}
        hypothesis = Hypothesis(tolerances(problem, bounds))
        rough = fit(fast, hypothesis)
        found = fit(problem, hypothesis, rough.x if rough else None, precision=SHORT)
        if found is None:
            raise UserError(
                f"{response.path}: {alternative.name}: no amplitude comes out in the middle of the tolerances"
            )
        return nominal, found


def ranked(response: Response, alternative: Alternative, base: Fit) -> list[Candidate]:
    """Every term of the system, by what it would take of chi-square under this reading."""
    with problems(response, alternative) as (_, fast):
        return rank(fast, base, fast.plant.terms)


def roughly(response: Response, alternative: Alternative, base: Fit, candidates: Sequence[Candidate]) -> dict[str, Fit]:
    """The candidates, each fitted with everything else to the frequencies that cost little."""
    found = {}
    with problems(response, alternative) as (_, fast):
        every_other = fast.part(range(0, len(fast.recordings), 2))  # enough for where to begin
        for candidate in candidates:
            term = next(t for t in fast.plant.terms if t.name == candidate.term)
            begin = start(every_other, base, term)
            rough = fit(fast, base.hypothesis.with_effects(begin), precision=ROUGH) if begin else None
            if rough is not None:
                found[term.name] = rough
    return found


def on_all(response: Response, alternative: Alternative, rough: Mapping[str, Fit], best: float) -> dict[str, Fit]:
    """Fits on all frequencies: to the end where the rough one is near the `best` chi-square, else a few steps."""
    fits = {}
    with problems(response, alternative) as (problem, _):
        for name, begun in rough.items():
            at = begun.settled()
            near = begun.chi2 < WITHIN_REACH * best
            found = fit(problem, at.hypothesis, at.x, precision=FINISHED if near else SHORT)
            if found is not None:
                fits[name] = _to_the_end(problem, found) if near else found
    return fits


def _to_the_end(problem: Problem, best: Fit) -> Fit:
    """Fitted again from where it ended while that helps.

    In a narrow valley over rough amplitudes steps end early, and a fresh Jacobian finds the way on.
    """
    at, idle = best.settled(), 0
    for _ in range(ROUNDS):
        found = fit(problem, at.hypothesis, at.x, precision=FINISHED)
        if found is None:
            break
        idle = idle + 1 if best.cost - found.cost < GAINED else 0
        best = found if found.cost < best.cost else best
        if idle == 2:
            break
        at = found.settled()
    return best
