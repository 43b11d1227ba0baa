"""Frequency responses under diagnosis: amplitudes over frequency, each from a simulated time series, as measured."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.campaign import Alternative, CampaignFile, FrequencyExperiment, read_campaign_file
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.fit import Active, Fit, Hypothesis, difference, fit, tolerances
from cobot_joint.diagnosis.estimation.problem import SMOOTH, Noise, Problem, Run
from cobot_joint.diagnosis.findings import Candidate, Diagnosis, Finding
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import Parameter, Port, Signals, SimulationError, TermCandidate
from cobot_joint.diagnosis.store import Store
from cobot_joint.errors import UserError
from cobot_joint.system.model import System
from cobot_joint.system.parameters import with_parameters
from cobot_joint.system.read import load_system

CHANNEL = "ln amplitude"
ROWS = 400  # recorded per period, about
TICK = 5e-4  # s, of which rows are multiples
DEGREE = 7  # degree of the polynomial in ln omega from which the data's own scatter is told
SEEN = (0.5, 50.0)  # whitened length that a probe of a term should have: seen, and not far from linear
FITTED = 2  # leaders of the score that are fitted
PERIODS = 4.0  # settling times: longer periods are left out of the ranking
POLISH = 4, 8  # steps of a fit on all frequencies after one on those that cost little: base model, and with a term
SETTLED = 0.1  # chi-square not worth another step: a term and what it stands in for leave a narrow valley
ALIKE = 4.0  # chi-square by which a term may fit worse and still not be told apart
SURE = 10.0  # chi-square beyond what looking at so many terms brings by chance
Vector = NDArray[np.float64]
Progress = Callable[[str], None]


class FrequencyPlant:
    """A system seen through amplitudes: one recording per frequency, which is its only time. A context manager."""

    def __init__(self, system: System, experiment: FrequencyExperiment, omega: Vector) -> None:
        self.plant = FmuPlant({"default": system})
        self.parameters: Mapping[str, Parameter] = self.plant.parameters
        self.terms: Sequence[TermCandidate] = self.plant.terms
        self.ports: Sequence[Port] = ()
        self.inputs: Sequence[Port] = ()
        self.runs = {float(w): _run(experiment, float(w)) for w in omega}
        self.settle, self.output = experiment.settle, experiment.output

    def __enter__(self) -> FrequencyPlant:
        return self

    def __exit__(self, *error: Any) -> None:
        self.plant.__exit__(*error)

    def has(self, name: str, recording: Recording) -> bool:
        """See Plant.has."""
        return self.plant.has(name, next(iter(self.runs.values())))

    def simulate(
        self,
        values: Mapping[str, float],
        recording: Recording,
        *,
        onsets: Mapping[str, float] | None = None,
        added: Mapping[str, Vector] | None = None,
        signals: Sequence[str] = (),
    ) -> Signals:
        """{CHANNEL: (1,)}, ln of half the swing at the recording's frequency. SimulationError: it fails, or rests."""
        omega = float(recording.time[0])
        run = self.runs[omega]
        w = self.plant.simulate(values, run)[self.output]
        swing = np.ptp(w[run.time >= self.settle - 1e-9]) / 2
        if not swing > 0:
            raise SimulationError(f"{self.output}: no amplitude at {omega:g} rad/s")
        return {CHANNEL: np.array([np.log(swing)])}


def by_frequency(table: Recording) -> list[Recording]:
    """One recording per row of a table (n,), so that frequencies are simulated beside each other."""
    logs = table.outputs[CHANNEL]
    return [
        replace(table, name=f"{w:g} rad/s", time=table.time[k : k + 1], outputs={CHANNEL: logs[k : k + 1]})
        for k, w in enumerate(table.time)
    ]


def quick(recordings: Sequence[Recording], settle: float) -> list[Recording]:
    """The frequencies whose period is no longer than a few settling times: a ranking needs no more."""
    few = [r for r in recordings if r.time[0] >= 2 * np.pi / (PERIODS * settle)]
    return few if len(few) >= len(recordings) // 2 else list(recordings)


def _run(experiment: FrequencyExperiment, omega: float) -> Recording:
    """From rest through `settle` and one whole period, on whole steps of TICK."""
    period = 2 * np.pi / omega
    step = TICK * max(1, round(period / ROWS / TICK))
    time: Vector = np.arange(int(np.ceil((experiment.settle + period) / step)) + 1, dtype=np.float64) * step
    inputs = {experiment.input: experiment.amplitude * np.sin(omega * time)}
    nothing = {experiment.output: np.full(len(time), np.nan)}
    return Recording(f"{omega:g} rad/s", "train", "default", time, inputs, nothing, {})


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


def load_response(path: Path) -> Response:
    """UserError: what is wrong with the campaign, its system or its table."""
    path = path / "campaign.toml" if path.is_dir() else path
    given = read_campaign_file(path)
    assert given.frequency_response is not None
    if len(given.recording) != 1:
        raise UserError(f"{path}: {len(given.recording)} [[recording]] are given, one table is allowed")
    file = path.parent / given.system if given.system.endswith((".ssd", ".ssp")) else given.system
    system = with_parameters(load_system(file), given.frequency_response.parameters, f"{path}: frequency_response")
    table = path.parent / given.recording[0].patterns[0]
    omega, amplitude = read_amplitudes(table)
    recording = Recording(
        table.stem, "train", "default", omega, {}, {CHANNEL: np.log(amplitude)}, {CHANNEL: "1"}, path=table
    )
    return Response(path, given, given.frequency_response, system, recording, scatter(omega, amplitude))


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
    readings = []
    for alternative, (nominal, base) in zip(given, bases, strict=True):
        key = (alternative.model_dump(), [candidate.term for candidate in leaders])
        say(f"fitting {' and '.join(key[1])}: {alternative.name}")
        fits = store.remember("named", key, partial(_fits, response, alternative, base, leaders))
        allowed = {name: f for name, f in fits.items() if not response.given.terms or name in response.given.terms}
        repaired, equivalent = choose(base, allowed, len(ranking))
        readings.append(Reading(alternative, nominal, base, repaired, ranking, equivalent))
    best = min(readings, key=lambda r: r.repaired.chi2)
    return _diagnosis(response, best, readings), readings


