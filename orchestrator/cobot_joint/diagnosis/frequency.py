"""Frequency responses under diagnosis: each way to read the experiment is tried, the best one is the answer."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.data.campaign import read_campaign_file, system_connectors
from cobot_joint.diagnosis.data.campaign_file import Alternative, CampaignFile, FrequencyExperiment
from cobot_joint.diagnosis.data.check import check
from cobot_joint.diagnosis.data.parameters import with_values
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import Precision, difference, fit
from cobot_joint.diagnosis.estimation.problem import SMOOTH, Noise, Problem, Run
from cobot_joint.diagnosis.findings import Candidate, Diagnosis, Estimate, Finding
from cobot_joint.diagnosis.localization.conditions import Condition
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.frequency_plant import CHANNEL, FrequencyPlant, by_frequency, quick
from cobot_joint.diagnosis.plant.plant import Parameter, TermCandidate
from cobot_joint.diagnosis.selection.confidence import confidence
from cobot_joint.diagnosis.store import Store
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import System, Value
from cobot_joint.system.read import find_system, load_system

BAND = 0.8  # of what a finding takes, that its band holds
DEGREE = 7  # degree of the polynomial in ln omega from which the data's own scatter is told
FITTED = 2  # leaders of the score that are fitted
SEEN = (0.5, 50.0)  # whitened length that a probe of a term should have: seen, and not far from linear
CALIBRATION = Precision(steps=4)  # on all frequencies, after a fit on those that cost little
FINISHED = Precision(settled=0.1, steps=12)  # a term and what it stands in for leave a narrow valley
WITHIN_REACH = 4.0  # times the lowest chi-square, up to which a reading is fitted to its end: twice its rms
ROUNDS, GAINED = 8, 0.5  # of such fits at most, and chi-square that one has to gain; two that do not are the end
Vector = NDArray[np.float64]
Progress = Callable[[str], None]


def read_amplitudes(path: Path) -> tuple[Vector, Vector]:
    """Two columns with headers: (frequencies rad/s, amplitudes). UserError: it is not that."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [[float(cell) for cell in row] for row in list(csv.reader(file))[1:] if row]
        omega, amplitude = np.array(rows, dtype=np.float64).T
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: a table of frequency and amplitude is needed: {error}") from error
    if not (np.all(omega > 0) and np.all(amplitude > 0)):
        raise UserError(f"{path}: frequencies and amplitudes have to be positive")
    return omega, amplitude


def scatter(omega: Vector, amplitude: Vector) -> float:
    """The data's own noise: rms of ln amplitude about a smooth curve, for the degrees of freedom that are left."""
    x, y = np.log(omega), np.log(amplitude)
    rest = y - np.polyval(np.polyfit(x, y, DEGREE), x)
    return float(np.sqrt(rest @ rest / (len(y) - DEGREE - 1)))


@dataclass(frozen=True)
class Reading:
    """One way to read the experiment's description, and what was found under it."""

    alternative: Alternative
    nominal: float  # rms of ln(simulated/measured)
    calibrated: Fit
    repaired: Fit
    ranking: list[Candidate]
    equivalent: tuple[str, ...]


def rms_log(problem: Problem, outcome: Fit | Run) -> float:
    """rms of ln(simulated/measured)"""
    run = outcome.run if isinstance(outcome, Fit) else outcome
    misfit = [
        simulated[CHANNEL] - recording.outputs[CHANNEL]
        for simulated, recording in zip(problem.outputs(run), problem.recordings, strict=True)
    ]
    return float(np.sqrt(np.mean(np.square(misfit))))


def is_response(path: Path) -> bool:
    """Whether the campaign is about a frequency response. UserError: it is no campaign."""
    return read_campaign_file(path / "campaign.toml" if path.is_dir() else path).frequency_response is not None


@dataclass(frozen=True)
class Response:
    """A frequency-response campaign, read."""

    path: Path
    given: CampaignFile
    experiment: FrequencyExperiment
    system: System
    recording: Recording
    noise: float
    crashes: list[str] = field(default_factory=list)  # of units, in what was simulated so far


