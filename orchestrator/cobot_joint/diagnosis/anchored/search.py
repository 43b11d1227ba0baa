"""Forward selection along the recorded motion: one term at a time, while the data speak for it beside a background."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.anchored.beside import Beside, Candidate, Predicted
from cobot_joint.diagnosis.anchored.left_over import left_over
from cobot_joint.diagnosis.anchored.tracks import Tracker
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.fit import NORMAL
from cobot_joint.diagnosis.findings import Estimate
from cobot_joint.diagnosis.plant.at_once import at_once
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import PROBE, TermCandidate
from cobot_joint.diagnosis.plant.plant import SimulationError as RunError
from cobot_joint.diagnosis.state_estimation.evidence import Effect, combinations

Bounds = Mapping[str, tuple[float, float]]
Progress = Callable[[str], None]
SETTLE, RESETTLE = 5, 3  # corrections of the free parameters at most, from nominal; after a term was added
FLAT = 1e3  # of a value: 1 sigma that a term's own parameter may be off
FARTHEST = 0.5  # of a value, that a term's own parameter moves at once
FIRST = 4  # candidates whose onsets are looked at
TRIED = 5  # of those best ranked
POINTED = 20  # of those that a later look is confined to: what is far behind now stays there
# of the logarithm of the odds: by the decimal logarithm of the evidence in nats, by the next best term's share of it;
# even at 25 nats, above the false findings of some twenty drawn machines; docs/diagnosis-calibration.md counts them
INTERCEPT, COEFFICIENT, NEXT_BEST = -3.75, 2.7, -1.0
MOST = 0.97
PROBED = 0.3  # of the noise, that a run is moved by where a term's answer is taken from runs


@dataclass(frozen=True)
class Named:
    """A term that is on.

    next_best: evidence of the best term that could not be called alike; if it is more, that one did not predict, and
    the name is no claim. in_all: log likelihood that it adds to all recordings, followed again with it; doubt: 1
    sigma of that; predicted: to parts that it was not fitted to. shows: whether free runs feel it beside the rest.
    """

    candidate: Candidate
    alike: tuple[str, ...]
    next_best: float
    predicted: float
    where: dict[str, object]
    in_all: float = 0.0
    doubt: float = 0.0
    shows: bool = True

    @property
    def name(self) -> str:
        """`component.term`, or the base parameter that is outside its tolerance."""
        return self.candidate.term.name

    @property
    def evidence(self) -> float:
        """For it, when it was added."""
        return self.candidate.evidence


def confidence(named: Named) -> float:
    """0..1, by the evidence as far as it predicts, and by how near the best of the others came; no claim where the
    term, once it is on, is clearly worth less than half of that, or where free runs hardly feel it."""
    share = max(named.next_best, 0.0) / max(named.evidence, 1.0)
    proven = max(min(named.evidence, named.predicted), 1.0)
    score = INTERCEPT + COEFFICIENT * math.log10(proven) + NEXT_BEST * share
    worth = named.in_all + named.doubt >= thresholds.HOLDS * min(named.evidence, named.predicted)
    stands = named.shows and share < 1 and worth
    return round(min(1 / (1 + math.exp(-score)), MOST if stands else thresholds.WITHHELD), 3)


@dataclass
class Search:
    """Values so far: base parameters and terms."""

    values: dict[str, float] = field(default_factory=dict)
    onsets: dict[str, float] = field(default_factory=dict)
    own: dict[str, tuple[float, float]] = field(default_factory=dict)  # terms' parameters -> bounds
    named: list[Named] = field(default_factory=list)
    linear: list[Candidate] = field(default_factory=list)  # of these, those whose memory a filter's restarts would lose
    ranking: list[list[tuple[str, float]]] = field(default_factory=list)
    calibrated: dict[str, Estimate] = field(default_factory=dict)
    repaired: dict[str, Estimate] = field(default_factory=dict)
    background: list[dict[str, object]] = field(default_factory=list)  # as `discrepancy` of diagnosis.json

    @property
    def claims(self) -> bool:
        """Whether a term that was named is more likely right than not."""
        return any(confidence(n) >= thresholds.EVEN for n in self.named)

    def supports(self, term: str) -> float:
        """Confidence in a term that was named, or could not be told from one; 0: neither."""
        return max((confidence(n) for n in self.named if term in (n.name, *n.alike)), default=0.0)


class Searcher:
    """bounds: base parameters -> what their tolerances allow. terms: what may be named. in_runs: of these, what free
    runs point to; a term with a memory is what it does to them."""

    def __init__(
        self,
        plant: FmuPlant,
        tracker: Tracker,
        bounds: Bounds,
        terms: Sequence[TermCandidate],
        say: Progress,
        in_runs: Collection[str],
    ) -> None:
        self.plant, self.tracker, self.say = plant, tracker, say
        self.bounds, self.terms, self.in_runs = dict(bounds), list(terms), set(in_runs)
        self.onsets = True  # whether terms may set in during a run
        self._base_runs: dict[object, list[NDArray[np.float64]] | None] = {}  # of one point of the search
        self._asking = threading.Lock()
        self._phases = {t.phase for t in terms}
        self._pointed: set[str] = set()  # terms that the first look pointed to

    def search(self, start: Mapping[str, float]) -> Search:
        """From the base model as free runs have it re-fitted (start), or as it is, where that is more likely.
        SimulationError: the recordings cannot be followed."""
        found, at = self._begun(start)
        at = self._settle(found, SETTLE, at)
        found.calibrated = self._estimates(found, at)
        while len(found.named) < thresholds.MOST_TERMS:
            more = self._best(found, at, self._next(found, at))
            if more is None:
                break
            found, at = more
        found.repaired = self._estimates(found, at)
        found.background = left_over(at, self.plant, self.tracker.alike)
        return found

    def background(self, values: Mapping[str, float], onsets: Mapping[str, float]) -> list[dict[str, object]]:
        """What the system with these values, some from an onset on, leaves. SimulationError: as above."""
        return left_over(self._follow(Search(dict(values), dict(onsets))), self.plant, self.tracker.alike)

    def _begun(self, start: Mapping[str, float]) -> tuple[Search, Beside]:
        """A gap or a stiffness that is far off leaves the corrections in a side valley: field/open case01 was given a
        transmission error that is not there, from nominal values, and none from re-fitted ones."""
        nominal, refitted = Search(), Search({n: x for n, x in start.items() if n in self.bounds})
        as_it_is = self._follow(nominal)
        if not refitted.values:
            return nominal, as_it_is
        at = self._tried(refitted)
        if at is not None and at.gain_over(as_it_is) > 0:
            return refitted, at
        return nominal, self._follow(nominal)  # the first time is closed by what follows

    def _best(self, found: Search, at: Beside, likely: Sequence[Named]) -> tuple[Search, Beside] | None:
        """With the first that makes the recordings more likely, or the next, where it comes near in what is linear and
        makes them more likely: of a torque ripple and a cogging of one order the wrong one led (machine 137/10)."""
        first, after = None, False
        for named in likely:
            if first is not None and not self._comes_near(named, first[0].named[-1]):
                break
            more = self._added(found, at, named)
            if first is not None and more is not None:
                wins, loses = (more, first) if more[1].gain_over(first[1]) > 0 else (first, more)
                return self._again(_beside_rival(wins[0], loses[0].named[-1], found.ranking[-1]))
            first, after = (first, True) if first is not None else (more, False)
        return self._again(first[0]) if first is not None and after else first

    def _again(self, found: Search) -> tuple[Search, Beside]:
        """Followed once more: what was tried after it closed it."""
        return found, self._follow(found)

    def _comes_near(self, named: Named, first: Named) -> bool:
        """Whether what is linear hardly says which of two terms it is."""
        is_term = named.name not in self.bounds and first.name not in self.bounds
        return is_term and named.evidence > thresholds.HOLDS * first.evidence

    def _added(self, found: Search, at: Beside, named: Named) -> tuple[Search, Beside] | None:
        """With a term switched on; None: the recordings are less likely then, its linear share notwithstanding."""
        self.say(f"{named.name}: evidence {named.evidence:.0f}, left-out parts {named.predicted:.0f}")
        with_it = self._with(found, named)
        try:
            then = self._settle(with_it, RESETTLE)
        except SimulationError as error:
            self.say(f"{named.name} cannot be simulated: {error}")
            return None
        # in what is linear, a base parameter was free to leave its tolerance already
        more = named.evidence if named.name in self.bounds else then.gain_over(at)
        doubt = 0.0 if named.name in self.bounds else then.doubt_over(at)
        self.say(f"{named.name}: {more:+.0f} +- {doubt:.0f} in all")
        with_it.named[-1] = replace(named, in_all=more, doubt=doubt)
        return (with_it, then) if more + doubt > 0 else None

    def _settle(self, found: Search, most: int, begun: Beside | None = None) -> Beside:
        """Follow the recordings (begun: already done), and again with the free parameters where they are most likely,
        while that brings more than a further term would have to."""
        at, before = begun or self._follow(found), dict(found.values)
        taken = max((named.evidence for named in found.named), default=0.0)
        enough = max(thresholds.ANCHORED_EVIDENCE, thresholds.ANCHORED_ALIKE_SHARE * taken)
        for n in range(most):
            for name, (off, _) in at.corrections.items():
                found.values[name] = self._moved(found, name, off)
            self.say(f"following the recordings, {n + 2} of {most + 1} at most")
            then = self._tried(found)
            if then is None or (more := then.gain_over(at)) < -thresholds.ANCHORED_EVIDENCE:
                found.values = before  # too far for what is linear
                return at
            at, before = then, dict(found.values)
            if more < enough:
                break
        return at

    def _tried(self, found: Search) -> Beside | None:
        """Followed; None: no recording can be with these values, which other ones went before."""
        try:
            return self._follow(found)
        except SimulationError as error:
            self.say(f"such values cannot be followed: {error}")
            return None

    def _follow(self, found: Search) -> Beside:
        trackings = self.tracker.follow(found.values, found.onsets)
        return Beside(trackings, self._free(found), self.plant.ports, [c.effect for c in found.linear])

    def _free(self, found: Search) -> dict[str, tuple[float, float]]:
        free = {}
        for name, (low, high) in self.bounds.items():
            if name not in found.own:
                free[name] = (low + high) / 2 - self._value(found, name), (high - low) / 2
        for name in found.own:
            free[name] = 0.0, FLAT * max(abs(self._value(found, name)), 1e-9)
        return free

    def _moved(self, found: Search, name: str, off: float) -> float:
        value = self._value(found, name)
        low, high = found.own.get(name) or self.bounds[name]
        if name in found.own and name not in self.bounds and name not in self._phases:
            off = float(np.clip(off, -FARTHEST * abs(value), FARTHEST * abs(value)))
        return float(np.clip(value + off, low, high))

    def _value(self, found: Search, name: str) -> float:
        return found.values.get(name, self.plant.parameters[name].nominal)

    def _next(self, found: Search, at: Beside) -> list[Named]:
        """Terms that the data speak for, best first."""
        on = {name for named in found.named for name in (named.name, *named.alike)}
        every = [*self.terms, *(self._as_term(found, name) for name in self.bounds)]
        pool = [t for t in every if t.name not in on and t.amplitude not in found.own]
        pool = [t for t in pool if not self._pointed or t.name in self._pointed]

        def looked_at(n: int, term: TermCandidate) -> Candidate | None:
            self.say(f"{term.name}, {n + 1} of {len(pool)}")
            candidate = at.candidate(term) or (self._by_runs(found, at, term) if term.name in self.in_runs else None)
            return self._outside(found, at, candidate) if candidate and term.name in self.bounds else candidate

        ranked = [c for c in at_once(looked_at, range(len(pool)), pool) if c is not None]
        ranked.sort(key=lambda c: -c.evidence)

        def late(c: Candidate) -> Candidate:
            return c if c.term.name in self.bounds or not self.onsets else at.with_onset(c, thresholds.LATER / 2)

        ranked = sorted([*at_once(late, ranked[:FIRST]), *ranked[FIRST:]], key=lambda c: -c.evidence)
        self._pointed = self._pointed or {c.term.name for c in ranked[:POINTED]}
        found.ranking.append([(c.term.name, c.evidence) for c in ranked[:10]])
        taken = max((named.evidence for named in found.named), default=0.0)
        most = max([taken, *(c.evidence for c in ranked[:1])])  # where that does not predict, nothing small stands
        least = max(thresholds.ANCHORED_EVIDENCE, thresholds.ANCHORED_LATER * most)
        enough = thresholds.ANCHORED_LATER * max((named.predicted for named in found.named), default=0.0)
        likely: list[Named] = []
        for n, best in enumerate(ranked[:TRIED]):
            patch = best.term.name in self.bounds and best.evidence < taken  # of what a term's form leaves
            if best.evidence < least or patch or any(best.term.name in p.alike for p in likely):
                continue
            outside = best.term.name in self.bounds
            predicted = self._outside_predicts(found, at, best.term.name) if outside else at.predicted(best)
            if predicted.worth > enough:
                likely.append(self._named(at, best, [*ranked[:n], *ranked[n + 1 :]], predicted))
        return likely

    def _named(self, at: Beside, best: Candidate, others: Sequence[Candidate], predicted: Predicted) -> Named:
        close = best.evidence - max(thresholds.ANCHORED_ALIKE, thresholds.ANCHORED_ALIKE_SHARE * best.evidence)
        alike = [c.term.name for c in others if best.evidence >= c.evidence > close]
        next_best = max((c.evidence for c in others if c.term.name not in alike), default=0.0)
        return Named(best, tuple(alike), next_best, predicted.worth, at.where(predicted.blocks))

    def _by_runs(self, found: Search, at: Beside, term: TermCandidate) -> Candidate | None:
        """A term with a memory answers to nothing while it is off: what it does to a run, in proportion."""
        if term.phase is not None:
            return None
        recordings = [t.tracked.recording for t in at.trackings]
        point = tuple(r.name for r in recordings), frozenset(found.values.items()), frozenset(found.onsets.items())
        with self._asking:
            if point not in self._base_runs:
                self._base_runs = {point: self._runs(found, recordings, {})}
            base = self._base_runs[point]
        probe = PROBE.get(term.unit, PROBE["1"])
        every = list(combinations(term))
        if base is None or (far := self._runs(found, recordings, _on(term, every[0], probe))) is None:
            return None
        moved = np.concatenate([((b - a) / [n.sigma for n in t.estimator.noise]).ravel()
                                for a, b, t in zip(base, far, at.trackings, strict=True)])  # fmt: skip
        size = float(np.sqrt(np.mean(moved**2)))
        if size == 0:
            return None
        probe *= float(np.clip(PROBED / size, 1e-3, 1e3))

        def of(shapes: Sequence[Mapping[str, float]]) -> Effect:
            runs = [self._runs(found, recordings, _on(term, shape, probe)) or base for shape in shapes]
            direct = [np.stack([(run[n] - base[n]) / probe for run in runs], axis=2) for n in range(len(recordings))]
            return Effect([np.zeros((len(d) - 1, t.estimator.x.stop, d.shape[2]))
                           for d, t in zip(direct, at.trackings, strict=True)], direct)  # fmt: skip

        candidate = at.best(term, every, len(every), of)
        return candidate and replace(candidate, by_runs=True)

    def _runs(
        self, found: Search, recordings: Sequence[Recording], more: Mapping[str, float]
    ) -> list[NDArray[np.float64]] | None:
        """Per recording, outputs of a free run, (n, channels); None: one came to no end."""

        def of_one(r: Recording) -> NDArray[np.float64] | None:
            values = {name: value for name, value in {**found.values, **more}.items() if self.plant.has(name, r)}
            late = {name: t for name, t in found.onsets.items() if name in values}
            try:
                outputs = self.plant.simulate(values, r, onsets=late)
            except RunError:
                return None
            return np.column_stack([outputs[channel] for channel in r.outputs])

        ended = [outputs for outputs in at_once(of_one, recordings) if outputs is not None]
        return ended if len(ended) == len(recordings) else None

    def _outside_predicts(self, found: Search, at: Beside, name: str) -> Predicted:
        """Of a base parameter beyond a bound: what that adds to parts that it was not fitted to."""
        value, (low, high) = self._value(found, name), self.bounds[name]
        bound = high if value + at.corrections[name][0] > high else low
        return at.predicted_outside(name, bound - value)

    def _outside(self, found: Search, at: Beside, candidate: Candidate) -> Candidate | None:
        """A base parameter is an answer of its own where its tolerance holds it back: by as much as the recordings are
        less likely at the bound."""
        off, sigma = at.corrections[name := candidate.term.name]
        p, (low, high) = self.plant.parameters[name], self.bounds[name]
        value = float(np.clip(self._value(found, name) + off, p.lower, p.upper))
        beyond = max(value - high, low - value)
        if beyond <= 0:
            return None
        evidence = 0.5 * (beyond / sigma) ** 2 - 0.5 * float(np.log(at.regression.readings))
        return replace(candidate, values={name: value}, evidence=evidence)

    def _with(self, found: Search, named: Named) -> Search:
        """With one term more."""
        candidate, term = named.candidate, named.candidate.term
        if candidate.by_runs:
            return replace(found, linear=[*found.linear, candidate], named=[*found.named, named])
        shapes = {s.name: (s.lower, s.upper) for s in term.shapes if not s.whole}
        own = {term.amplitude: (term.lower, term.upper), **shapes}
        own |= {term.phase: (-np.inf, np.inf)} if term.phase is not None else {}
        late = {term.amplitude: candidate.onset} if candidate.onset is not None else {}
        return replace(
            found,
            values={**found.values, **candidate.values},
            onsets={**found.onsets, **late},
            own={**found.own, **own},
            named=[*found.named, named],
        )

    def _as_term(self, found: Search, name: str) -> TermCandidate:
        """A base parameter as something to be named, its neutral value the present one."""
        p = self.plant.parameters[name]
        return TermCandidate(name, name, self._value(found, name), p.lower, p.upper, p.unit)

    def _estimates(self, found: Search, at: Beside) -> dict[str, Estimate]:
        """Base parameters and terms' parameters with marginal 95 % intervals."""
        units = {name: p.unit for name, p in self.plant.parameters.items()}
        result = {}
        for name, (_, sigma) in at.corrections.items():
            value = self._value(found, name)
            low, high = found.own.get(name) or self.bounds[name]
            side = "lower" if value <= low else "upper" if value >= high else None
            interval = value - NORMAL * sigma, value + NORMAL * sigma
            result[name] = Estimate(value, units.get(name, "1"), interval, side)  # type: ignore[arg-type]
        for name, value in found.values.items():
            result.setdefault(name, Estimate(value, units.get(name, "1"), (value, value)))
        return result


def _beside_rival(found: Search, rival: Named, ranking: Sequence[tuple[str, float]]) -> Search:
    """With how near the rival comes to the last name in all, not in what is linear; the others as they were ranked."""
    named = found.named[-1]
    others = (evidence for name, evidence in ranking if name not in (named.name, *named.alike, rival.name))
    nearest = max(named.evidence * rival.in_all / max(named.in_all, 1e-9), *others, 0.0)
    return replace(found, named=[*found.named[:-1], replace(named, next_best=nearest)])


def _on(term: TermCandidate, shapes: Mapping[str, float], step: float) -> dict[str, float]:
    return {**shapes, term.amplitude: float(np.clip(term.neutral + step, term.lower, term.upper))}
