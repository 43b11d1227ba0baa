"""What no list names: the signal that is missing at an additive port, as a formula of the component's own signals."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.diagnosis.confidence import confidence
from orchestrator.diagnosis.diagnosis import Estimate, Feature, Finding, Form
from orchestrator.diagnosis.fit import PRIOR, Fit, fit
from orchestrator.diagnosis.locate import locate_gain
from orchestrator.diagnosis.name import EVIDENCE, Named, Naming
from orchestrator.diagnosis.plant import Port, Signals
from orchestrator.diagnosis.problem import Problem, Run, Vector
from orchestrator.diagnosis.scan import order_power

ORDERS = tuple(float(n) for n in range(1, 13))  # periods per turn that are looked for
MOST_FEATURES = 4
WORTH = 0.04  # of what is to be explained, that a further feature must take
REMAINDER = (
    0.1  # of what was above noise before naming, left after it, from which on a list has not explained the recordings
)
HOLDS = 0.5  # of the remainder, that a form must take away to be an answer
WHOLE = 0.8  # the same, for a form that needs no listed term beside it
PROBE = {"N.m": 1e-3, "V": 1e-2, "A": 1e-3, "rad": 1e-4, "N": 0.1}


@dataclass
class Unlisted:
    """The finding, the fit with it, and the listed terms that stay beside it."""

    fit: Fit
    named: list[Named]
    finding: Finding
    taken: float  # share of the slow structure


@dataclass(frozen=True)
class Column:
    """Response to one feature at a port, per unit of its coefficient."""

    form: str
    values: Mapping[str, Vector]  # recording -> (n,)
    vector: Vector


def look_for_unlisted(problem: Problem, calibrated: Fit, listed: Naming, say: Callable[[str], None]) -> Unlisted | None:
    """None: the list explains what there is, or no form at any port does better.

    First alone: a form that explains all of it makes listed terms patches. Else beside listed terms that do most of it.
    """
    before, left = problem.excess(calibrated.residual), problem.excess(listed.fit.residual)
    if left < max(REMAINDER * before, 10 * problem.excess_scatter):
        return None
    say("looking for what no list names, port by port")
    alone = _look(problem, calibrated, [], say)
    if alone is not None and (alone.taken > WHOLE or not listed.named):
        return alone
    beside = _look(problem, listed.fit, listed.named, say) if left < (1 - HOLDS) * before else None
    if beside is not None:
        return beside
    return alone if alone is not None and alone.finding.gain > calibrated.cost - listed.fit.cost else None


def _look(problem: Problem, start: Fit, named: list[Named], say: Callable[[str], None]) -> Unlisted | None:
    """The best port and form beside the terms of `start`; None: nothing takes HOLDS of what it leaves."""
    best: tuple[float, Port, list[Column], Vector] | None = None
    for port in problem.plant.ports:
        chosen, coefficients, gain = _forward(problem, start, _columns(problem, start, port))
        if chosen and (best is None or gain > best[0]):
            best = (gain, port, chosen, coefficients)
    if best is None:
        return None
    _, port, chosen, coefficients = best
    found = _refit(problem, start, port, chosen, coefficients)
    if found is None:
        return None
    gained, structure = start.cost - found.cost, problem.excess(start.residual)
    taken = (structure - problem.excess(found.residual)) / max(structure, 1e-9)
    if taken < HOLDS or gained < EVIDENCE:
        return None
    say(
        f"{port.component}.unlisted at {port.name} takes {gained:.0f} of {start.chi2 - problem.samples:.0f} above noise"
    )
    finding = _finding(problem, start, found, port, chosen, coefficients, gained, taken, len(named) + 1)
    return Unlisted(found, named, finding, taken)


def _columns(problem: Problem, start: Fit, port: Port) -> list[Column]:
    """Features of the port's own signals on the trajectories of the fit, and their responses."""
    outputs = problem.outputs(start.run, port.signals)
    forms: dict[str, dict[str, Vector]] = {}
    for number, recording in enumerate(problem.recordings):
        if problem.plant.has(port.name, recording):
            for form, values in _features(port, outputs[number], _orders(problem, start, port, outputs)).items():
                forms.setdefault(form, {})[recording.name] = values
    runs, sizes = [], []
    for feature in forms.values():
        size = max(float(np.sqrt(np.mean(v**2))) for v in feature.values()) or 1.0
        sizes.append(PROBE.get(port.unit, 1e-3) / size)
        added = {name: {port.name: sizes[-1] * v} for name, v in feature.items()}
        runs.append(Run(start.run.values, start.run.onsets, _merged(start.run.added, added), (port.component,)))
    found = problem.simulate(runs, start.simulated)
    return [
        Column(form, values, (f.white - start.simulated.white) / size)
        for (form, values), f, size in zip(forms.items(), found, sizes, strict=True)
        if f is not None
    ]