@contextmanager
def _problems(response: Response, alternative: Alternative) -> Iterator[tuple[Problem, Problem]]:
    """All frequencies, and those that cost little."""
    system = with_parameters(response.system, alternative.parameters, f"{response.path}: {alternative.name}")
    noise = {CHANNEL: Noise(response.noise)}
    with FrequencyPlant(system, response.experiment, response.recording.time) as plant:
        every = by_frequency(response.recording)
        few = quick(every, response.experiment.settle)
        yield Problem(plant, every, noise, step=SMOOTH), Problem(plant, few, noise, step=SMOOTH)


def _calibrate(response: Response, alternative: Alternative) -> tuple[float, Fit]:
    """rms of ln(simulated/measured) as specified, and the base model re-fitted inside its tolerances."""
    with _problems(response, alternative) as (problem, fast):
        nominal = rms_log(problem, Run({}))
        parameters = problem.plant.parameters
        bounds = {n: t.bounds(parameters[n].nominal) for n, t in response.given.tolerances.items() if n in parameters}
        hypothesis = Hypothesis(tolerances(problem, bounds))
        rough = fit(fast, hypothesis)
        found = fit(problem, hypothesis, rough.x if rough else None, most=POLISH[0])
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
            rough = fit(fast, replace(base.hypothesis, active=(Active(term, start),)))
            if rough is None:
                continue
            found = fit(problem, rough.settled(), _base_start(rough), settled=SETTLED, most=POLISH[1])
            if found is not None:
                fits[term.name] = found
    return fits


def choose(base: Fit, fits: Mapping[str, Fit], looked: int) -> tuple[Fit, tuple[str, ...]]:
    """The best fit where it takes away more than having looked at so many terms would, and what does as well.

    Gains count in units of what is left per degree of freedom, as in an F test: far from noise, a little is nothing.
    """
    needed = 2 * np.log(looked) + SURE

    def gain(found: Fit) -> float:
        return (base.chi2 - found.chi2) / max(1.0, found.chi2 / (len(found.residual) - len(found.x)))

    good = sorted((name for name in fits if gain(fits[name]) > needed), key=lambda name: fits[name].chi2)
    if not good:
        return base, ()
    best = fits[good[0]]
    return best, tuple(name for name in good[1:] if fits[name].chi2 - best.chi2 < ALIKE)


def _base_start(rough: Fit) -> Vector:
    """The start of a settled hypothesis, base parameters where the rough fit left them."""
    x = rough.settled().start()
    base = len(rough.hypothesis.free)
    x[:base] = rough.x[:base]
    return x


def rank(problem: Problem, base: Fit, terms: Sequence[TermCandidate]) -> list[Candidate]:
    """Every switched-off term by the chi-square that its trace, base parameters projected out, would take away."""
    at = problem.simulate([base.run])[0]
    traces = difference(problem, base.hypothesis, base.x, at) if at is not None else None
    if at is None or traces is None:
        return []
    residual = problem.recorded - at.white
    basis = np.linalg.svd(traces[:, : len(base.hypothesis.free)], full_matrices=False)[0]
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
    where = {"recording": response.recording.name, "regime": _where(response, best)}
    for active in found.hypothesis.active:
        names = [active.term.amplitude, *(s.name for s in active.term.shapes)]
        parameters = {n.split(".", 1)[1]: estimates[n] for n in names}
        gain = best.calibrated.chi2 - found.chi2
        findings.append(Finding(active.term.name, best.equivalent, _sure(gain), None, parameters, where, gain))
    if best.alternative.term:
        others = [r.repaired.chi2 for r in readings if r.alternative.term != best.alternative.term]
        gain = min(others) - found.chi2 if others else 0.0
        words = f"the reading that fits best: {best.alternative.name}"
        findings.append(Finding(best.alternative.term, (), _sure(gain), None, {}, where, gain, words=words))
    explained = found.chi2 < dof + 3 * np.sqrt(2 * dof)
    verdict: Any = ("explained" if findings else "nothing_missing") if explained else "undecided"
    ranking = [best.ranking]
    return Diagnosis(verdict, findings, best.calibrated.estimates(units), estimates, ranking=ranking)


def _sure(gain: float) -> float:
    """Confidence from the difference in chi-square to what does without."""
    return float(1 - np.exp(-max(gain, 0.0) / 2))


def _parameters(response: Response) -> Mapping[str, Parameter]:
    with FmuPlant({"default": response.system}) as plant:
        return plant.parameters


def _where(response: Response, best: Reading) -> str:
    """The band in which the finding takes most of the misfit away."""
    gained = best.calibrated.residual**2 - best.repaired.residual**2
    share = np.maximum(gained, 0.0)
    order = np.argsort(-share)
    most = order[: int(np.searchsorted(np.cumsum(share[order]), 0.8 * share.sum())) + 1]
    omega, fastest = response.recording.time[most], np.exp(response.recording.outputs[CHANNEL][most].max())
    return f"{omega.min():g} to {omega.max():g} rad/s, amplitudes up to {fastest:.0f}"
