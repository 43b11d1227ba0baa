"""Machines that no model fits to the noise, with known answers: drawn campaigns with a background of their own.

Of every machine: friction that waves over speed and torques over an angle at the motor and at the brake, drifts of
friction, supply and torque reading. Kernels, orders and sizes are drawn; none of it is a listed term. What is concealed
in them is a listed term, a torque that is on no list, or a data sheet's value that is wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root
from scipy.signal import lfilter

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.problem import Run
from cobot_joint.diagnosis.evaluation.misstated import Misstated, misstate
from cobot_joint.diagnosis.evaluation.synthetic import (
    Bench,
    Concealed,
    Concealer,
    Drawn,
    size_after_refit,
    with_effects,
)
from cobot_joint.diagnosis.plant.plant import Plant, Signals, SimulationError

Array = NDArray[np.float64]
Rng = np.random.Generator
Components = tuple[str, ...]
MOTOR, BRAKE = "motor_bldc", "mr_brake_belt"
LEVELS = (0.4, 1.7)  # sigma over all samples that a background leaves after a re-fit, even in its logarithm
OVER = (1.6, 20.0)  # times the background that an effect is, the same
DRAWS = 8  # of effects, backgrounds and machines, until all are as they should be
ROUNDS = 4  # of coming nearer to a size
SETTLED = 0.003  # rms, share to which what depends on the motion is that of the motion that it changes ...
TURNS = 12  # ... within so many simulations
RISE = 0.05  # s in which it begins
CLOSE = 0.2  # share to which a background has the size drawn, and an effect that is on no list
UNLISTED = 0.2  # of the effects are on no list
MISSTATED = 0.2  # of the others are values outside their tolerances


@dataclass(frozen=True)
class Part:
    """One summand at a port, by the signals of a run and its time: (n,)"""

    port: str
    of: Callable[[Mapping[str, Array], Array], Array]

    def times(self, gain: float) -> Part:
        """The same, larger or smaller."""
        return Part(self.port, lambda s, t: gain * self.of(s, t))


def family(rng: Rng) -> tuple[Part, ...]:
    """The parts of one machine, each about as large as the others."""
    return (
        _bumps(f"{MOTOR}.tau_add", f"{MOTOR}.w", 500.0, 1e-4, rng),
        _order(f"{MOTOR}.tau_add", f"{MOTOR}.phi", (0.6, 11.3), 1e-4, rng),
        _order(f"{MOTOR}.tau_add", f"{MOTOR}.phi", (0.6, 5.3), 1e-4, rng),
        _drift(f"{MOTOR}.tau_add", f"{MOTOR}.w", 5e-5, rng),
        _drift(f"{MOTOR}.v_add", f"{MOTOR}.w", 0.01, rng),
        _bumps(f"{BRAKE}.tau_add", f"{BRAKE}.w_b", 4.0, 0.02, rng),
        _order(f"{BRAKE}.tau_add", f"{BRAKE}.phi_b", (0.7, 4.3), 0.01, rng),
        _drift(f"{BRAKE}.tau_add", f"{BRAKE}.w_b", 0.01, rng),
        _drift("torque_sensor.y_add", "", 0.004, rng),
    )


@dataclass(frozen=True)
class Unlisted:
    """An effect that is on no list. components: where a force does the same. size: as that of Concealed."""

    components: Components
    size: float


@dataclass(frozen=True)
class FieldDrawn:
    """A machine. background: sigma over all samples that a re-fit leaves of it."""

    drawn: Drawn
    background: float
    unlisted: tuple[Unlisted, ...]
    misstated: tuple[Misstated, ...] = ()


SIGNALS = (f"{MOTOR}.w", f"{MOTOR}.phi", f"{BRAKE}.w_b", f"{BRAKE}.phi_b")


def _bumps(port: str, signal: str, span: float, size: float, rng: Rng) -> Part:
    """Four bells over a speed."""
    middle, width = rng.uniform(-span, span, 4), rng.uniform(0.1, 0.4, 4) * span
    height = rng.normal(0, size, 4) * rng.lognormal(0, 0.7)
    return Part(port, lambda s, t: np.exp(-(((s[signal][:, None] - middle) / width) ** 2)) @ height)


def _order(port: str, signal: str, orders: tuple[float, float], size: float, rng: Rng) -> Part:
    """A wave over an angle, its order no whole number but by chance."""
    n, phase, height = rng.uniform(*orders), rng.uniform(0, 2 * np.pi), abs(rng.normal(0, size)) * rng.lognormal(0, 0.7)
    return Part(port, lambda s, t: height * np.sin(n * s[signal] + phase))


def _drift(port: str, speed: str, size: float, rng: Rng) -> Part:
    """A process of first order over the time, of some seconds; with a speed, against it."""
    tau, seed, height = rng.uniform(0.5, 6), int(rng.integers(1 << 30)), size * rng.lognormal(0, 0.7)

    def of(s: Mapping[str, Array], t: Array) -> Array:
        a = float(np.exp(-(t[1] - t[0]) / tau))
        x = lfilter([np.sqrt(1 - a * a)], [1, -a], np.random.default_rng((seed, len(t))).standard_normal(len(t)))
        return np.asarray(height * x * (np.tanh(s[speed] / 2) if speed else 1.0))

    return Part(port, of)


def off_the_list(rng: Rng) -> tuple[Components, tuple[Part]]:
    """(components where a force does the same, a torque that is on no list): a drag over speed, rough places, teeth."""
    motor = rng.random() < 0.5
    unit, speed, angle, span = (MOTOR, "w", "phi", 500.0) if motor else (BRAKE, "w_b", "phi_b", 15.0)
    w_0, n, phase = span * rng.uniform(0.1, 0.5), rng.uniform(0.6, 4.0), rng.uniform(0, 2 * np.pi)
    forms: tuple[Callable[[Array, Array], Array], ...] = (
        lambda w, phi: (w / span) ** 3,  # cubic drag
        lambda w, phi: (w / w_0) / (1 + (w / w_0) ** 2),  # eddy currents
        lambda w, phi: np.tanh(w / w_0) * np.exp(-((np.abs(w) / w_0 - 1.5) ** 2)),  # a resonance that takes power
        lambda w, phi: (w / span) * np.maximum(np.sin(n * phi + phase), 0),  # rough places, felt with speed
    )
    form = forms[int(rng.integers(len(forms)))]
    own = rng.spawn(1)[0]  # so that most machines stay what they were before there were teeth
    N, slow = int(own.integers(2, 25)), span / 30
    if own.random() < 1 / (1 + len(forms)):
        form = lambda w, phi: np.sin(N * phi + phase) * np.tanh(w / slow)  # noqa: E731 - as those above
    components = (MOTOR, "planetary_gear") if motor else (BRAKE,)
    part = Part(f"{unit}.tau_add", lambda s, t: -1e-3 * form(s[f"{unit}.{speed}"], s[f"{unit}.{angle}"]))
    return components, (part,)


class FieldConcealer:
    """Draws machines with backgrounds after the pattern that a Concealer has.

    unlisted: share of the effects that are on no list; misstated: of the others that are values outside their
    tolerances.
    """

    def __init__(self, concealer: Concealer, unlisted: float = UNLISTED, misstated: float = MISSTATED) -> None:
        self.concealer, self.unlisted, self.misstated = concealer, unlisted, misstated

    def draw(self, rng: Rng, effects: int) -> FieldDrawn:
        """A machine with so many effects. RuntimeError: none of DRAWS moves as what was drawn for it says."""
        for _ in range(DRAWS):
            if (machine := self._drawn(rng, effects)) is not None:
                return machine
        raise RuntimeError(f"none of {DRAWS} draws moves as what was drawn says")

    def _drawn(self, rng: Rng, effects: int) -> FieldDrawn | None:
        bench = self.concealer.bench(rng)
        samples = float(np.sqrt(bench.problem.samples))
        _, background, size = self._sized(bench, lambda: ((), family(rng)), _between(LEVELS, rng) * samples)
        over = _between(OVER, rng) * size
        listed = effects - int(rng.binomial(effects, self.unlisted))
        misstated = self._misstated(bench, listed, over, rng.spawn(1)[0])
        listed -= len(misstated)
        concealed = self._as_large(bench, listed, over, rng)
        parts, unlisted = list(background), list[Unlisted]()
        for _ in range(effects - listed - len(misstated)):
            components, sized, reached = self._sized(bench, lambda: off_the_list(rng), over)
            parts += sized
            unlisted.append(Unlisted(components, reached))
        run = bench.healthy.run.with_values({m.name: m.value for m in misstated})
        run = with_effects(run, [c.active for c in concealed])
        outputs, settled = self.moved(bench, parts, run)
        if not settled:
            return None
        return FieldDrawn(bench.recorded(outputs, concealed, rng), size / samples, tuple(unlisted), tuple(misstated))

    def _misstated(self, bench: Bench, effects: int, wanted: float, rng: Rng) -> list[Misstated]:
        """At most one of so many effects."""
        found = misstate(bench, wanted, rng) if rng.random() < 1 - (1 - self.misstated) ** effects else None
        return [found] if found else []

    def _as_large(self, bench: Bench, effects: int, wanted: float, rng: Rng) -> tuple[Concealed, ...]:
        """Effects of about that root of chi-square: others are drawn where one cannot be so large."""
        for _ in range(DRAWS):
            concealed = self.concealer.conceal(bench, effects, (wanted, 1.001 * wanted), rng)
            if all(c.size > wanted / 2 for c in concealed):
                break
        return concealed

    def _sized(
        self, bench: Bench, draw: Callable[[], tuple[Components, Sequence[Part]]], wanted: float
    ) -> tuple[Components, list[Part], float]:
        """What was drawn, so large that a re-fit leaves about the wanted root of chi-square, and what it leaves. It is
        drawn again where it cannot be so large, or leads to no motion that it goes by. RuntimeError: none can."""
        for _ in range(DRAWS):
            components, parts = draw()
            sized = list(parts)
            for _ in range(ROUNDS):
                outputs, settled = self.moved(bench, sized, bench.healthy.run)
                if not settled:
                    break
                size = size_after_refit(bench.healthy, bench.problem.whiten(outputs) - bench.healthy.simulated.white)
                if abs(size / wanted - 1) < CLOSE:
                    return components, sized, size
                sized = [part.times(float(np.clip(wanted / max(size, 1e-6), 0.05, 20))) for part in sized]
        raise RuntimeError(f"none of {DRAWS} draws can be so large")

    def moved(self, bench: Bench, parts: Sequence[Part], run: Run) -> tuple[list[Signals], bool]:
        """Outputs with parts that go by the motion that they lead to, and whether there is one: a drag of its own
        motion is none of the motion before it, and may lead further from it with every simulation.

        Anderson 1965, J. ACM 12(4); scipy.optimize.anderson.
        """
        problem, plant = bench.problem, bench.problem.plant

        def along(outputs: Sequence[Signals]) -> list[Signals]:
            pairs = zip(problem.recordings, outputs, strict=True)
            return [_added(parts, o, r, plant) for r, o in pairs]

        outputs = problem.outputs(run, SIGNALS)
        first = along(outputs)
        places = [(n, port) for n, signals in enumerate(first) for port in signals]
        scales = {port: float(np.sqrt(np.mean(np.concatenate([s[port] for s in first if port in s]) ** 2))) or 1.0
                  for _, port in places}  # fmt: skip

        def flat(added: Sequence[Signals]) -> Array:
            return np.concatenate([added[n][port] / scales[port] for n, port in places])

        def further(x: Array) -> Array:
            nonlocal outputs
            at = iter(np.split(x, np.cumsum([len(first[n][port]) for n, port in places])[:-1]))
            added: list[Signals] = [{} for _ in first]
            for n, port in places:
                added[n][port] = next(at) * scales[port]
            run_with = {r.name: a for r, a in zip(problem.recordings, added, strict=True)}
            outputs = problem.outputs(replace(run, added=run_with), SIGNALS)
            return flat(along(outputs)) - x

        if not places:
            return outputs, False  # no recording has the port
        options = {"maxiter": TURNS, "fatol": SETTLED, "tol_norm": _rms, "line_search": None,
                   "jac_options": {"alpha": 1.0, "M": 5}}  # fmt: skip
        try:
            found = root(further, flat(first), method="anderson", options=options)
        except SimulationError:
            return outputs, False
        return outputs, bool(found.success)


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _added(parts: Sequence[Part], signals: Signals, recording: Recording, plant: Plant) -> Signals:
    time = recording.time - recording.time[0]
    found: Signals = {}
    for part in (p for p in parts if plant.has(p.port, recording)):
        x = part.of(signals, time) * np.minimum(time / RISE, 1.0)
        found[part.port] = found.get(part.port, np.zeros(len(time))) + x
    return found


def _between(ends: tuple[float, float], rng: Rng) -> float:
    return float(np.exp(rng.uniform(*np.log(ends))))
