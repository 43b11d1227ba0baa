"""Campaigns with known answers: the units themselves, off inside tolerances, with terms on, noise and rounding."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cobot_joint.diagnosis.candidates.scan import Scan
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import difference
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem, Run, Vector
from cobot_joint.diagnosis.estimation.projection import solve
from cobot_joint.diagnosis.plant.plant import Plant, ScannedShape, Signals, TermCandidate

COLOURS = (0.0, 0.3, 0.5, 0.8)  # of the torque channel; the others are white
SIZES = (5.0, 1000.0)  # root of the chi-square that a re-fit leaves of an effect: drawn between, even in its logarithm
LATE = 0.2  # of the effects set in during the runs
LEAST = 0.03  # of the amplitude that a scan probes with: far below it, some terms are no longer what they are
FADE = 0.2  # s
TIMED = (0.05, 0.25)  # of a run, that an episode lasts


@dataclass(frozen=True)
class Concealed:
    """What a drawn campaign conceals."""

    active: ActiveTerm
    size: float  # root of the chi-square that a linear re-fit leaves of it

    def to_json(self) -> dict[str, Any]:
        """As `effects` of an answers.json, without the terms that are indistinguishable."""
        return {
            "name": self.active.term.name,
            "onset_s": self.active.onset or 0.0,
            "parameters": dict(self.active.values),
            "chi_after_refit": self.size,
        }


@dataclass(frozen=True)
class Drawn:
    """A campaign, its noise colour and its answer."""

    campaign: Campaign
    colour: float
    effects: tuple[Concealed, ...]
    base: Mapping[str, float]  # true values of the parameters that have a tolerance


@dataclass(frozen=True)
class Bench:
    """A machine and its experiments before anything is concealed. healthy: its true parameters as a fit."""

    campaign: Campaign
    colour: float
    noise: Mapping[str, Noise]
    problem: Problem
    healthy: Fit

    def recorded(self, outputs: Sequence[Signals], concealed: Sequence[Concealed], rng: np.random.Generator) -> Drawn:
        """With the logger's noise on these outputs, one per recording."""
        recordings = [_noisy(r, o, self.noise, rng) for r, o in zip(self.campaign.recordings, outputs, strict=True)]
        campaign, base = replace(self.campaign, recordings=recordings), self.healthy.run.values
        return Drawn(campaign, self.colour, tuple(concealed), base)


class Concealer:
    """Draws campaigns after the pattern of one, which lends set-ups, inputs, channels and tolerances.

    seconds: length of every run, a part of the pattern's; None: whole. sizes: as SIZES.
    """

    def __init__(
        self, pattern: Campaign, plant: Plant, seconds: float | None = None, sizes: tuple[float, float] = SIZES
    ) -> None:
        self.pattern = replace(pattern, recordings=pattern.train)
        self.seconds, self.sizes = seconds, sizes
        self.plant = plant
        self.bounds = {n: t.bounds(plant.parameters[n].nominal) for n, t in pattern.tolerances.items()}

    def draw(self, rng: np.random.Generator, effects: int) -> Drawn:
        """A campaign with so many effects, of different terms, over all recordings but one where there are three."""
        bench = self.bench(rng)
        concealed = self.conceal(bench, effects, self.sizes, rng)
        run = with_effects(bench.healthy.run, [c.active for c in concealed])
        return bench.recorded(bench.problem.outputs(run), concealed, rng)

    def bench(self, rng: np.random.Generator) -> Bench:
        """Inputs, noise and base parameters; nothing concealed yet."""
        recordings = [_varied(_part(r, self.seconds, rng), rng) for r in self.pattern.recordings]
        if len(recordings) > 2:
            recordings.pop(rng.integers(len(recordings)))
        campaign = replace(self.pattern, recordings=recordings)
        colour = float(rng.choice(COLOURS))
        noise = {name: _noise(campaign, name, colour) for name in campaign.outputs}
        problem = Problem(self.plant, campaign.recordings, noise)
        hypothesis = Hypothesis(tolerances(problem, self.bounds))
        x = np.clip(rng.normal(0, 0.5, len(hypothesis.coordinates)), -1, 1)
        base = problem.simulate([hypothesis.run(x)])[0]
        if base is None:
            raise RuntimeError("the system cannot be simulated at the parameters drawn")
        J = difference(problem, hypothesis, x, base)
        assert J is not None
        healthy = Fit(hypothesis, x, 0.0, problem.recorded - base.white, base, J, 0)
        return Bench(campaign, colour, noise, problem, healthy)

    def conceal(
        self, bench: Bench, effects: int, sizes: tuple[float, float], rng: np.random.Generator
    ) -> tuple[Concealed, ...]:
        """Effects of different terms. sizes: as SIZES."""
        concealed: list[Concealed] = []
        recordings = bench.campaign.recordings
        terms = [t for t in self.plant.terms if any(self.plant.has(t.name, r) for r in recordings)]
        while len(concealed) < effects:
            term = terms[rng.integers(len(terms))]
            if term.name.split(".")[1] not in {c.active.term.name.split(".")[1] for c in concealed}:
                concealed.append(self._effect(bench.problem, bench.healthy, term, sizes, rng))
        return tuple(concealed)

    def _effect(
        self,
        problem: Problem,
        healthy: Fit,
        term: TermCandidate,
        sizes: tuple[float, float],
        rng: np.random.Generator,
    ) -> Concealed:
        """A term at a drawn shape and onset, as large as the size drawn; less where it cannot be."""
        length = float(problem.times().max())
        values = {s.name: _shape(s, rng) for s in term.shapes}
        onset = float(rng.uniform(0.2, 0.7) * length) if rng.random() < LATE else None
        for name in values:
            if name.endswith(".t_0"):
                values[name], onset = float(rng.uniform(0.1, 0.7) * length), None
            elif name.endswith(".T_d"):
                values[name] = float(rng.uniform(*TIMED) * length)
        if term.phase:
            values[term.phase] = float(rng.uniform(0, 2 * np.pi))
        wanted = float(np.exp(rng.uniform(*np.log(sizes))))
        probed = Scan(problem, [term]).probes(healthy)[term.name]
        step = probed * (-1 if term.lower < 0 and rng.random() < 0.5 else 1)
        active = ActiveTerm(
            term, {**values, term.amplitude: float(np.clip(term.neutral + step, term.lower, term.upper))}, onset
        )
        for _ in range(4):  # in proportion, again where the response bends
            size = _size(problem, healthy, active)
            step = step * float(np.clip(wanted / max(size, 1e-3), 1e-3, 1e3))
            step = float(np.sign(step)) * max(abs(step), LEAST * probed)
            amplitude = float(np.clip(term.neutral + step, term.lower, term.upper))
            last, active = active, replace(active, values={**active.values, term.amplitude: amplitude})
            if abs(size / wanted - 1) < 0.2 or amplitude == last.values[term.amplitude]:
                break
        return Concealed(active, _size(problem, healthy, active))


