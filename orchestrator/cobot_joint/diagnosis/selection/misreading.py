"""Before physics is asked: a channel whose log has another gain or offset than it says.

A shunt's value, a sensor's sensitivity, a zero: it costs hardly a run to look for, and physics that imitates it would
be named with confidence. What a listed term does as well is left to the term.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.candidates.scan import Scan
from cobot_joint.diagnosis.candidates.score_test import scores
from cobot_joint.diagnosis.data.recording import LARGEST
from cobot_joint.diagnosis.estimation.channels import Reading, Stamps
from cobot_joint.diagnosis.estimation.fit import AT_BOUND, Fit
from cobot_joint.diagnosis.estimation.least_squares import Precision, bounded_step, fit, fit_on
from cobot_joint.diagnosis.estimation.port_response import same_direction
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.findings import Estimate, Misreading

TRIED = 2  # channels that are fitted
PROBE = 0.2  # of a natural step, by which an input's reading is moved for a difference quotient
ROUGH = Precision(settled=20.0, roughly=0.01, steps=12, jacobians=2)  # of a fit that has to show promise
FINISHED = Precision(settled=10.0, steps=30, jacobians=4)  # of one that counts: gain and base parameters go together


@dataclass(frozen=True)
class Suspect:
    """A channel. own: columns of its gain and offset at the calibrated base model, (rows, 2). predicted: chi-square
    that these take there; reading: as they do."""

    reading: Reading
    own: Vector
    predicted: float


@dataclass
class Misread:
    """The base model re-fitted beside a channel's gain and offset, or its stamps.

    predicted: chi-square that these were to take. own: their columns at the calibrated base model, (rows, 2). taken:
    share of the excess that they take. alike: a channel with which as little is left.
    """

    fit: Fit
    predicted: float
    own: Vector
    taken: float
    alike: str = ""

    @property
    def reading(self) -> Reading | Stamps:
        """As it was fitted."""
        effect = self.fit.hypothesis.effects[-1]
        assert isinstance(effect, Reading | Stamps)
        return effect.at(self.fit.x[-2:])

    @property
    def channel(self) -> str:
        """Whose log it is."""
        return self.reading.channel

    def explains(self, problem: Problem) -> bool:
        """Whether nothing is left."""
        return not problem.unexplained(self.fit.residual)

    def rivalled(self, problem: Problem, calibrated: Fit, scan: Scan) -> bool:
        """Whether a listed term is predicted to do as well, or is the same under another name.

        None is a delay that grows: what they are predicted to take of one is beyond what is linear.
        """
        if isinstance(self.reading, Stamps) and any(self.reading.drifts(r.time) for r in problem.recordings):
            return False
        columns = scan.columns(calibrated)
        twins = (c.vectors[0] for c in columns if len(c.vectors) == 1)
        if any(same_direction(self.own @ self.fit.x[-2:], vector, thresholds.COLLINEAR) for vector in twins):
            return True
        return any(score.gain > thresholds.CLOSE * self.predicted for score in scores(problem, calibrated, columns))

    def beats(self, problem: Problem, other: Fit) -> bool:
        """Whether it leaves so much less that the other is an imitation."""
        left, others = (max(problem.excess(f.residual), problem.excess_scatter) for f in (self.fit, other))
        return others > thresholds.TIMES_LESS * left and other.cost - self.fit.cost > problem.evidence

    def as_good(self, problem: Problem, calibrated: Fit, gain: float) -> bool:
        """Whether what takes so much of the cost of the calibrated model cannot be told from it."""
        return calibrated.cost - self.fit.cost > gain - self.slack(problem)

    def slack(self, problem: Problem) -> float:
        """Cost by which something else may be worse, or this, and still not be told from it."""
        return thresholds.ALIKE + thresholds.ALIKE_SHARE * max(problem.excess(self.fit.residual), 0.0)

    def told(self, problem: Problem) -> Misreading:
        """As a diagnosis says it."""
        reading, k = self.reading, len(self.fit.x) - 2
        stretches = problem.stretches(self.fit.residual)
        (low, high), shift = self.fit.interval(k, stretches), self.fit.interval(k + 1, stretches)
        r = next(r for r in problem.recordings if reading.channel in (*r.inputs, *r.outputs))
        column, unit = r.columns.get(reading.channel, reading.channel), r.units.get(reading.channel, "1")
        if isinstance(reading, Stamps):
            return Misreading(
                reading.channel,
                column,
                Estimate(1.0, "1", (1.0, 1.0)),
                Estimate(0.0, unit, (0.0, 0.0)),
                min(self.taken, 1.0),
                self.alike,
                Estimate(reading.late, "s", (low, high)),
                Estimate(reading.rate, "s/s", shift),
            )
        if reading.drives:  # fitted as what undoes it
            scale = 1 / reading.gain
            (low, high), shift = inverse(low, high), (-shift[1] / scale, -shift[0] / scale)
        return Misreading(
            reading.channel,
            column,
            Estimate(reading.gain, "1", (low, high)),
            Estimate(reading.offset, unit, shift),
            min(self.taken, 1.0),
            self.alike,
        )


def look_for_misreading(problem: Problem, calibrated: Fit) -> Misread | None:
    """None: the base model explains the recordings, or no channel's gain and offset take nearly all of what it leaves:
    of all channels, or of its own, where that is most of it.

    Channels whose scale somebody gave are believed.
    """
    if problem.is_table or not problem.unexplained(calibrated.residual):
        return None
    above, before = problem.above(calibrated.residual), max(problem.excess(calibrated.residual), 1e-9)
    channels = suspects(problem, calibrated)
    fitted: list[Misread] = []
    for suspect in channels[:TRIED]:
        abreast = thresholds.ABREAST * channels[0].predicted if fitted and fitted[0].explains(problem) else 0.0
        if suspect.predicted < max(thresholds.WORTH_FITTING * above, problem.evidence, abreast):
            break
        found = _fitted(problem, calibrated, suspect)
        if found is None or not spares_others(problem, calibrated, found, suspect.reading.channel):
            continue
        if _ends_at_a_limit(found):  # it flattens what the model gets wrong: a pendulum without drag went over the top
            continue
        taken = 1 - problem.excess(found.residual) / before
        own = 1 - _own_excess(problem, found, suspect) / max(_own_excess(problem, calibrated, suspect), 1e-9)
        if taken > thresholds.ENOUGH or (own > thresholds.ENOUGH and taken > thresholds.ALONE):
            fitted.append(Misread(found, suspect.predicted, suspect.own, taken))
    if not fitted:
        return None
    best, *others = sorted(fitted, key=lambda m: m.fit.cost)
    alike = [m.channel for m in others if m.fit.cost - best.fit.cost < thresholds.ALIKE]
    return replace(best, alike=alike[0]) if alike else best


def _own_excess(problem: Problem, found: Fit, suspect: Suspect) -> float:
    """Of what is slow in a residual, the part in the suspect's channel."""
    by_block = zip(problem.blocks, problem.excess_by_block(found.residual), strict=True)
    return sum(float(part.sum()) for block, part in by_block if block.channel == suspect.reading.channel)