def _features(port: Port, signals: Signals, orders: Mapping[str, Sequence[float]]) -> dict[str, Vector]:
    """Form -> values: constants, speeds, angles with and without the direction, loads."""
    short = {name: name.split(".", 1)[1] for name in port.signals}
    some = next(iter(signals.values()))
    found = {"1": np.ones_like(some)}
    pairs = [(a, _speed_of(a, port)) for a in port.angles]
    for angle, speed in pairs:
        phi = signals[angle]
        if speed is not None:
            w, name = signals[speed], short[speed]
            found |= {
                f"sgn({name})": np.tanh(w / 1e-3),
                name: w,
                f"abs({name})": np.abs(w),
                f"{name}^2": w**2,
                f"{name}^3": w**3,
            }
        for n in orders.get(angle, ()):
            for wave, function in (("sin", np.sin), ("cos", np.cos)):
                form = f"{wave}({n:g}*{short[angle]})"
                found[form] = function(n * phi)
                if speed is not None:
                    found[f"{form}*sgn({short[speed]})"] = function(n * phi) * np.tanh(signals[speed] / 1e-3)
    for load in _loads(port):
        y, name = signals[load], short[load]
        found |= {name: y, f"{name}^2": y**2, f"{name}^3": y**3, f"abs({name})": np.abs(y)}
        for _, speed in pairs[:1]:
            if speed is not None:
                found[f"abs({name})*sgn({short[speed]})"] = np.abs(y) * np.tanh(signals[speed] / 1e-3)
    return {form: values for form, values in found.items() if np.any(values != 0)}


def _speed_of(angle: str, port: Port) -> str | None:
    """phi_b -> w_b, where the unit has it."""
    component, name = angle.split(".", 1)
    speed = f"{component}.{name.replace('phi', 'w', 1)}"
    return speed if speed in port.signals and speed != angle else None


def _loads(port: Port) -> list[str]:
    """A current and a torque of the unit, the first of each in its table."""
    names = [s for s in port.signals if s.split(".", 1)[1] in ("i", "tau_e", "tau_g", "tau_s", "tau_m", "tau_belt")]
    return names[:2]


def _orders(problem: Problem, start: Fit, port: Port, outputs: Sequence[Signals]) -> dict[str, list[float]]:
    """Per angle the orders that stand out of the residual's order spectrum."""
    found = {}
    for angle in port.angles:
        power = order_power(problem, start.residual, angle, outputs, ORDERS)
        best = np.argsort(-power)[:2]
        found[angle] = [ORDERS[k] for k in best if power[k] > 0]
    return found


