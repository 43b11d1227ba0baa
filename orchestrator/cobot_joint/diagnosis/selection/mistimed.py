"""Before physics is asked: a channel that is stamped late, or by a clock that runs at another rate.

Where recordings lie beside the nominal system tells which; the fit beside it tells whether that is all. Where a
background is left beside it, what no answer takes is said once the search is over.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.checks.beside_nominal import ALIKE, SHARE, match, shifted, unlike
from cobot_joint.diagnosis.checks.delays import Delay, agreed, beside, mostly
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.channels import Stamps
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import difference, fit, fit_on, predicted_decrease
from cobot_joint.diagnosis.estimation.problem import Problem, Run, Vector
from cobot_joint.diagnosis.selection.misreading import FINISHED, ROUGH, Misread, predicted_of, spares_others

TRIED = 3  # channels that are fitted
PROMISING = replace(ROUGH, jacobians=0)  # of a fit that has to show promise
STILL = 0.5  # of what a delay takes beside the base model, that it takes beside what was found, to be there still
HOLDING = 0.1  # of what a re-fit leaves above noise, that an input has to take by being held to be told of
RATES = np.linspace(-0.02, 0.02, 81)  # s per s; clocks that are further apart are told by the length of a run


def look_for_mistiming(problem: Problem, calibrated: Fit) -> Misread | None:
    """None: no channel is delayed beside the nominal system, or no delay takes nearly all that is left.

    Channels whose scale somebody gave are believed.
    """
    if problem.is_table or not problem.unexplained(calibrated.residual):
        return None
    before = max(problem.excess(calibrated.residual), 1e-9)
    fitted: list[Misread] = []
    for stamps in _suspects(problem)[:TRIED]:
        found = _fitted(problem, calibrated, stamps)
        if found is None or not spares_others(problem, calibrated, found, stamps.channel):
            continue
        if (taken := 1 - problem.excess(found.residual) / before) > thresholds.ENOUGH:
            unmoved = Stamps(stamps.channel)
            x = np.concatenate([calibrated.x, unmoved.start()])
            hypothesis, own = calibrated.hypothesis.with_effects(unmoved), [len(x) - 2, len(x) - 1]
            columns = difference(problem, hypothesis, x, calibrated.simulated, own)
            if columns is not None:
                predicted = predicted_of(calibrated, unmoved, columns)[0]
                fitted.append(Misread(found, predicted, columns, taken))
    if not fitted:
        return None
    best, *others = sorted(fitted, key=lambda m: m.fit.cost)
    alike = [m.channel for m in others if m.fit.cost - best.fit.cost < thresholds.ALIKE]
    return replace(best, alike=alike[0]) if alike else best


def still_late(problem: Problem, calibrated: Fit, found: Fit) -> list[str]:
    """Channels that come late, or early, beside the re-fitted base model and beside what was found, in words."""
    if problem.is_table or not problem.unexplained(calibrated.residual):
        return []
    believed = {name for r in problem.recordings for name in r.believed}
    step = max(r.step for r in problem.recordings)
    words, beside_found = [], _delays(problem, found)
    for name, delays in _delays(problem, calibrated).items():
        late = agreed(delays, step)
        if late is None and mostly(delays):  # the base model is bent by it
            late = _unbent(problem, calibrated, name, step)
        taken = [sum(d.without - d.left for d in at) for at in (beside_found.get(name, []), delays)]
        if late is not None and name not in believed and taken[0] > STILL * taken[1]:
            words.append(_late_in_words(problem, name, late))
    return words


def held_inputs(problem: Problem, at: Fit) -> list[str]:
    """Inputs that leave less if their values hold until the next one comes, as a drive's set values do, in words.

    What each would take is asked of one simulation and the fit's own Jacobian.
    """
    if problem.is_table or not problem.unexplained(at.residual):
        return []
    above, words = problem.above(at.residual), []
    moves = dict.fromkeys(n for r in problem.recordings for n, u in r.inputs.items() if np.ptp(u) > 0)
    for name in (n for n in moves if not any(n in r.held for r in problem.recordings)):
        recordings = [_with_held(r, name) for r in problem.recordings]
        (simulated,) = Problem(problem.plant, recordings, problem.noise).simulate([at.run])
        if simulated is None:
            continue
        residual = problem.recorded - simulated.white
        instead = replace(at, residual=residual, chi2=float(residual @ residual))
        left = [f.chi2 - predicted_decrease(f) for f in (at, instead)]
        if left[0] - left[1] > max(HOLDING * above, problem.evidence):
            words.append(
                f"{name}: {100 * (left[0] - left[1]) / above:.0f} % less would be left if its values held until the "
                "next one comes, as a drive's do; if yours do, write hold = true in [channels], and diagnose again"
            )
    return words


def _with_held(recording: Recording, name: str) -> Recording:
    return replace(recording, held=recording.held | {name}) if name in recording.inputs else recording


def _delays(problem: Problem, at: Fit) -> dict[str, list[Delay]]:
    """Of every output, run by run."""
    seen: dict[str, list[Delay]] = {}
    for r, simulated in zip(problem.recordings, at.simulated.outputs, strict=True):
        for name, x in r.outputs.items():
            if (delay := beside(x, simulated[name], r.step)) is not None:
                seen.setdefault(name, []).append(delay)
    return seen


def _unbent(problem: Problem, calibrated: Fit, channel: str, step: float) -> float | None:
    """What its runs agree on beside the base model that was fitted beside its stamps."""
    stamps, count = Stamps(channel), len(calibrated.x)
    hypothesis, x = calibrated.hypothesis.with_effects(stamps), np.concatenate([calibrated.x, stamps.start()])
    own = difference(problem, hypothesis, x, calibrated.simulated, range(count, len(x)))
    if own is None:
        return None
    there = fit(problem, hypothesis, x, np.column_stack([calibrated.jacobian, own]), FINISHED)
    unstamped = problem.simulate([calibrated.hypothesis.run(there.x[:count])])[0] if there is not None else None
    if unstamped is None:
        return None
    return agreed(_delays(problem, replace(calibrated, simulated=unstamped)).get(channel, []), step)


def _late_in_words(problem: Problem, channel: str, late: float) -> str:
    inputs = dict.fromkeys(n for r in problem.recordings for n, x in r.inputs.items() if np.ptp(x) > 0)
    leads, stamped, others = ("lags", "late", "early") if late > 0 else ("leads", "early", "late")
    drives = f", {' or '.join(inputs)} stamped {others}" if inputs else ""
    machine = ", a filter, or a lag of the machine" if late > 0 else ""
    return (
        f"{channel} {leads} the re-fitted system by {1e3 * abs(late):.2g} ms in every run that shows it; possible "
        f"causes: {channel} stamped {stamped}{drives}{machine}; correct stamps with late in [[recording]]"
    )


def _suspects(problem: Problem) -> list[Stamps]:
    """Inputs first where several outputs are early or late together, or the only one; then outputs, what explains most
    first."""
    moved: set[str] = set()
    seen: dict[str, list[tuple[float, float, float]]] = {}  # output -> share explained, late, rate; run by run
    nominal = problem.simulate([Run()])[0]
    for r, simulated in zip(problem.recordings, nominal.outputs if nominal else (), strict=False):
        for name, x in r.outputs.items():
            m = match(x, simulated[name])
            if m is None or m.correlation < ALIKE:
                continue
            moved.add(name)
            share, late, rate = _aligned(x, simulated[name], r.step)
            if share > SHARE and abs(late) + abs(rate) * (r.time[-1] - r.time[0]) > r.step:
                seen.setdefault(name, []).append((share, late, rate))
    middle = {name: np.median(np.array(found), axis=0) for name, found in seen.items()}
    ranked = sorted(middle, key=lambda name: -middle[name][0])
    found = [Stamps(n, float(middle[n][1]), float(middle[n][2])) for n in ranked]
    if len(ranked) > 1 or (ranked and moved == set(ranked)):
        late, rate = -np.median(np.array([middle[n][1:] for n in ranked]), axis=0)
        inputs = dict.fromkeys(n for r in problem.recordings for n, x in r.inputs.items() if np.ptp(x) > 0)
        found = [*(Stamps(n, float(late), float(rate)) for n in inputs), *found]
    believed = {name for r in problem.recordings for name in r.believed}
    return [stamps for stamps in found if stamps.channel not in believed]


def _aligned(x: Vector, s: Vector, step: float) -> tuple[float, float, float]:
    """Share of what s leaves of x that a delay takes, s late at the beginning, s per s more.

    Rates are tried first: a delay that grows over more than a period of the motion is beyond what is linear.
    """
    t, none = np.arange(len(x)) * step, unlike(x, s)
    rate = min(RATES, key=lambda rate: unlike(x, np.interp(t - rate * t, t, s)))
    late, rate, left = shifted(x, s, step, (0.0, float(rate)), with_rate=True)
    return (1 - left / none if none else 0.0), late, rate


def _fitted(problem: Problem, calibrated: Fit, stamps: Stamps) -> Fit | None:
    """The base model re-fitted beside the stamps, from nominal: the calibrated one is bent by them.

    Its Jacobian serves all the same until the stamps have shown promise.
    """
    hypothesis = replace(calibrated.hypothesis, effects=(stamps,))
    x, count = hypothesis.start(), len(calibrated.x)
    there = problem.simulate([hypothesis.run(x)])[0]
    own = difference(problem, hypothesis, x, there, range(count, len(x))) if there is not None else None
    if own is None:
        return None
    begun = fit(problem, hypothesis, x, np.column_stack([calibrated.jacobian, own]), PROMISING)
    if begun is None:
        return None
    above, left = (problem.above(found.residual) for found in (calibrated, begun))
    promised = left - predicted_decrease(begun)
    return fit_on(problem, begun, FINISHED) if promised < thresholds.REMAINDER * above else None