def _ends_at_a_limit(found: Fit) -> bool:
    """Whether the gain is as small, or as large, as it may be: that is no log's."""
    c, x = found.hypothesis.coordinates[-2], found.x[-2]
    return not c.lower + AT_BOUND < x < c.upper - AT_BOUND


def spares_others(problem: Problem, before: Fit, after: Fit, channel: str) -> bool:
    """Whether no more is left of the other channels than before. A channel that is misread had bent the fit to them;
    where freeing it costs them, it is sound, and something else is wrong."""
    other = [block.channel != channel for block in problem.blocks]
    left, was = (
        sum(
            float(part.sum()) for part, counts in zip(problem.excess_by_block(f.residual), other, strict=True) if counts
        )
        for f in (after, before)
    )
    return left < was + thresholds.LEFT_SIGMA * problem.excess_scatter


def suspects(problem: Problem, calibrated: Fit) -> list[Suspect]:
    """Channels by what their gain and offset are predicted to take, most first; without those that are believed."""
    found = []
    for reading in _readings(problem):
        own = _columns(problem, calibrated, reading)
        if own is not None:
            predicted, x = predicted_of(calibrated, reading, own)
            found.append(Suspect(reading.at(x), own, predicted))
    return sorted(found, key=lambda suspect: -suspect.predicted)


