"""What may act in a run beyond the nominal system. One idea for all of it: named coordinates that are applied to a run.

A parameter off its nominal value, a listed term, a formula or table at a port, a load that comes and goes, a step
offset: each is an effect, so one fit moves all of them and one covariance covers all of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from cobot_joint.diagnosis.estimation.problem import Run, Vector
from cobot_joint.diagnosis.plant.plant import PROBE, Parameter, Port, ScannedShape, TermCandidate

REACH = 0.15  # of a pulse's length, by which one fit may move its times
FARTHEST_OFF = 10.0  # times an end of its tolerance: beyond, a value is no data sheet's mistake, and may be stiff
EDGE = 2e-3  # s by which a time is moved for a difference quotient: a few samples


@dataclass(frozen=True)
class Coordinate:
    """One number that a fit moves; 0 is where it starts, 1 a natural step."""

    names: tuple[str, ...]  # a pair (amplitude, phase) or one parameter
    start: float
    scale: float
    lower: float
    upper: float
    kind: Literal["base", "linear", "log", "cos", "sin"]
    component: str
    recording: str | None = None  # the only one that it changes
    step: float | None = None  # of a difference quotient; None: the problem's own


class Effect(Protocol):
    """Something that acts in a run, and the coordinates in which a fit may move it."""

    @property
    def name(self) -> str:
        """`component.term`, the parameter, or the port at which it acts."""
        ...

    @property
    def component(self) -> str:
        """The unit that has it."""
        ...

    @property
    def coordinates(self) -> tuple[Coordinate, ...]: ...

    def start(self) -> Vector:
        """The coordinates of its own values: (len(coordinates),)"""
        ...

    def apply(self, run: Run, x: Vector) -> Run:
        """The run with it. x: (len(coordinates),)"""
        ...

    def at(self, x: Vector) -> Effect:
        """The same with what was found for its own values, where a further fit starts."""
        ...


@dataclass(frozen=True)
class BaseParameter:
    """A parameter of the base model inside its tolerance."""

    parameter: Parameter
    lower: float
    upper: float

    @property
    def name(self) -> str:
        """`component.parameter`"""
        return self.parameter.name

    @property
    def component(self) -> str:
        """The unit that has it."""
        return self.name.split(".")[0]

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """One: -1 and 1 are the ends of the tolerance."""
        middle, half = (self.lower + self.upper) / 2, (self.upper - self.lower) / 2
        return (Coordinate((self.name,), middle, half, -1.0, 1.0, "base", self.component),)

    def start(self) -> Vector:
        """The middle of the tolerance."""
        return np.zeros(1)

    def apply(self, run: Run, x: Vector) -> Run:
        """With its value in the run."""
        (c,) = self.coordinates
        return run.with_values({self.name: _inside(c.start + c.scale * float(x[0]), self.lower, self.upper)})

    def at(self, x: Vector) -> BaseParameter:
        """Itself: its coordinate is of the tolerance, not of where a fit stands."""
        return self


@dataclass(frozen=True)
class FreeParameter:
    """A parameter of the base model beyond its tolerance, as far as its unit lets it and a data sheet is ever off."""

    base: BaseParameter
    value: float

    @property
    def name(self) -> str:
        """`component.parameter`"""
        return self.base.name

    @property
    def component(self) -> str:
        """The unit that has it."""
        return self.base.component

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """One: -1 and 1 are the ends of the tolerance still."""
        (c,) = self.base.coordinates
        lower, upper = ((end - c.start) / c.scale for end in self.bounds)
        return (replace(c, lower=lower, upper=upper, kind="linear"),)

    @property
    def bounds(self) -> tuple[float, float]:
        """The unit's, but at most `FARTHEST_OFF` times the tolerance's ends: a rotor without inertia is none."""
        base, p = self.base, self.base.parameter
        far = FARTHEST_OFF * max(abs(base.lower), abs(base.upper))
        lower = base.lower / FARTHEST_OFF if base.lower > 0 else -far
        upper = base.upper / FARTHEST_OFF if base.upper < 0 else far
        return max(lower, p.lower), min(upper, p.upper)

    def start(self) -> Vector:
        """Its own value."""
        (c,) = self.coordinates
        return np.array([(self.value - c.start) / c.scale])

    def apply(self, run: Run, x: Vector) -> Run:
        """With its value in the run."""
        return run.with_values({self.name: self.at(x).value})

    def at(self, x: Vector) -> FreeParameter:
        """At the value that was found."""
        (c,) = self.coordinates
        return replace(self, value=_inside(c.start + c.scale * float(x[0]), *self.bounds))


@dataclass(frozen=True)
class ActiveTerm:
    """A listed term that is switched on: amplitude, phase and shapes, and from which time within a run it acts."""

    term: TermCandidate
    values: Mapping[str, float]
    onset: float | None = None

    @property
    def name(self) -> str:
        """`component.term`"""
        return self.term.name

    @property
    def component(self) -> str:
        """The unit that has it."""
        return self.term.component

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """Amplitude (sine and cosine of one with a phase), then the shapes that are no whole numbers."""
        return (*self._amplitude(), *(self._shape(s) for s in self.term.shapes if not s.whole))

    def _amplitude(self) -> list[Coordinate]:
        term = self.term
        scale = abs(self.values[term.amplitude] - term.neutral) or 0.01 * (term.upper - term.neutral)
        if term.phase:
            most, pair = term.upper / scale, (term.amplitude, term.phase)
            return [
                Coordinate(pair, 0.0, scale, -most, most, "cos", self.component),
                Coordinate(pair, 0.0, scale, -most, most, "sin", self.component),
            ]
        lower, upper = (term.lower - term.neutral) / scale, (term.upper - term.neutral) / scale
        return [Coordinate((term.amplitude,), term.neutral, scale, lower, upper, "linear", self.component)]

    def _shape(self, shape: ScannedShape) -> Coordinate:
        start, episode = self.values[shape.name], self.term.episode
        if shape.logarithmic:
            lower, upper = float(np.log(shape.lower / start)), float(np.log(shape.upper / start))
            return Coordinate((shape.name,), start, start, lower, upper, "log", self.component)
        begins = episode is not None and shape.name == episode[0]  # anywhere: its length is the measure
        scale = self.values[episode[1]] if episode and begins else 0.1 * (shape.upper - shape.lower)
        lower, upper = (shape.lower - start) / scale, (shape.upper - start) / scale
        return Coordinate((shape.name,), start, scale, lower, upper, "linear", self.component)

    def start(self) -> Vector:
        """Where its values are."""
        x = []
        for c in self.coordinates:
            if c.kind in ("cos", "sin"):
                amplitude, phase = self.values[c.names[0]], self.values[c.names[1]]
                x.append(amplitude / c.scale * (np.cos(phase) if c.kind == "cos" else np.sin(phase)))
            else:
                x.append((self.values[c.names[0]] - c.start) / c.scale if c.kind == "linear" else 0.0)
        return np.array(x)

    def apply(self, run: Run, x: Vector) -> Run:
        """With its parameters in the run."""
        onsets = {} if self.onset is None else {self.term.amplitude: self.onset}
        return run.with_values(self._values(x), onsets)

    def _values(self, x: Vector) -> dict[str, float]:
        """Parameters inside their bounds; those that no coordinate moves as they are."""
        term, moved = self.term, dict(self.values)
        coordinates = self.coordinates
        for k, c in enumerate(coordinates):
            if c.kind == "cos":
                a, b = float(x[k]) * c.scale, float(x[k + 1]) * c.scale
                moved[c.names[0]], moved[c.names[1]] = float(np.hypot(a, b)), float(np.arctan2(b, a))
            elif c.kind == "log":
                moved[c.names[0]] = c.start * float(np.exp(x[k]))
            elif c.kind == "linear":
                moved[c.names[0]] = c.start + c.scale * float(x[k])
        bounds = {term.amplitude: (term.lower, term.upper)} | {s.name: (s.lower, s.upper) for s in term.shapes}
        return moved | {name: _inside(moved[name], *bound) for name, bound in bounds.items() if name in moved}

    def at(self, x: Vector) -> ActiveTerm:
        """The same with what was found for its own values."""
        return replace(self, values=self._values(x))


@dataclass(frozen=True)
class PortSignal:
    """A signal at an additive port: a sum of features, each form (recording -> (n,)) with a coefficient."""

    port: Port
    forms: tuple[str, ...]
    features: tuple[Mapping[str, Vector], ...]
    coefficients: tuple[float, ...]

    @property
    def name(self) -> str:
        """The port."""
        return self.port.name

    @property
    def component(self) -> str:
        """The unit that has it."""
        return self.port.component

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The coefficients, in steps of their own size."""
        return tuple(
            Coordinate((f"{self.port.name}: {form}",), 0.0, abs(k) or 1.0, -np.inf, np.inf, "linear", self.component)
            for form, k in zip(self.forms, self.coefficients, strict=True)
        )

    def start(self) -> Vector:
        """Where the coefficients are."""
        return np.array([k / c.scale for k, c in zip(self.coefficients, self.coordinates, strict=True)])

    def apply(self, run: Run, x: Vector) -> Run:
        """With the signal added at the port."""
        found = self.at(x)
        names = dict.fromkeys(n for feature in self.features for n in feature)
        signals = {
            n: sum((k * f[n] for k, f in zip(found.coefficients, found.features, strict=True) if n in f), np.zeros(1))
            for n in names
        }
        return run.with_signals(self.port.name, signals)

    def at(self, x: Vector) -> PortSignal:
        """The same with other coefficients."""
        scales = [c.scale for c in self.coordinates]
        return replace(self, coefficients=tuple(float(k * s) for k, s in zip(x, scales, strict=True)))