def load_response(path: Path) -> Response:
    """UserError: what is wrong with the campaign, its system or its table."""
    path = path / "campaign.toml" if path.is_dir() else path
    given = read_campaign_file(path)
    assert given.frequency_response is not None
    if len(given.recording) != 1:
        raise UserError(f"{path}: {len(given.recording)} [[recording]] are given, one table is allowed")
    file = path.parent / given.system if given.system.endswith((".ssd", ".ssp")) else given.system
    system = with_values({"default": load_system(file)}, given.parameters, f"{path}: [parameters]")["default"]
    check(str(path), given, {"default": system}, {"default": system_connectors(find_system(file))})
    system = _read_as(system, given.frequency_response.parameters, f"{path}: frequency_response")
    for alternative in given.alternative:
        _read_as(system, alternative.parameters, f"{path}: alternative {alternative.name!r}")
    experiment = given.frequency_response
    for key, name, ends in (("input", experiment.input, system.inputs), ("output", experiment.output, system.outputs)):
        if name not in ends:
            raise UserError(f"{path}: frequency_response.{key}: {name!r} is given, {among(ends)} is allowed")
    table = path.parent / given.recording[0].patterns[0]
    omega, amplitude = read_amplitudes(table)
    recording = Recording(
        table.stem, "train", "default", omega, {}, {CHANNEL: np.log(amplitude)}, {CHANNEL: "1"}, path=table
    )
    return Response(path, given, given.frequency_response, system, recording, scatter(omega, amplitude))


def _read_as(system: System, values: Mapping[str, Value | str], where: str) -> System:
    """The system under one reading of the experiment."""
    return with_values({"default": system}, values, where)["default"]


def diagnose_response(
    response: Response, store: Store, progress: Progress | None = None
) -> tuple[Diagnosis, list[Reading]]:
    """The best reading's diagnosis, and every reading.

    Terms are ranked under the reading that the base model fits best; the leaders are fitted under all of them.
    """
    say = progress or (lambda words: None)
    given = response.given.alternative or [Alternative(name="as described")]
    say(f"re-fitting the base model under {len(given)} readings")
    bases = [store.remember("calibrated", a.model_dump(), partial(_calibrate, response, a)) for a in given]
    lead = min(range(len(given)), key=lambda k: bases[k][1].chi2)
    say(f"ranking every term: {given[lead].name}")
    ranking = store.remember("ranking", given[lead].model_dump(), partial(_rank, response, given[lead], bases[lead][1]))
    only = response.given.terms
    worth = [c for c in ranking if c.gain > 2 * np.log(len(ranking)) and (not only or c.term in only)]
    leaders = worth[:FITTED]  # of a shaft's twins, the one that the campaign allows
    fitted = []
    for alternative, (_, base) in zip(given, bases, strict=True):
        key = (alternative.model_dump(), [candidate.term for candidate in leaders])
        say(f"fitting {' and '.join(key[1])}: {alternative.name}")
        fitted.append(store.remember("named", key, partial(_fits, response, alternative, base, leaders)))
    near = WITHIN_REACH * min((f.chi2 for fits in fitted for f in fits.values()), default=0.0)
    readings = []
    for alternative, (nominal, base), fits in zip(given, bases, fitted, strict=True):
        if any(f.chi2 < near for f in fits.values()):
            say(f"fitting to the end: {alternative.name}")
            key = (alternative.model_dump(), [candidate.term for candidate in leaders])
            fits = store.remember("finished", key, partial(_finished, response, alternative, fits))
        allowed = {name: f for name, f in fits.items() if not response.given.terms or name in response.given.terms}
        repaired, equivalent = choose(base, allowed, len(ranking))
        readings.append(Reading(alternative, nominal, base, repaired, ranking, equivalent))
    best = min(readings, key=lambda r: r.repaired.chi2)
    diagnosis = _diagnosis(response, best, readings)
    diagnosis.crashes = list(dict.fromkeys(response.crashes))
    return diagnosis, readings