def _readings(problem: Problem) -> Iterator[Reading]:
    """Of every channel that moves, unless it is believed."""
    reaches: dict[str, float] = {}
    for r in problem.recordings:
        for name, x in (r.inputs | r.outputs).items():
            if name not in r.believed:
                reaches[name] = max(reaches.get(name, 0.0), float(np.nanmax(np.abs(x), initial=0.0)))
    outputs = {name for r in problem.recordings for name in r.outputs}
    return (Reading(name, reach, name not in outputs) for name, reach in reaches.items() if reach > 0)


def _columns(problem: Problem, at: Fit, reading: Reading) -> Vector | None:
    """d(simulated)/d(its coordinates), (rows, 2): of an output as it stands, of an input by runs. None: one failed."""
    if reading.drives:
        found = problem.simulate([reading.apply(at.run, PROBE * unit) for unit in np.eye(2)])
        responses = [(f.white - at.simulated.white) / PROBE for f in found if f is not None]
        return np.column_stack(responses) if len(responses) == 2 else None

    def only(value: Callable[[Vector], Vector]) -> Vector:
        """Of this channel, nothing in all others."""
        outputs = [
            {n: value(np.asarray(found[n])) if n == reading.channel else np.zeros(len(r.time)) for n in r.outputs}
            for r, found in zip(problem.recordings, at.simulated.outputs, strict=True)
        ]
        return problem.whiten(outputs)

    scales = [c.scale for c in reading.coordinates]
    return np.column_stack([only(lambda y: y), only(np.ones_like)]) * scales


def predicted_of(at: Fit, reading: Reading | Stamps, own: Vector) -> tuple[float, Vector]:
    """Decrease of the cost beyond what a re-fit alone brings, base parameters inside their bounds, and the reading's
    coordinates."""
    J, coordinates = np.column_stack([at.jacobian, own]), [*at.hypothesis.coordinates, *reading.coordinates]
    x, prior = np.concatenate([at.x, reading.start()]), np.append(at.hypothesis.prior, [0.0, 0.0])
    lower, upper = np.array([c.lower for c in coordinates]) - x, np.array([c.upper for c in coordinates]) - x
    gram, gradient = J.T @ J + np.diag(prior), J.T @ at.residual - prior * x
    base = slice(0, len(at.x))
    alone = bounded_step(gram[base, base], gradient[base], lower[base], upper[base])[1]
    step, both = bounded_step(gram, gradient, lower, upper)
    return both - alone, step[-2:]


def _fitted(problem: Problem, calibrated: Fit, suspect: Suspect) -> Fit | None:
    """The base model re-fitted beside the reading; to its end only where that promises something."""
    hypothesis = calibrated.hypothesis.with_effects(suspect.reading)
    x = np.concatenate([calibrated.x, suspect.reading.start()])
    begun = fit(problem, hypothesis, x, np.column_stack([calibrated.jacobian, suspect.own]), ROUGH)
    least = (1 - thresholds.HOLDS) * problem.excess(calibrated.residual)
    if begun is None or problem.excess(begun.residual) > least:
        return None
    return fit_on(problem, begun, FINISHED)


def inverse(low: float, high: float) -> tuple[float, float]:
    """The interval of 1/x; where x may be 0, of any value."""
    return (1 / high, 1 / low) if low * high > 0 else (-LARGEST, LARGEST)
