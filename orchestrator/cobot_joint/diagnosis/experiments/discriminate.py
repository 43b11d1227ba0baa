"""Which experiment would tell apart what these recordings cannot, predicted by simulating it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice, product

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import PRIOR
from cobot_joint.diagnosis.estimation.problem import Problem, Run, Vector
from cobot_joint.diagnosis.estimation.projection import solve
from cobot_joint.diagnosis.experiments.excitation import DURATION, experiments
from cobot_joint.diagnosis.findings import Advice, Finding
from cobot_joint.diagnosis.plant.plant import TermCandidate

SHAPES = 4  # of an alternative that are tried: its best one counts
RESOLUTION = 1e-3  # noise of a channel that is not there yet, over its range, as the bench's own channels have it


def advise(problem: Problem, findings: Sequence[Finding], fit: Fit) -> list[Advice]:
    """What would tell the findings' indistinguishable terms apart. fit: with the findings' terms on."""
    return list(dict.fromkeys(advice for finding in findings for advice in _apart(problem, finding, fit)))


def _apart(problem: Problem, finding: Finding, fit: Fit) -> Iterator[Advice]:
    """Terms of one name in two units share a shaft; others differ by what they depend on."""
    name = finding.term.split(".")[1]
    shared = tuple(t for t in (finding.term, *finding.equivalent) if t.split(".")[1] == name)
    if len(shared) > 1:
        yield Advice(shared, uncouple=shared[0].split(".")[0])
    active = next((a for a in fit.hypothesis.terms if a.name == finding.term), None)
    alternatives = [t for t in problem.plant.terms if t.name in finding.equivalent and t.name.split(".")[1] != name]
    if active is None or not alternatives:
        return
    bench = Bench(problem, fit, active)
    for alternative in alternatives:
        yield _advice(bench, alternative)


def _advice(bench: Bench, alternative: TermCandidate) -> Advice:
    """The best experiment with the logged channels; where none separates, with one channel more."""
    found = [(chi2, name, channel) for name, s in bench.separations(alternative).items() for channel, chi2 in s.items()]
    logged = max((each for each in found if not each[2]), key=lambda each: each[0])
    chi2, name, channel = logged if logged[0] >= thresholds.SEPARATES else max(found, key=lambda each: each[0])
    return Advice((bench.active.name, alternative.name), None, name, channel or None, DURATION, chi2)


@dataclass(frozen=True)
class Rows:
    """One experiment: the rows of its logged channels, whitened, and of every other output, over its noise."""

    logged: Vector
    more: Mapping[str, Vector]


class Bench:
    """The system with the fit's parameters and one term, in the size found, on experiments that it could do."""

    def __init__(self, problem: Problem, fit: Fit, active: ActiveTerm) -> None:
        self.problem = Problem(problem.plant, experiments(problem.recordings), problem.noise, problem.jobs)
        self.free, self.active = fit.hypothesis.base, active
        run = replace(fit.run, onsets={}, added={})
        self.without = replace(run, values={**run.values, active.term.amplitude: active.term.neutral})
        self.signals = sorted({s for port in problem.plant.ports for s in port.signals})
        self.there = self.problem.outputs(self.without, self.signals)
        self.range = {s: max(float(np.ptp(o[s])) for o in self.there if s in o) for s in self.signals}
        self.new = [s for s in self.signals if self.range[s] > 0 and not self._logged_already(s)]
        self.effect = self._differences(run, 1.0)
        self.base = [self._differences(moved, step) for moved, step in self._moved(self.without)]

    def separations(self, alternative: TermCandidate) -> dict[str, dict[str, float]]:
        """Experiment -> additional channel ("": none) -> chi-square that the re-fitted alternative leaves of it."""
        shapes = [
            [self._differences(r, step) for r, step in runs] for runs in self._alternatives(self.without, alternative)
        ]
        found: dict[str, dict[str, float]] = {}
        for n, recording in enumerate(self.problem.recordings):
            for channel in ("", *self.effect[n].more):
                effect = _rows(self.effect[n], channel)
                base = [_rows(b[n], channel) for b in self.base]
                left = [_left(effect, base, [_rows(c[n], channel) for c in columns]) for columns in shapes]
                found.setdefault(recording.name, {})[channel] = min(left)
        return found

    def _logged_already(self, signal: str) -> bool:
        """Whether some logged channel is in proportion to it, in every experiment."""
        own = [(o, r) for o, r in zip(self.there, self.problem.recordings, strict=True) if signal in o]
        return any(
            all(channel in r.outputs and _proportional(o[signal], o[channel]) for o, r in own)
            for channel in self.problem.noise
        )

    def _moved(self, run: Run) -> Iterator[tuple[Run, float]]:
        """Every re-fittable parameter by a step, of its tolerance, that stays inside: an efficiency of 1 goes down."""
        for f in self.free:
            value, half = run.values[f.parameter.name], (f.upper - f.lower) / 2
            step = self.problem.step if value + self.problem.step * half <= f.upper else -self.problem.step
            yield replace(run, values={**run.values, f.parameter.name: value + step * half}), step

    def _alternatives(self, run: Run, term: TermCandidate) -> Iterator[list[tuple[Run, float]]]:
        """Per shape: the term switched on a little, twice if it has a phase."""
        size = 0.01 * min(term.upper - term.neutral, 1.0)
        shapes = list(product(*(s.values for s in term.shapes)))
        for values in islice(shapes, 0, None, max(len(shapes) // SHAPES, 1)):
            on = {term.amplitude: term.neutral + size, **dict(zip([s.name for s in term.shapes], values, strict=True))}
            phases = [{term.phase: 0.0}, {term.phase: np.pi / 2}] if term.phase else [{}]
            yield [(replace(run, values={**run.values, **on, **phase}), size) for phase in phases]

    def _differences(self, run: Run, step: float) -> list[Rows]:
        """Per experiment, over the step."""
        found = self.problem.outputs(run, self.signals)
        white = (self.problem.whiten(found) - self.problem.whiten(self.there)) / step
        rows = []
        for n, outputs in enumerate(found):
            logged = np.concatenate([white[b.rows] for b in self.problem.blocks if b.recording == n])
            noise = {s: RESOLUTION * self.range[s] for s in self.new if s in outputs}
            more = {s: (outputs[s] - self.there[n][s]) / (step * sigma) for s, sigma in noise.items()}
            rows.append(Rows(logged, more))
        return rows


def _proportional(a: Vector, b: Vector) -> bool:
    return bool(abs(a @ b) >= 0.98 * np.linalg.norm(a) * np.linalg.norm(b))


def _rows(rows: Rows, channel: str) -> Vector:
    return np.concatenate([rows.logged, rows.more[channel]]) if channel else rows.logged


def _left(effect: Vector, base: Sequence[Vector], alternative: Sequence[Vector]) -> float:
    """Chi-square of the effect that neither base parameters inside their tolerances nor the alternative can mimic."""
    J = np.column_stack([*base, *alternative])
    weight = np.array([PRIOR] * len(base) + [0.0] * len(alternative))
    gradient = J.T @ effect
    return max(float(effect @ effect - gradient @ solve(J.T @ J + np.diag(weight), gradient)), 0.0)