def _forward(problem: Problem, start: Fit, columns: Sequence[Column]) -> tuple[list[Column], Vector, float]:
    """Features one by one, each the one that takes most, while it is worth it; base parameters re-fitted (linearly)."""
    if not columns:
        return [], np.zeros(0), 0.0
    base = start.jacobian.shape[1]
    J = np.column_stack([start.residual, start.jacobian, *(c.vector for c in columns)])
    gram = J.T @ J
    prior = np.where([c.kind == "base" for c in start.hypothesis.coordinates], PRIOR, 1e-9)
    to_explain = max(problem.excess(start.residual), 1.0)
    chosen: list[int] = []
    nothing, _ = _decrease(gram, base, prior, start.x, [])
    total, coefficients = 0.0, np.zeros(0)
    while len(chosen) < MOST_FEATURES:
        trials = {
            k: _decrease(gram, base, prior, start.x, [*chosen, k]) for k in range(len(columns)) if k not in chosen
        }
        if not trials:
            break
        k = max(trials, key=lambda k: trials[k][0])
        gain = trials[k][0] - nothing
        if gain - total < max(EVIDENCE, WORTH * to_explain):
            break
        chosen.append(k)
        total, coefficients = gain, trials[k][1]
    return [columns[k] for k in chosen], coefficients, total


def _decrease(gram: Vector, base: int, prior: Vector, x: Vector, chosen: Sequence[int]) -> tuple[float, Vector]:
    use = np.concatenate([np.arange(1, base + 1), base + 1 + np.array(chosen, dtype=int)]).astype(int)
    G, g = gram[np.ix_(use, use)].copy(), gram[use, 0].copy()
    G[:base, :base] += np.diag(prior)
    g[:base] -= prior * x
    scale = np.sqrt(np.maximum(np.diag(G), 1e-300))
    step = np.linalg.lstsq(G / np.outer(scale, scale), g / scale, rcond=1e-9)[0] / scale
    return float(g @ step), step[base:]


def _merged(
    a: Mapping[str, Mapping[str, Vector]], b: Mapping[str, Mapping[str, Vector]]
) -> dict[str, dict[str, Vector]]:
    return {name: {**a.get(name, {}), **b.get(name, {})} for name in {*a, *b}}


def _refit(problem: Problem, start: Fit, port: Port, chosen: Sequence[Column], coefficients: Vector) -> Fit | None:
    """Base parameters and terms re-fitted beside the form."""
    names = {name for c in chosen for name in c.values}
    added = {
        name: {port.name: np.sum([k * c.values[name] for k, c in zip(coefficients, chosen, strict=True)], axis=0)}
        for name in names
    }
    hypothesis = replace(start.hypothesis, added=_merged(start.hypothesis.added, added))
    return fit(problem, hypothesis, start.x, start.jacobian, settled=5.0, roughly=0.005, most=10)


def _finding(
    problem: Problem,
    start: Fit,
    found: Fit,
    port: Port,
    chosen: Sequence[Column],
    coefficients: Vector,
    gained: float,
    taken: float,
    count: int,
) -> Finding:
    vectors = np.column_stack([c.vector for c in chosen])
    sigma = np.sqrt(np.diag(np.linalg.pinv(vectors.T @ vectors)))
    features = tuple(
        Feature(c.form, Estimate(float(k), port.unit, (float(k - 1.96 * s), float(k + 1.96 * s))))
        for c, k, s in zip(chosen, coefficients, sigma, strict=True)
    )
    formula = " + ".join(f"{f.coefficient.value:.4g}*{f.form}" for f in features).replace("+ -", "- ")
    used = tuple(s for s in port.signals if any(_mentions(f.form, s.split(".", 1)[1]) for f in features))
    where, words = locate_gain(problem, start.residual**2 - found.residual**2)
    form = Form(port.name, port.unit, used, formula, features, round(taken, 3))
    return Finding(
        term=f"{port.component}.unlisted",
        equivalent=(),
        confidence=confidence(gained, max(problem.excess(found.residual), 0.0), count),
        onset=None,
        parameters={},
        where=where,
        gain=gained,
        shape=form,
        words=f"no listed term explains it; at {port.name} it is {formula}; {words}",
    )


def _mentions(form: str, name: str) -> bool:
    return re.search(rf"(?<![\w.]){re.escape(name)}(?!\w)", form) is not None