@contextmanager
def _problems(response: Response, alternative: Alternative) -> Iterator[tuple[Problem, Problem]]:
    """All frequencies, and those that cost little."""
    system = _read_as(response.system, alternative.parameters, f"{response.path}: {alternative.name}")
    noise = {CHANNEL: Noise(response.noise)}
    with FrequencyPlant(system, response.experiment, response.recording.time) as plant:
        every = by_frequency(response.recording)
        few = quick(every, response.experiment.settle)
        yield Problem(plant, every, noise, step=SMOOTH), Problem(plant, few, noise, step=SMOOTH)
        response.crashes.extend(str(crash) for crash in plant.plant.crashes.values())


def _calibrate(response: Response, alternative: Alternative) -> tuple[float, Fit]:
    """rms of ln(simulated/measured) as specified, and the base model re-fitted inside its tolerances."""
    with _problems(response, alternative) as (problem, fast):
        nominal = rms_log(problem, Run({}))
        parameters = problem.plant.parameters
        bounds = {n: t.bounds(parameters[n].nominal) for n, t in response.given.tolerances.items() if n in parameters}
        hypothesis = Hypothesis(tolerances(problem, bounds))
        rough = fit(fast, hypothesis)
        found = fit(problem, hypothesis, rough.x if rough else None, precision=CALIBRATION)
        if found is None:
            raise UserError(
                f"{response.path}: {alternative.name}: no amplitude comes out in the middle of the tolerances"
            )
        return nominal, found


def _rank(response: Response, alternative: Alternative, base: Fit) -> list[Candidate]:
    with _problems(response, alternative) as (_, fast):
        return rank(fast, base, fast.plant.terms)


def _fits(response: Response, alternative: Alternative, base: Fit, leaders: Sequence[Candidate]) -> dict[str, Fit]:
    """The leaders, each fitted with everything else."""
    fits = {}
    with _problems(response, alternative) as (problem, fast):
        for candidate in leaders:
            term = next(t for t in problem.plant.terms if t.name == candidate.term)
            start = {**candidate.shape, term.amplitude: term.neutral + 0.1 * min(term.upper - term.neutral, 10.0)}
            rough = fit(fast, base.hypothesis.with_effects(ActiveTerm(term, start)))
            if rough is None:
                continue
            found = fit(problem, rough.settled().hypothesis, rough.settled().x, precision=FINISHED)
            if found is not None:
                fits[term.name] = found
    return fits


def _finished(response: Response, alternative: Alternative, fits: Mapping[str, Fit]) -> dict[str, Fit]:
    with _problems(response, alternative) as (problem, _):
        return {name: _to_the_end(problem, found) for name, found in fits.items()}


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


def choose(base: Fit, fits: Mapping[str, Fit], looked: int) -> tuple[Fit, tuple[str, ...]]:
    """The best fit where it takes away more than having looked at so many terms would, and what does as well.

    Gains count in units of what is left per degree of freedom, as in an F test: far from noise, a little is nothing.
    """
    needed = 2 * np.log(looked) + thresholds.LOOK_ELSEWHERE

    def gain(found: Fit) -> float:
        return (base.chi2 - found.chi2) / max(1.0, found.chi2 / (len(found.residual) - len(found.x)))

    good = sorted((name for name in fits if gain(fits[name]) > needed), key=lambda name: fits[name].chi2)
    if not good:
        return base, ()
    best = fits[good[0]]
    return best, tuple(name for name in good[1:] if fits[name].chi2 - best.chi2 < thresholds.INDISTINGUISHABLE)


def rank(problem: Problem, base: Fit, terms: Sequence[TermCandidate]) -> list[Candidate]:
    """Every switched-off term by the chi-square that its trace, base parameters projected out, would take away."""
    at = problem.simulate([base.run])[0]
    traces = difference(problem, base.hypothesis, base.x, at) if at is not None else None
    if at is None or traces is None:
        return []
    residual = problem.recorded - at.white
    basis = np.linalg.svd(traces[:, : len(base.hypothesis.base)], full_matrices=False)[0]
    found = []
    for term in terms:
        best = Candidate(term.name, 0.0, {}, None)
        size = 1e-3 * (term.upper - term.neutral if np.isfinite(term.upper) else 1.0)
        for values in _points(term):
            trace, size = probe(problem, base, term, values, at.white, size)
            if trace is None:
                continue
            trace = trace - basis @ (basis.T @ trace)
            length, along = float(trace @ trace), float(trace @ residual)
            if length > 1e-6 and (along > 0 or term.lower < term.neutral):
                gain = along**2 / length
                if gain > best.gain:
                    best = Candidate(term.name, gain, values, None)
        found.append(best)
    return sorted(found, key=lambda c: -c.gain)


