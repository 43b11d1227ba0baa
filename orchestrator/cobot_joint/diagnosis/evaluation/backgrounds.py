"""Machines that no model fits to the noise, with known answers: drawn campaigns with a background of their own.

Of every machine: friction that waves over speed and torques over an angle at the motor and at the brake, drifts of
friction, supply and torque reading. Kernels, orders and sizes are drawn; none of it is a listed term.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.problem import Run
from cobot_joint.diagnosis.evaluation.synthetic import Bench, Concealer, Drawn, size_after_refit, with_effects
from cobot_joint.diagnosis.plant.plant import Plant, Signals

Array = NDArray[np.float64]
Rng = np.random.Generator
MOTOR, BRAKE = "motor_bldc", "mr_brake_belt"
LEVELS = (0.4, 1.7)  # sigma over all samples that a background leaves after a re-fit, even in its logarithm
OVER = (1.6, 20.0)  # times the background that an effect is, the same
ROUNDS = 4  # of simulating with what depends on the motion that it changes
RISE = 0.05  # s in which it begins
CLOSE = 0.2  # share to which a background has the size drawn


@dataclass(frozen=True)
class Part:
    """One summand at a port, by the signals of a run and its time: (n,)"""

    port: str
    of: Callable[[Mapping[str, Array], Array], Array]


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


class FieldConcealer:
    """Draws machines with backgrounds after the pattern that a Concealer has."""

    def __init__(self, concealer: Concealer) -> None:
        self.concealer = concealer

    def draw(self, rng: Rng, effects: int) -> tuple[Drawn, float]:
        """A campaign with so many effects, and its background: sigma over all samples after a re-fit."""
        bench = self.concealer.bench(rng)
        parts = family(rng)
        wanted = _between(LEVELS, rng) * float(np.sqrt(bench.problem.samples))
        gain, size = 1.0, 0.0
        for _ in range(ROUNDS):
            outputs = self._outputs(bench, parts, gain, bench.healthy.run, 2)
            size = size_after_refit(bench.healthy, bench.problem.whiten(outputs) - bench.healthy.simulated.white)
            if abs(size / wanted - 1) < CLOSE:
                break
            gain *= float(np.clip(wanted / max(size, 1e-6), 0.05, 20))
        over = _between(OVER, rng) * size
        concealed = self.concealer.conceal(bench, effects, (over, 1.001 * over), rng)
        run = with_effects(bench.healthy.run, [c.active for c in concealed])
        drawn = bench.recorded(self._outputs(bench, parts, gain, run, ROUNDS), concealed, rng)
        return drawn, size / float(np.sqrt(bench.problem.samples))

    def _outputs(self, bench: Bench, parts: Sequence[Part], gain: float, run: Run, rounds: int) -> list[Signals]:
        """With the background along the motion that it leads to."""
        problem = bench.problem
        outputs = problem.outputs(run, SIGNALS)
        for _ in range(rounds):
            added = {r.name: _added(parts, gain, o, r, problem.plant)
                     for r, o in zip(problem.recordings, outputs, strict=True)}  # fmt: skip
            outputs = problem.outputs(replace(run, added=added), SIGNALS)
        return outputs


def _added(parts: Sequence[Part], gain: float, signals: Signals, recording: Recording, plant: Plant) -> Signals:
    time = recording.time - recording.time[0]
    found: Signals = {}
    for part in (p for p in parts if plant.has(p.port, recording)):
        x = gain * part.of(signals, time) * np.minimum(time / RISE, 1.0)
        found[part.port] = found.get(part.port, np.zeros(len(time))) + x
    return found


def _between(ends: tuple[float, float], rng: Rng) -> float:
    return float(np.exp(rng.uniform(*np.log(ends))))
