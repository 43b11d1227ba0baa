"""Forms that an unmodelled effect may have at a port: products of functions of a unit's own signals and of time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.order_spectrum import (
    clear_orders,
    clearest_between,
    order_spectrum,
    prewhitened,
    whole_orders,
)
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.estimation.recorded_motion import along_recording
from cobot_joint.diagnosis.plant.correction import SGN, TIME, Factor, Product
from cobot_joint.diagnosis.plant.plant import Port, Signals

BETWEEN = 12.0  # up to which one that is no whole number is looked for
LOW = 2  # order, up to which a wave is tried though a shaft turns too little for a spectrum
ARC = np.pi / 4  # rad of travel, over which they are seen: gravity on an elbow that goes from -1.2 to 1.4 rad
FEW, MORE = 2, 4  # waves that are tried at every port, and at those where the residual points
LOADS = 2  # of a unit's torques and currents that forms are made of
COLLINEAR = 0.97  # correlation from which on two loads are one
TOGETHER = 0.05  # of an angle's travel, by which that of another may differ that a spring or a shaft joins to it
FOLLOWS = 0.02  # of an angle's travel, to which the integral of its speed equals it
WIDTHS = (1e-3, 1e-2, 5e-2)  # of a smoothed sign, over the largest speed
DECAYS = (0.03, 0.1, 0.3)  # speeds over which friction falls, over the largest speed
PEAKS = (0.05, 0.1, 0.2, 0.4)  # speeds at which the drag of eddy currents is largest, over the largest speed
SLOW = (1, 4, 16)  # s
Wave = tuple[str, float]  # angle, periods per turn
Feature = Mapping[str, Vector]  # recording -> (n,)


@dataclass(frozen=True)
class Local:
    """What a component knows in one run: its signals under their short names, (n,) each, and the time since start."""

    signals: Mapping[str, Vector]
    time: Vector


@dataclass(frozen=True)
class _Spectral:
    """A wave in a residual's order spectrum. windows: that it is from."""

    power: float
    wave: Wave
    windows: float