def _size(problem: Problem, healthy: Fit, active: ActiveTerm) -> float:
    """Root of the chi-square that a linear re-fit leaves of the effect; 0 where it cannot be simulated."""
    found = problem.simulate([with_effects(healthy.run, [active]).beside(active.component)], healthy.simulated)[0]
    if found is None:
        return 0.0
    return size_after_refit(healthy, found.white - healthy.simulated.white)


def size_after_refit(healthy: Fit, effect: Vector) -> float:
    """Root of the chi-square that a linear re-fit of the base parameters leaves of a whitened difference, (rows,)."""
    gradient = healthy.jacobian.T @ effect
    taken = gradient @ solve(healthy.jacobian.T @ healthy.jacobian + np.diag(healthy.hypothesis.prior), gradient)
    return float(np.sqrt(max(float(effect @ effect - taken), 0.0)))


def with_effects(run: Run, active: Sequence[ActiveTerm]) -> Run:
    for a in active:
        run = a.apply(run, a.start())
    return run


def _shape(shape: ScannedShape, rng: np.random.Generator) -> float:
    """Anywhere in the scanned range, not on the scan's own grid."""
    low, high = min(shape.values), max(shape.values)
    if shape.whole:
        return float(rng.integers(int(low), int(high) + 1))
    return float(np.exp(rng.uniform(np.log(low), np.log(high)))) if shape.logarithmic else float(rng.uniform(low, high))


def _part(recording: Recording, seconds: float | None, rng: np.random.Generator) -> Recording:
    """A part of a run, anywhere in it: its inputs, faded in, since the bench starts at rest."""
    if seconds is None:
        return recording
    n = min(round(seconds / recording.step) + 1, len(recording.time))
    begin = int(rng.integers(len(recording.time) - n + 1))
    time = recording.time[:n]
    rise = np.minimum((time - time[0]) / FADE, 1.0)
    inputs = {name: rise * u[begin : begin + n] for name, u in recording.inputs.items()}
    return replace(recording, time=time, inputs=inputs, outputs={name: np.zeros(n) for name in recording.outputs})


def _varied(recording: Recording, rng: np.random.Generator) -> Recording:
    """Inputs scaled, so that no two campaigns are the same experiment."""
    inputs = {name: float(rng.uniform(0.8, 1.0)) * u for name, u in recording.inputs.items()}
    return replace(recording, inputs=inputs)


def _noise(campaign: Campaign, name: str, colour: float) -> Noise:
    """The logger's, with rounding; coloured is what is said to be: the torque."""
    logged = campaign.logged[name]
    step = logged.step or 0.0
    sigma = float(np.hypot(logged.noise or 1.0, step / np.sqrt(12)))
    return Noise(sigma, colour if logged.unit == "N.m" else 0.0, step)


def _noisy(recording: Recording, outputs: Signals, noise: Mapping[str, Noise], rng: np.random.Generator) -> Recording:
    return replace(recording, outputs={name: noise[name].on(outputs[name], rng) for name in recording.outputs})
