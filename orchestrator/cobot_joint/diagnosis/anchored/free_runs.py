"""What the search along the recorded motion found, held against free runs: the better of both stands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.anchored.beside import Candidate
from cobot_joint.diagnosis.anchored.search import Search, confidence
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import fit_added
from cobot_joint.diagnosis.estimation.problem import Problem, Run
from cobot_joint.diagnosis.estimation.recorded_motion import at_recorded_angle
from cobot_joint.diagnosis.findings import Diagnosis, Finding
from cobot_joint.diagnosis.selection.competition import finished
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.state_estimation.noise import noise_of
from cobot_joint.diagnosis.state_estimation.prediction import Variant, predicted_figures

NEXT_TO_NONE = 0.1  # of a size: a friction of 1.4e-6 N.m, fitted to free runs, was claimed for one along the motion
Values = Mapping[str, float]
Judge = Callable[[Values, Values, Values], bool]


def in_free_runs(
    problem: Problem, found: Diagnosis, search: Search, refit: Fit, units: Mapping[str, str], predicts: Judge
) -> Diagnosis:
    """Before and after as the fit that leaves less of free runs has them: along the recorded motion, or free. After as
    the recorded motion has it, where that predicts better: in free runs a wave loses its angle, and is fitted small.

    One that was fitted along the recorded motion may lose free runs: a repair that beats a worse re-fit has shown
    nothing, and where nothing has a name, nothing is repaired; it is called a background only as long as it is small.
    units: parameter -> unit of measure. predicts: see predicts_better.
    """
    if _left(problem, found.parameters("calibrated"), {}) >= refit.chi2:
        found.calibrated = refit.estimates(units, problem.stretches(refit.residual))
    if not found.findings:
        found.repaired = dict(found.calibrated)
        found.verdict = "undecided" if problem.stands_out(refit.residual) else "nothing_missing"
        return found
    onsets = _onsets(search)
    free, own = freely(problem, search, refit), found.parameters("repaired")
    if free is not None and free.chi2 < _left(problem, own, onsets) and not predicts(own, free.run.values, onsets):
        found.repaired = free.estimates(units, problem.stretches(free.residual))
        found.findings = [
            _as_large(replace(f, parameters={n: found.repaired.get(n, e) for n, e in f.parameters.items()}), f, search)
            for f in found.findings
        ]
    return found


def _as_large(free: Finding, along: Finding, search: Search) -> Finding:
    """A finding as free runs have it; no claim where that is next to none of what the recorded motion has."""
    terms = (n.candidate.term for n in search.named if n.candidate.term.name == free.term)
    for term in terms:
        size, was = (f.parameters.get(term.amplitude) for f in (free, along))
        if size and was and abs(size.value - term.neutral) < NEXT_TO_NONE * abs(was.value - term.neutral):
            return free.withheld("free runs have next to none of it")
    return free


def spoils(problem: Problem, found: Diagnosis, search: Search, refit: Fit) -> bool:
    """Whether free runs with what the recorded motion named are off by twice what they are without: it is none of what
    is missing there. A wheel drive's Stribeck friction and weight had been a gap and an angle error, which left 12
    times as much."""
    if not found.findings:
        return False
    left = _left(problem, found.parameters("repaired"), _onsets(search)) - problem.samples
    return left * thresholds.HOLDS > problem.above(refit.residual)


def _onsets(search: Search) -> dict[str, float]:
    """Amplitude -> s, from when on it holds."""
    return {n.candidate.term.amplitude: n.candidate.onset for n in search.named if n.candidate.onset is not None}


def predicts_better(campaign: Campaign, values: Values, others: Values, onsets: Values) -> bool:
    """Whether a system with these values predicts the recordings over short distances better than with others.

    onsets: s, from when on some of them hold.
    """
    systems, train = campaign.systems(), campaign.train
    noise = noise_of(replace(campaign, recordings=train))
    both = {"these": Variant(systems, values, onsets), "others": Variant(systems, others, onsets)}
    try:
        figures = predicted_figures(train, both, noise)
    except SimulationError:  # no state can be reached: there is nothing to go by but free runs
        return False
    known = [(of, noise[channel].sigma) for channel, of in figures.items() if of is not None]
    these, them = (sum((of[name] / sigma) ** 2 for of, sigma in known) for name in both)
    return these < them


def felt(problem: Problem, base: Fit, listed: Fit, search: Search) -> Search:
    """With what each named term does to free runs, beside what these leave: without any, with all that was named, or
    with the listed terms.

    The recorded motion shows a wave of a tenth of a milli-newton-metre over a motor's angle, and every drawn background
    has one (machines 151/1, 151/19, 127/5 took 0.03 and less of what was left, concealed effects 0.16 and more).
    """
    values = {name: estimate.value for name, estimate in search.repaired.items()}
    own = [{n: values.get(n, x) for n, x in named.candidate.values.items()} for named in search.named]
    late = [{n.candidate.term.amplitude: n.candidate.onset} if n.candidate.onset is not None else {}
            for n in search.named]  # fmt: skip
    runs = [base.run.with_values(x, t) for x, t in zip(own, late, strict=True)]
    together = base.run
    for x, t in zip(own, late, strict=True):
        together = together.with_values(x, t)
    *each, every = problem.simulate([*runs, together])
    left = problem.above(base.residual)
    named_all = np.inf if every is None else float(np.sum((problem.recorded - every.white) ** 2))
    rest = max(min(named_all, listed.chi2) - problem.samples, 0.0)
    named = []
    for one, simulated in zip(search.named, each, strict=True):
        moved = np.inf if simulated is None else float(np.sum((simulated.white - base.simulated.white) ** 2))
        named.append(replace(one, shows=moved >= thresholds.WORTH * min(left, rest + moved)))
    return replace(search, named=named)


def beside_listed(problem: Problem, listed: Selection, search: Search) -> tuple[Fit, list[Selected]] | None:
    """Listed terms that take most of free runs, and what the recorded motion claims beside them, fitted together, waves
    at the angle of the recordings, which free runs lose.

    None: it claims nothing else, or free runs are no better for it.
    """
    on = {s.term for s in listed.selected}
    twins = [pair for pair in listed.indistinguishable.items() if on & set(pair)]
    known = on.union(*(s.alike for s in listed.selected), *twins)
    terms = {term.name for term in problem.plant.terms}
    claimed = [n for n in search.named if n.name in terms - known and confidence(n) >= thresholds.EVEN]
    at, selected = listed.fit, list(listed.selected)
    values = {name: estimate.value for name, estimate in search.repaired.items()}
    for named in claimed:
        term = at_recorded_angle(problem, at.run, _as_repaired(named.candidate, values))
        found = fit_added(problem, at, [term], finished(jacobians=1))
        if found is not None and at.cost - found.cost > problem.evidence:
            alike = dict.fromkeys((name for name in named.alike if name not in known), 0.0)
            selected.append(Selected(named.name, at.cost - found.cost, alike))
            at = found
    return (at, selected) if at is not listed.fit else None


def _left(problem: Problem, values: Mapping[str, float], onsets: Mapping[str, float]) -> float:
    """Chi-square of free runs with these values; infinite where there are none, or no such runs."""
    runs = problem.simulate([Run(values, onsets)])[0] if values else None
    return np.inf if runs is None else float(np.sum((problem.recorded - runs.white) ** 2))


def freely(problem: Problem, search: Search, refit: Fit) -> Fit | None:
    """The re-fitted base model with the terms that the recorded motion named, from where it has them, all free, waves
    at the angle of the recordings.

    None: one of them is a base parameter, or they cannot be simulated.
    """
    terms = {term.name for term in problem.plant.terms}
    if any(n.name not in terms for n in search.named):
        return None
    values = {name: estimate.value for name, estimate in search.repaired.items()}
    active = [at_recorded_angle(problem, refit.run, _as_repaired(n.candidate, values)) for n in search.named]
    return fit_added(problem, refit, active, finished(jacobians=1))


def _as_repaired(candidate: Candidate, values: Mapping[str, float]) -> ActiveTerm:
    """A term of the search, its values as they were found in the end."""
    return ActiveTerm(candidate.term, {n: values.get(n, x) for n, x in candidate.values.items()}, candidate.onset)