class Dictionary:
    """Forms at one port on the trajectories of one fit, its motion where the recordings have it.

    outputs: channels and the ports' signals of that fit, where they are simulated already. between: angle -> the
    clearest order of that fit that is no whole number, where another dictionary has looked; this one fills it.
    """

    def __init__(
        self,
        problem: Problem,
        start: Fit,
        port: Port,
        outputs: Sequence[Signals] | None = None,
        between: dict[str, float | None] | None = None,
    ) -> None:
        self.problem, self.port = problem, port
        self.between: dict[str, float | None] = {} if between is None else between
        self.residual = start.residual
        every = list(dict.fromkeys(angle for other in problem.plant.ports for angle in other.angles))
        simulated = problem.outputs(start.run, [*port.signals, *every]) if outputs is None else outputs
        self.locals = self._locals(simulated)
        self.angles = [_short(n) for n in port.angles]
        self.speeds = {angle: w for angle in self.angles if (w := self._speed_of(angle)) is not None}
        self.speed = next(iter(self.speeds.values()), None)
        moving = {*self.angles, *self.speeds.values()}
        motion = [n for n in port.signals if _short(n) in moving]
        self.whole = whole_orders(simulated, every)
        self.outputs = [along_recording(r, s, motion) for r, s in zip(problem.recordings, simulated, strict=True)]
        self.locals = self._locals(self.outputs)
        self.loads = self._independent([_short(n) for n in port.loads])
        self.voltage = next(map(_short, port.voltages), None)

    def _locals(self, outputs: Sequence[Signals]) -> dict[str, Local]:
        """By recording that has the port."""
        return {
            r.name: Local({_short(n): v for n, v in found.items() if n in self.port.signals}, r.time - r.time[0])
            for r, found in zip(self.problem.recordings, outputs, strict=True)
            if self.problem.plant.has(self.port.name, r)
        }

    def _speed_of(self, angle: str) -> str | None:
        """The signal whose integral the angle is, in every run in which it moves; None: there is none."""
        moving = [k for k in self.locals.values() if np.ptp(k.signals[angle]) > 0]
        others = [_short(n) for n in self.port.signals if _short(n) not in self.angles]
        return next((w for w in others if moving and all(_follows(k, angle, w) for k in moving)), None)

    def _independent(self, names: Sequence[str]) -> list[str]:
        """The first that move, without those that go with one before."""
        kept: dict[str, Vector] = {}
        for name in names:
            x = np.concatenate([k.signals[name] for k in self.locals.values()] or [np.zeros(1)])
            if np.ptp(x) > 0 and not any(abs(np.corrcoef(x, y)[0, 1]) > COLLINEAR for y in kept.values()):
                kept[name] = x
        return list(kept)[:LOADS]

    def reach(self, name: str) -> float:
        """The signal's largest magnitude in any run, to one digit; 0: it never moves."""
        largest = max((float(np.max(np.abs(k.signals[name]))) for k in self.locals.values()), default=0.0)
        return float(f"{largest:.0e}")

    def at(self, other: Dictionary, forms: Sequence[Product]) -> dict[Product, Feature]:
        """The same forms by another unit's motion; empty where that does not turn as this one, or where they go by more
        than motion."""
        twins: dict[str, str] = {}
        for angle in self.angles if other.locals else ():
            twin = next((b for b in other.angles if abs(other.travel(b) / self.travel(angle) - 1) < TOGETHER), None)
            if twin is not None:
                twins[angle] = twin
                if angle in self.speeds and twin in other.speeds:
                    twins[self.speeds[angle]] = other.speeds[twin]
        if any(s not in twins for form in forms for s in form.signals):
            return {}
        return other.values([form.renamed(twins) for form in forms])

    def travel(self, angle: str) -> float:
        """The largest in any run, rad; never 0."""
        return max(float(np.ptp(k.signals[angle])) for k in self.locals.values()) or 1e-300

    @cached_property
    def waves(self) -> list[Wave]:
        """Orders of the port's angles that stand out of the residual, clearest first."""
        return list(dict.fromkeys(s.wave for s in self._strongest if s.power > 0))

    @cached_property
    def clear(self) -> list[Wave]:
        """Whole orders that stand out of those beside them, prewhitened, clearest first: in what a free run that drifts
        leaves, they have less power than its slow part at low ones."""
        found, white = [], prewhitened(self.problem, self.residual)
        for name, turning in product(self.port.angles, (False, True)):
            power, windows = order_spectrum(self.problem, white, name, self.outputs, self.whole[name], turning=turning)
            found += [(power[k], (_short(name), self.whole[name][k])) for k in clear_orders(power, windows)]
        return list(dict.fromkeys(wave for _, wave in sorted(found, reverse=True)))

    @property
    def _prominent(self) -> list[Wave]:
        return list(dict.fromkeys([*self.waves[:FEW], *self.clear[:1]]))

    @property
    def _strongest(self) -> list[_Spectral]:
        return sorted(self._spectra, key=lambda s: (-s.power, s.wave))

    @property
    def low(self) -> list[Wave]:
        """Low orders of which no window of a spectrum holds enough, and a recording ARC at least: of a shaft that turns
        once or twice, or of an arm that swings, forms have to say."""
        low = [s.wave for s in self._spectra if s.windows == 0 and s.wave[1] <= LOW]
        return list(dict.fromkeys((a, n) for a, n in low if self.travel(a) > ARC))

    @cached_property
    def _spectra(self) -> list[_Spectral]:
        """Of what keeps its sign when the shaft turns round, and of the rest."""
        found: list[_Spectral] = []
        for name in self.port.angles:
            for orders, turning in product(self._orders(name), (False, True)):
                of_all = order_spectrum(self.problem, self.residual, name, self.outputs, orders, turning=turning)
                found += [
                    _Spectral(float(p), (_short(name), n), float(m)) for n, p, m in zip(orders, *of_all, strict=True)
                ]
        return found

    def _orders(self, angle: str) -> tuple[list[float], list[float]]:
        """Whole ones, and the clearest that is none, with its double, in place of the one in which it shows as well."""
        if angle not in self.between:
            self.between[angle] = clearest_between(self.problem, self.residual, angle, self.outputs, BETWEEN)
        n, whole = self.between[angle], self.whole[angle]
        return (whole, []) if n is None else ([k for k in whole if k != max(round(n), 1)], [n, 2 * n])

    def first(self) -> dict[Product, Feature]:
        """The few that tell where the residual points."""
        return self.values([*self._first(), *self._waves([*self.low, *self._prominent])])

    def more(self) -> dict[Product, Feature]:
        """The rest."""
        return self.values([*self._more(), *self._waves([w for w in self.waves[:MORE] if w not in self._prominent])])

    def values(self, products: Sequence[Product]) -> dict[Product, Feature]:
        """Those that are not 0 everywhere."""
        found = {p: {name: p.of(k.signals, k.time) for name, k in self.locals.items()} for p in products}
        return {p: values for p, values in found.items() if any(np.any(v != 0) for v in values.values())}

    def _waves(self, waves: Sequence[Wave]) -> Iterator[Product]:
        """Sines and cosines, alone, with the direction of the angle's own speed, where the unit has it, and with that
        speed: a seal that runs out of true."""
        for name, order in waves:
            speed = self.speeds.get(name, self.speed)
            for wave in (Factor(name, "sin", order), Factor(name, "cos", order)):
                yield Product((wave,))
                if speed is not None:
                    yield from (Product((wave, sign(speed))), Product((wave, Factor(speed, "u"))))

    def _first(self) -> Iterator[Product]:
        yield Product()
        for name in self.loads:
            yield from (Product((Factor(name, "u"),)), Product((Factor(name, "u2"),)))
        if self.speed is not None:
            w, direction = Factor(self.speed, "u"), sign(self.speed)
            yield from (Product((direction,)), Product((w,)), Product((Factor(self.speed, "u3"),)))
            yield Product((w, Factor(self.speed, "abs")))
            yield from (Product((Factor(name, "abs"), direction)) for name in self.loads)

    def _more(self) -> Iterator[Product]:
        for name in self.loads:
            size = Factor(name, "abs")
            yield from (Product((Factor(name, "u3"),)), Product((size,)))
            if self.voltage:
                v = Factor(self.voltage, "u")
                yield from (Product((Factor(name, "u"), v)), Product((size, v)))
        drifting: list[tuple[Factor, ...]] = [()]
        if self.speed is not None:
            w, direction = Factor(self.speed, "u"), sign(self.speed)
            yield from (Product((Factor(self.speed, "abs"),)), Product((Factor(self.speed, "u2"),)))
            yield from (Product((Factor(load, "u"), w)) for load in self.loads)
            reach = self.reach(self.speed)
            yield from (Product((Factor(self.speed, "tanh", width * reach),)) for width in WIDTHS if reach)
            yield from (Product((Factor(self.speed, "exp", decay * reach), direction)) for decay in DECAYS if reach)
            yield from (Product((Factor(self.speed, "eddy", peak * reach),)) for peak in PEAKS if reach)
            drifting += [(direction,), (w,)]
        for T in SLOW:
            yield from (Product((Factor(TIME, "exp", T), *form)) for form in drifting)


def sign(signal: str) -> Factor:
    """Its direction."""
    return Factor(signal, "tanh", SGN)


def _short(name: str) -> str:
    """component.variable -> variable"""
    return name.split(".", 1)[1]


def _follows(k: Local, angle: str, speed: str) -> bool:
    """Whether the angle is the speed's integral in this run."""
    phi, w = k.signals[angle], k.signals[speed]
    travelled = np.concatenate([[0.0], np.cumsum(np.diff(k.time) * (w[1:] + w[:-1]) / 2)])
    return bool(np.abs(phi - phi[0] - travelled).max() < FOLLOWS * np.ptp(phi))
