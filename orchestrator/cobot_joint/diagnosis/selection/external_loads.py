"""What no signal announces: somebody holds or pushes the machine for a while, or something gives way at one moment.

Where the difference is confined to short times that no listed term explains, loads over these times are fitted at a
port: per recording and time a trapezoid, or for all recordings one step offset.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.candidates.load_histories import (
    Loads,
    Spans,
    acting,
    begins,
    clock,
    energy,
    fitted,
    frozen_meanwhile,
    outline,
    pulses,
    step_offset,
)
from cobot_joint.diagnosis.estimation.effects import LoadPulse, StepOffset
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import BLOCK, Problem, Vector
from cobot_joint.diagnosis.findings import Estimate, Feature, Finding, Form, LoadHistory
from cobot_joint.diagnosis.localization.evidence import where_it_gains
from cobot_joint.diagnosis.plant.correction import Product
from cobot_joint.diagnosis.plant.plant import PROBE, Port
from cobot_joint.diagnosis.selection.confidence import beside_background, confidence
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.stepwise import Selector, share
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled

FITTED = 4  # proposals at most

Select = Callable[[Fit], Selection]  # listed terms from a fit on, for what is left beside loads
Say = Callable[[str], None]


def look_for_external_loads(problem: Problem, listed: Selection, select: Select, say: Say) -> Unmodelled | None:
    """None: listed terms explain it, it is not confined to short times, or nothing takes enough of it.

    First in place of what is listed, then beside it.
    """
    before, left = (problem.excess(fit.residual) for fit in (listed.history[0], listed.fit))
    if left < thresholds.CLEARLY_LEFT * problem.excess_scatter:
        return None
    found = None
    if not listed.selected or left > thresholds.TERMS_STAND * before:
        found = _beside(problem, listed.up_to(0), select, say)
    if found is None and listed.selected and left > thresholds.NO_PROOF * before:
        found = _beside(problem, listed, select, say)
    return found


def look_for_unlogged_load(
    problem: Problem,
    calibrated: Fit,
    select: Select,
    say: Say,
    predicted_share: Callable[[Fit], float] = lambda fit: 1.0,
) -> Unmodelled | None:
    """Loads at an input that nobody logged, where these and listed terms beside them explain all there is.

    Asked before any term is selected: a hand that comes and goes as it likes leaves terms nothing but patches.
    predicted_share: of what a fit leaves above noise, that the best listed term is predicted to take. Where that is not
    half, loads need not explain all: what is left beside them may be a background.
    """
    above, spans = problem.above(calibrated.residual), short_times(problem, calibrated.residual)
    if not spans or not problem.unexplained(calibrated.residual):
        return None
    say("the difference is confined to short times: looking for loads that were not logged")
    proposed = [p for port in _unlogged(problem) if (p := pulses(problem, calibrated, port, spans))]
    for proposal in (p for p in proposed if p.gain > thresholds.ALONE * above):
        fit = fitted(problem, calibrated, proposal.effects)
        if fit is None:
            continue
        best, selected = _with_terms(problem, fit, [], select, say)
        answer = _answer(problem, calibrated, best, selected, proposal.port)
        if not problem.unexplained(best.residual):
            return answer
        if answer.taken > thresholds.LOADS_TAKE and predicted_share(calibrated) < thresholds.HOLDS:
            return answer
    return None


def look_for_onset(problem: Problem, listed: Selection, selector: Selector, say: Say) -> Selection | None:
    """Where no load explains what is confined to short times: the listed term that sets in as they begin, and terms
    beside it, if it takes as much as an offset has to. None: there is none.

    The jump of a wave over an angle, as it sets in, rings so much that all the rest is short (machines 239/1, 241/2).
    """
    before, left = (problem.above(fit.residual) for fit in (listed.history[0], listed.fit))
    if not problem.onsets or problem.is_table or not problem.stands_out(listed.fit.residual):
        return None
    for so_far in (listed, *([listed.up_to(0)] if listed.selected and left > thresholds.TERMS_STAND * before else [])):
        start = so_far.fit
        spans = short_times(problem, start.residual)
        found = selector.setting_in(start, begins(problem, start, spans)) if spans else None
        if found is None or problem.above(found.residual) > (1 - thresholds.HELD) * problem.above(start.residual):
            continue
        name = found.hypothesis.terms[-1].name
        say(f"{name} sets in there, and takes {share(start.cost - found.cost, problem.above(start.residual))}")
        selected = [*so_far.selected, Selected(name, start.cost - found.cost)]
        return selector.further(replace(so_far, history=[*so_far.history, found], selected=selected, done=False))
    return None


def term_in_place(problem: Problem, listed: Selection, loads: Unmodelled, selector: Selector) -> Selection | None:
    """A listed term that sets in where a step offset does and leaves as little: the offset was its first jump."""
    if loads.finding.onset is None:
        return None
    start = listed.up_to(len(loads.selected))
    found = selector.setting_in(start.fit, loads.finding.onset)
    if found is None or found.cost > loads.fit.cost + thresholds.ALIKE:
        return None
    added = Selected(found.hypothesis.terms[-1].name, start.fit.cost - found.cost)
    return replace(start, history=[*start.history, found], selected=[*start.selected, added])


def short_times(problem: Problem, residual: Vector) -> Spans:
    """Recording -> (from, to) of the times that hold most of what is above noise; empty: these are not short."""
    energies = [energy(problem, residual, n) for n in range(len(problem.recordings))]
    flat = np.sort(np.concatenate(energies))[::-1]
    count = int(np.searchsorted(np.cumsum(flat), thresholds.HELD * flat.sum())) + 1
    if count > thresholds.BRIEF * len(flat):
        return {}
    spans = {}
    for n, held in enumerate(energies):
        time = clock(problem, n)
        joined: list[tuple[float, float]] = []
        for k in np.flatnonzero(held >= flat[count - 1]):
            a, b = float(time[k * BLOCK]), float(time[(k + 1) * BLOCK - 1])
            if joined and a - joined[-1][1] < thresholds.APART:
                joined[-1] = joined[-1][0], b
            else:
                joined.append((a, b))
        if joined:
            spans[n] = joined
    return spans


def _unlogged(problem: Problem) -> list[Port]:
    """Inputs of the system that no recording has."""
    inputs = [p for p in problem.plant.inputs if p.unit in PROBE]
    return [p for p in inputs if not any(p.connector in r.inputs for r in problem.recordings)]


def _beside(problem: Problem, listed: Selection, select: Select, say: Say) -> Unmodelled | None:
    """Loads beside the terms of a selection; None: none takes enough of what these leave."""
    start, spans = listed.fit, short_times(problem, listed.fit.residual)
    found = _best(problem, start, spans, say) if spans else None
    if found is None or start.cost - found[0].cost < problem.evidence:
        return None
    (best, port), selected = found, listed.selected
    offset = any(isinstance(e, StepOffset) for e in acting(best))
    if not offset:
        best, selected = _with_terms(problem, best, selected, select, say)
    answer = _answer(problem, start, best, selected, port)
    return answer if answer.taken > (thresholds.HELD if offset else thresholds.LOADS_TAKE) else None


def _best(problem: Problem, start: Fit, spans: Spans, say: Say) -> tuple[Fit, Port] | None:
    """The best fit of the proposals with the largest predicted gain; None: none predicts much."""
    unlogged = _unlogged(problem)
    additive = [port for port in problem.plant.ports if port.unit in PROBE]
    if not unlogged and not additive:
        return None
    say("the difference is confined to short times: looking for what acts then")
    proposed = [p for port in (*unlogged, *additive) if (p := pulses(problem, start, port, spans))]
    proposed += [p for port in additive if (p := step_offset(problem, start, port, spans))]

    def weight(proposal: Loads) -> float:
        return proposal.gain * (thresholds.UNLOGGED if proposal.port in unlogged else 1.0)

    above = problem.above(start.residual)
    best: tuple[Fit, Port] | None = None
    for proposal in sorted(proposed, key=weight, reverse=True)[:FITTED]:
        if weight(proposal) < thresholds.WORTH_FITTING * above or (best and not problem.unexplained(best[0].residual)):
            break
        fit = fitted(problem, start, proposal.effects)
        if fit is not None:
            say(f"{proposal.port.name}: {share(problem.above(fit.residual), above)} of what is above noise is left")
            best = (fit, proposal.port) if best is None or fit.cost < best[0].cost else best
    return best


def _with_terms(
    problem: Problem, best: Fit, selected: list[Selected], select: Select, say: Say
) -> tuple[Fit, list[Selected]]:
    """Loads and terms, where listed terms take what loads leave."""
    say(f"{len(acting(best))} external loads: {problem.above(best.residual):.0f} above noise is left")
    if not problem.unexplained(best.residual):
        return best, selected
    further = select(best)
    return further.fit, [*selected, *further.selected]


def _answer(problem: Problem, start: Fit, best: Fit, selected: list[Selected], port: Port) -> Unmodelled:
    """A step offset is on no list; loads at an input that was not logged, or at a port, are what the unit lists so."""
    gain = start.cost - best.cost
    taken = 1 - problem.excess(best.residual) / max(problem.excess(start.residual), 1e-9)
    offsets = [e for e in acting(best) if isinstance(e, StepOffset)]
    loads = [e for e in acting(best) if isinstance(e, LoadPulse)]
    touch = next((t.name for t in problem.plant.terms if t.episode and t.component == port.component), None)
    sure = confidence(gain, max(problem.excess(best.residual), 0.0), unlisted=bool(offsets) or not touch)
    finding = Finding(
        term=touch if touch and not offsets else f"{port.component}.unlisted",
        equivalent=(),
        confidence=max(sure, beside_background(taken)) if touch and not offsets else sure,
        onset=offsets[0].t_0 if offsets else None,
        parameters={},
        where=where_it_gains(problem, start.residual**2 - best.residual**2),
        gain=gain,
    )
    if offsets:
        height = Estimate(offsets[0].A, port.unit, _interval(problem, best, offsets[0]))
        form = Form(port.name, port.unit, (), (Feature(Product(), height),), round(taken, 3))
        return Unmodelled(best, selected, replace(finding, shape=form), taken)
    frozen = frozen_meanwhile(problem, loads)
    if frozen:  # what acts then may be what was not logged
        finding = finding.withheld(f"{frozen} is one value meanwhile and may not have been logged")
    names = dict.fromkeys(load.recording for load in loads)
    histories = {name: outline([load for load in loads if load.recording == name]) for name in names}
    history = LoadHistory(port.name, port.unit, histories, frozen)
    return Unmodelled(best, selected, replace(finding, load_history=history), taken)


def _interval(problem: Problem, best: Fit, offset: StepOffset) -> tuple[float, float]:
    """95 % of its height, all else free."""
    names = [c.names[0] for c in best.hypothesis.coordinates]
    return best.interval(names.index(offset.coordinates[0].names[0]), problem.stretches(best.residual))