@dataclass(frozen=True)
class LoadPulse:
    """An external load in one recording: a trapezoid of height T that rises from t[0] to t[1] and falls to t[3]."""

    port: Port
    recording: str
    time: Vector  # of the recording since it began, (n,)
    T: float
    t: tuple[float, float, float, float]

    @property
    def name(self) -> str:
        """The port."""
        return self.port.name

    @property
    def component(self) -> str:
        """The unit that has it."""
        return self.port.component

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The height, then the four times, which one fit moves by a part of the length only."""
        reach, where = REACH * (self.t[3] - self.t[0]), (self.component, self.recording)
        times = [
            Coordinate((f"{self.name}: t_{k}",), t, reach, -1.0, 1.0, "linear", *where, EDGE / reach)
            for k, t in enumerate(self.t)
        ]
        return (_height(f"{self.name}: T", self.T, self.port, self.recording), *times)

    def start(self) -> Vector:
        """Where it is."""
        return np.array([self.T / self.coordinates[0].scale, 0.0, 0.0, 0.0, 0.0])

    def apply(self, run: Run, x: Vector) -> Run:
        """With the load added at the port."""
        return run.with_signals(self.port.name, {self.recording: self.at(x).signal(self.time)})

    def at(self, x: Vector) -> LoadPulse:
        """The same at other values, its times in order."""
        height, *times = self.coordinates
        apart = 1e-6 * np.arange(4)  # s, at least
        moved = np.array([c.start + c.scale * float(v) for c, v in zip(times, x[1:], strict=True)])
        t_0, t_1, t_2, t_3 = (float(t) for t in np.maximum.accumulate(moved - apart) + apart)
        return replace(self, T=height.scale * float(x[0]), t=(t_0, t_1, t_2, t_3))

    def signal(self, time: Vector) -> Vector:
        """What it adds: (n,)"""
        return np.asarray(self.T * np.interp(time, self.t, [0.0, 1.0, 1.0, 0.0]))


@dataclass(frozen=True)
class StepOffset:
    """A step of height A at t_0 in all recordings: something gave way, and stays so."""

    port: Port
    times: Mapping[str, Vector]  # recording -> time since it began, (n,)
    A: float
    t_0: float
    reach: float  # s by which one fit may move t_0

    @property
    def name(self) -> str:
        """The port."""
        return self.port.name

    @property
    def component(self) -> str:
        """The unit that has it."""
        return self.port.component

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The height, then the time."""
        return (
            _height(f"{self.name}: A", self.A, self.port),
            Coordinate(
                (f"{self.name}: t_0",),
                self.t_0,
                self.reach,
                -1.0,
                1.0,
                "linear",
                self.component,
                None,
                EDGE / self.reach,
            ),
        )

    def start(self) -> Vector:
        """Where it is."""
        return np.array([self.A / self.coordinates[0].scale, 0.0])

    def apply(self, run: Run, x: Vector) -> Run:
        """With the step added at the port."""
        found = self.at(x)
        return run.with_signals(self.port.name, {name: found.signal(time) for name, time in self.times.items()})

    def at(self, x: Vector) -> StepOffset:
        """The same at other values."""
        return replace(self, A=self.coordinates[0].scale * float(x[0]), t_0=self.t_0 + self.reach * float(x[1]))

    def signal(self, time: Vector) -> Vector:
        """What it adds, (n,): over one sample, since inputs are linear between samples."""
        return np.asarray(self.A * np.clip((time - self.t_0) / float(np.median(np.diff(time))) + 0.5, 0.0, 1.0))


def _height(name: str, height: float, port: Port, recording: str | None = None) -> Coordinate:
    """Of a pulse or a step: its natural step is its own size, or what the port answers to where it has none yet."""
    least = 10 * PROBE[port.unit]
    size = abs(height) or least
    step = max(0.01, min(least / size, 1.0))
    return Coordinate((name,), 0.0, size, -np.inf, np.inf, "linear", port.component, recording, step)


def _inside(value: float, lower: float, upper: float) -> float:
    """At a bound, rounding may be beyond it."""
    return min(max(value, lower), upper)