def _points(term: TermCandidate) -> list[dict[str, float]]:
    """Shape parameters to try; of ripples, which amplitudes average out, the first two orders and one phase."""
    grids = [(s.name, s.values[:2] if s.whole else s.values) for s in term.shapes]
    if term.phase:
        grids.append((term.phase, (0.0,)))
    return [dict(zip([g[0] for g in grids], point, strict=True)) for point in product(*[g[1] for g in grids])]


def probe(
    problem: Problem, base: Fit, term: TermCandidate, shape: Mapping[str, float], at: Vector, size: float
) -> tuple[Vector | None, float]:
    """What a small amplitude of the term adds to the whitened outputs `at`, (rows,), and that amplitude.

    `size`: the one to try first. None: nothing to be seen.
    """
    for _ in range(8):
        if term.neutral + size > term.upper:
            break
        values = {**base.run.values, **shape, term.amplitude: term.neutral + size}
        simulated = problem.simulate([Run(values)])[0]
        if simulated is None:  # too much of it: nothing moves any more
            size *= 0.03
            continue
        trace = simulated.white - at
        length = float(np.linalg.norm(trace))
        if SEEN[0] <= length <= SEEN[1]:
            return trace, size
        if length < 1e-9:
            break
        size *= min(max(5.0 / length, 1e-3), 100.0)
    return None, size


def _diagnosis(response: Response, best: Reading, readings: Sequence[Reading]) -> Diagnosis:
    found = best.repaired
    units = {name: p.unit for name, p in _parameters(response).items()}
    estimates = found.estimates(units)
    findings = []
    dof = len(response.recording.time) - len(found.x)
    where, left = _where(response, best), max(found.chi2 - dof, 0.0)

    def finding(term: str, alike: tuple[str, ...], parameters: dict[str, Estimate], gain: float) -> Finding:
        sure = confidence(gain, left)
        return Finding(term, alike, sure, None, parameters, where, gain, ground="frequency response")

    for active in found.hypothesis.terms:
        names = [active.term.amplitude, *(s.name for s in active.term.shapes)]
        parameters = {n.split(".", 1)[1]: estimates[n] for n in names}
        gain = best.calibrated.chi2 - found.chi2
        findings.append(finding(active.name, best.equivalent, parameters, gain))
    if best.alternative.term:
        others = [r.repaired.chi2 for r in readings if r.alternative.term != best.alternative.term]
        gain = max(min(others) - found.chi2, 0.0) if others else 0.0
        findings.append(finding(best.alternative.term, (), {}, gain))
    explained = found.chi2 < dof + thresholds.LEFT_SIGMA * np.sqrt(2 * dof)
    return Diagnosis(
        ("explained" if findings else "nothing_missing") if explained else "undecided",
        findings,
        best.calibrated.estimates(units),
        estimates,
        ranking=[best.ranking],
    )


def _parameters(response: Response) -> Mapping[str, Parameter]:
    with FmuPlant({"default": response.system}) as plant:
        return plant.parameters


def _where(response: Response, best: Reading) -> dict[str, object]:
    """The band in which the finding takes most of the misfit away."""
    gained = best.calibrated.residual**2 - best.repaired.residual**2
    share = np.maximum(gained, 0.0)
    order = np.argsort(-share)
    most = order[: int(np.searchsorted(np.cumsum(share[order]), BAND * share.sum())) + 1]
    omega = response.recording.time[most]
    part = float(share[most].sum() / max(share.sum(), 1e-300))
    band = Condition("omega", "in a band", part, len(most) / len(share), float(omega.min()), float(omega.max()))
    return {"recording": response.recording.name, "channel": CHANNEL, "by_regime": [band.to_json()]}
