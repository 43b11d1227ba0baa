"""Waves, which go by an angle that free runs lose: listed ones by the recorded angle, and those of a formula."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter, itemgetter

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.anchored.search import Search
from cobot_joint.diagnosis.candidates.formulas import Dictionary
from cobot_joint.diagnosis.estimation.effects import ActiveTerm, PortSignal
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import fit, fit_added
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.estimation.projection import Projection
from cobot_joint.diagnosis.estimation.recorded_motion import at_recorded_angle
from cobot_joint.diagnosis.findings import Feature
from cobot_joint.diagnosis.plant.plant import PROBE, TermCandidate
from cobot_joint.diagnosis.selection.competition import finished
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.stepwise import Selector, share
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled

SAME = 0.01  # share by which two orders may differ and be one: an angle is followed over tens of turns
WAVES = ("sin", "cos")
FITTED = 2  # listed waves that are fitted, of those predicted to take most
SHOWN = 4  # orders of a unit's angles that are tried, of those that stand out


def without_waves(found: Unmodelled) -> Unmodelled | None:
    """The formula without what goes by an angle; None: nothing is left of it."""
    shape = found.finding.shape
    assert shape is not None
    rest = tuple(f for f in shape.features if not any(factor.function in WAVES for factor in f.form.factors))
    if not rest:
        return None
    return replace(found, finding=replace(found.finding, shape=replace(shape, features=rest)))


def by_recorded_angle(
    problem: Problem, listed: Selection, beside: Selector, say: Callable[[str], None]
) -> Selection | None:
    """A listed wave, by the recorded angle, in place of what was selected where that leaves less; or beside it, where
    it takes half of what is left. None: no wave does. In free runs that drift a wave was off its angle, and was taken
    for little, or for one that sets in (field/open case04)."""
    if not problem.stands_out(listed.fit.residual):
        return None
    base, best = listed.history[0], listed.fit
    for start in (listed.up_to(0), listed) if listed.selected else (listed,):
        above = problem.above(start.fit.residual)
        found = _fitted(
            problem, start.fit, _that_show(problem, start.fit), beside.probes(base), thresholds.HOLDS * above
        )
        least = thresholds.WORTH * problem.above(best.residual)
        if not found or best.cost - found[0].cost < max(problem.evidence, least):
            continue
        wave, *others = _by_its_own_angle(problem, found[0]), *found[1:]
        name = wave.hypothesis.terms[-1].name
        say(f"{name}, by the recorded angle, takes {share(start.fit.cost - wave.cost, above)} of what is above noise")
        alike = {f.hypothesis.terms[-1].name: f.cost - wave.cost for f in others if beside.as_good(f, wave)}
        added = Selected(name, start.fit.cost - wave.cost, alike)
        more = replace(start, history=[*start.history, wave], selected=[*start.selected, added], done=False)
        return beside.further(more)
    return None


def in_place_of(problem: Problem, formula: Unmodelled, probes: Mapping[str, float]) -> list[Fit]:
    """The listed waves of the formula's units and orders, each fitted in its place with all else, by the recorded angle
    as the formula is; the best first. probes: term -> amplitude that moves a run by about its noise."""
    start = _without_signal(problem, formula.fit)
    if start is None:
        return []
    least = thresholds.HOLDS * problem.above(start.residual)
    return _fitted(problem, start, _candidates(problem, formula), probes, least, formula.finding.onset)


def _fitted(
    problem: Problem,
    start: Fit,
    candidates: Iterable[tuple[TermCandidate, float]],
    probes: Mapping[str, float],
    least: float,
    onset: float | None = None,
) -> list[Fit]:
    """Waves, each with its periods per turn, beside a fit, the best first: of those predicted to take so much, the
    first few."""
    likely = [
        _predicted(problem, start, term, n, probes.get(term.name, PROBE.get(term.unit, 1e-6))) for term, n in candidates
    ]
    some = [wave for gain, wave in sorted(likely, key=itemgetter(0), reverse=True)[:FITTED] if gain > least]
    fits = [fit_added(problem, start, [replace(wave, onset=onset)], finished(jacobians=1)) for wave in some]
    return sorted(filter(None, fits), key=attrgetter("cost"))


def _by_its_own_angle(problem: Problem, found: Fit) -> Fit:
    """The last wave by the angle that a run of its own has, where that does as well: of a machine that obeys the
    equations nothing slips, and an integrated speed knows the angle less well."""
    at = found.settled()
    (*before, wave) = at.hypothesis.effects
    assert isinstance(wave, ActiveTerm)
    own = replace(at.hypothesis, effects=(*before, ActiveTerm(wave.term, wave.values, wave.onset)))
    plain = fit(problem, own, at.x, at.jacobian, finished(jacobians=1))
    return plain if plain is not None and plain.cost < found.cost + thresholds.ALIKE else found


def hides_a_wave(problem: Problem, found: Fit) -> bool:
    """Whether a fit that leaves what stands out leaves an order of a shaft's recorded angle, at which a listed wave is
    off. Of cogging on which a slow shaft catches, a free run has the mean drag, which other forms follow, and not the
    angle."""
    return problem.stands_out(found.residual) and any(True for _ in _that_show(problem, found, clear=True))


def _that_show(problem: Problem, start: Fit, clear: bool = False) -> Iterator[tuple[TermCandidate, float]]:
    """Listed waves that are off, at the orders of their unit's angles that stand out of the residual. clear: of those
    alone that stand out of the orders beside them."""
    on = {active.name for active in start.hypothesis.terms}
    ports = {port.component: port for port in problem.plant.ports if port.angles}
    outputs = problem.outputs(start.run, list(dict.fromkeys(s for port in ports.values() for s in port.signals)))
    shown = {component: Dictionary(problem, start, port, outputs) for component, port in ports.items()}
    for term in problem.plant.terms:
        there = shown.get(term.component)
        if term.phase is None or term.name in on or there is None or not there.locals:
            continue
        waves = there.clear[:SHOWN] if clear else [*there.waves[:SHOWN], *there.clear[:SHOWN], *there.low]
        orders = [n for angle, n in waves if f"{term.component}.{angle}" == term.angle]
        yield from ((term, n) for n in dict.fromkeys(orders) if _may_have(term, n))


def _candidates(problem: Problem, found: Unmodelled) -> Iterator[tuple[TermCandidate, float]]:
    """Listed waves of the units at which the formula may act, with an order of its own."""
    shape = found.finding.shape
    features = shape.features if shape is not None else ()
    orders = {factor.p for f in features for factor in f.form.factors if factor.function in WAVES}
    units = {name.split(".")[0] for name in (found.finding.term, *found.finding.equivalent)}
    for term in problem.plant.terms:
        if term.phase is None or term.component not in units:
            continue
        yield from ((term, n) for n in sorted(orders) if _may_have(term, n))


def _may_have(term: TermCandidate, n: float) -> bool:
    """Whether a listed wave may have so many periods per turn."""
    whole = next((s for s in term.shapes if s.whole), None)
    lower, upper = (whole.lower, whole.upper) if whole else (term.turns, term.turns)
    return lower * (1 - SAME) <= n <= upper * (1 + SAME) and (whole is None or abs(n - round(n)) < SAME * n)


def _predicted(
    problem: Problem, start: Fit, term: TermCandidate, order: float, probe: float
) -> tuple[float, ActiveTerm]:
    """(chi-square that it takes, what is linear in its two parts; the term with these)."""
    shapes = {s.name: float(round(order)) if s.whole else float(np.median(s.values)) for s in term.shapes}
    trials = [{**shapes, term.amplitude: term.neutral + probe, str(term.phase): x} for x in (0.0, np.pi / 2)]
    wave = at_recorded_angle(problem, start.run, ActiveTerm(term, trials[0]))
    waves = [replace(wave, values=values) for values in trials]
    runs = [start.hypothesis.with_effects(w).run(np.concatenate([start.x, w.start()])) for w in waves]
    found = problem.simulate([run.beside(term.component) for run in runs], start.simulated)
    columns = [(f.white - start.simulated.white) / probe for f in found if f is not None]
    if len(columns) < len(waves):
        return 0.0, wave
    gain, (a, b) = Projection(start, columns).gain([0, 1])
    amplitude = float(np.clip(np.hypot(a, b), term.lower, term.upper))
    values = {**shapes, term.amplitude: amplitude, str(term.phase): float(np.arctan2(b, a))}
    return gain, replace(wave, values=values)


def _without_signal(problem: Problem, found: Fit) -> Fit | None:
    """A formula's fit without it, all else as it is; None: it cannot be simulated."""
    at = found.settled()
    less = replace(at.hypothesis, effects=tuple(e for e in at.hypothesis.effects if not isinstance(e, PortSignal)))
    left = [c.names[0] for c in less.coordinates]
    kept = [k for k, c in enumerate(at.hypothesis.coordinates) if c.names[0] in left]
    (simulated,) = problem.simulate([less.run(at.x[kept])])
    if simulated is None:
        return None
    residual: Vector = problem.recorded - simulated.white
    return Fit(less, at.x[kept], float(residual @ residual), residual, simulated, at.jacobian[:, kept], 0)


def repeats(formula: Unmodelled, found: Search) -> bool:
    """Whether it is a wave that the motion has named, in the phase that free runs have lost: orders of that unit alone,
    and nothing else."""
    shape, unit = formula.finding.shape, f"{formula.finding.component}."
    orders = [v.value for name, v in found.repaired.items() if name.startswith(unit) and name.endswith(".n")]
    features: Sequence[Feature] = shape.features if shape is not None else ()
    return bool(features) and all(any(_is_wave(f, order) for order in orders) for f in features)


def _is_wave(feature: Feature, order: float) -> bool:
    """Whether it is a sine or cosine, as large at any speed and load."""
    (factor, *more) = feature.form.factors or (None,)
    return not more and factor is not None and factor.function in WAVES and abs(factor.p - order) < SAME * order
