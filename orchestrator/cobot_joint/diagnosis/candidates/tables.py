"""The shape of an unlisted effect where no formula holds: piecewise linear over one of the component's own signals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cobot_joint.diagnosis.candidates.formulas import Dictionary, Local, sign
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.port_response import Choice, Column, respond_if_promising
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.estimation.projection import Projection
from cobot_joint.diagnosis.plant.correction import TIME
from cobot_joint.diagnosis.plant.plant import Port

COARSELY = 0.8  # of what a table has to take, that it has to take with few knots, and in the recordings one by one
COARSE, FINE = 9, 25  # knots with which arguments compete, and of the one that wins
ENOUGH = 0.97  # of what is above noise, from which on no further argument is tried
KEPT = 0.99  # of the gain, that the smoothest table must keep
SMALL = 1e-3  # of what a table takes, that its size costs: what the re-fit can do is left to the re-fit
TURN = 2 * np.pi
PASSES = 3.0  # over the same way in every run (there, back, there), from which on a place on it is told from a time


@dataclass(frozen=True)
class Argument:
    """What a table is over: knots of a signal (or of the time, `t`), modulo a period if that is not 0, times a sign."""

    signal: str
    knots: Vector
    period: float = 0.0
    direction: str = ""  # the signal whose sign multiplies the table, or none

    def hats(self, k: Local) -> list[Vector]:
        """Piecewise linear functions, 1 at one knot and 0 at the others: (n,) each. The ends of a period are one."""
        u = k.time if self.signal == TIME else k.signals[self.signal]
        u = np.mod(u, self.period) if self.period else u
        hats = [np.interp(u, self.knots, row) for row in np.eye(len(self.knots))]
        if self.period:
            hats[0] = hats[0] + hats.pop()
        direction = sign(self.direction).of(k.signals[self.direction]) if self.direction else 1.0
        return [direction * hat for hat in hats]

    @property
    def signals(self) -> tuple[str, ...]:
        """That it depends on, the time not among them."""
        return tuple(name for name in dict.fromkeys((self.signal, self.direction)) if name not in ("", TIME))


@dataclass(frozen=True)
class Table:
    """An argument and the port's value at its knots, (n,)."""

    argument: Argument
    values: Vector
    choice: Choice[str]  # of one feature: the table, whose size is free


Arguments = Callable[[Dictionary, int], list[Argument]]


def look_for_table(
    problem: Problem,
    start: Fit,
    ports: Sequence[Port],
    say: Callable[[str], None],
    arguments: Arguments,
    worth: float = 0.0,
) -> Table | None:
    """The table that takes most at any of the ports; None: no signal there moves, or none takes this share of what is
    above noise. arguments: `over_any` or one of those that it consists of."""
    above = problem.above(start.residual)
    outputs = problem.outputs(start.run, list(dict.fromkeys(s for port in ports for s in port.signals)))
    best: tuple[float, Dictionary, int] | None = None
    for port in ports:
        say(f"tables at {port.name}")
        dictionary = Dictionary(problem, start, port, outputs)
        for number, argument in enumerate(arguments(dictionary, COARSE)):
            if best is not None and best[0] >= ENOUGH * above:
                break
            table = _fitted(problem, start, dictionary, argument, COARSELY * worth)
            if table is not None and (best is None or table.choice.gain > best[0]):
                best = table.choice.gain, dictionary, number
    if best is None:
        return None
    _, dictionary, number = best
    finest = _fitted(problem, start, dictionary, arguments(dictionary, FINE)[number], COARSELY * worth)
    return finest if finest is not None and finest.choice.gain >= worth * above else None


def over_speed(dictionary: Dictionary, count: int) -> list[Argument]:
    """The unit's own speed."""
    return _over(dictionary, [dictionary.speed] if dictionary.speed else [], count)


def over_motion(dictionary: Dictionary, count: int) -> list[Argument]:
    """The unit's own speed, and the place of what goes to and fro: a nut may be worn on half of its way."""
    return over_speed(dictionary, count) + over_place(dictionary, count)


def over_place(dictionary: Dictionary, count: int) -> list[Argument]:
    """Angles that are passed to and fro, from the first place to the last, with the sign of their speed."""
    moved = {angle: [k.signals[angle] for k in dictionary.locals.values()] for angle in dictionary.speeds}
    again = [a for a, runs in moved.items() if all(_path(u) >= PASSES * np.ptp(u) for u in runs if np.ptp(u) > 0)]
    ends = {a: (min(u.min() for u in moved[a]), max(u.max() for u in moved[a])) for a in again}
    return [Argument(a, np.linspace(*ends[a], count), 0.0, dictionary.speeds[a]) for a in again if np.ptp(ends[a]) > 0]


def _path(angle: Vector) -> float:
    """Length of the way, there and back."""
    return float(np.sum(np.abs(np.diff(angle))))


def over_any(dictionary: Dictionary, count: int) -> list[Argument]:
    """Speed, place, loads, angles over a turn, time; the latter two also with the sign of the speed."""
    locals_ = list(dictionary.locals.values())
    directions = ["", *([dictionary.speed] if dictionary.speed else [])]
    found = over_motion(dictionary, count) + _over(dictionary, dictionary.loads, count)
    for name in (a for a in dictionary.angles if dictionary.reach(a) > TURN / 2):
        found += [Argument(name, np.linspace(0, TURN, count), TURN, d) for d in directions]
    end = max(float(k.time[-1]) for k in locals_)
    return found + [Argument(TIME, np.linspace(0, end, count), 0.0, d) for d in directions]


def _over(dictionary: Dictionary, names: Sequence[str], count: int) -> list[Argument]:
    """Signals as far as they move."""
    found = []
    for name in names:
        u = np.concatenate([k.signals[name] for k in dictionary.locals.values()])
        if np.ptp(u) > 0:
            found.append(Argument(name, np.linspace(u.min(), u.max(), count)))
    return found


def _fitted(problem: Problem, start: Fit, dictionary: Dictionary, argument: Argument, least: float) -> Table | None:
    """As smooth as it can be without losing more than a little of what it takes. None: the port answers to nothing, or
    takes less than that share of what is above noise in the recordings one by one."""
    hats = {recording: argument.hats(k) for recording, k in dictionary.locals.items()}
    count = len(next(iter(hats.values())))
    features = {k: {r: h[k] for r, h in hats.items()} for k in range(count)}
    moving = {k: v for k, v in features.items() if any(np.any(x != 0) for x in v.values())}
    columns = respond_if_promising(problem, start, dictionary.port, moving, least, least)
    if not columns:
        return None
    gain, coefficients = _smoothest(Projection(start, [c.vector for c in columns]), columns)
    at_knots = dict(zip((c.form for c in columns), coefficients, strict=True))
    values = np.array([at_knots.get(k, 0.0) for k in features])
    if argument.period:
        values = np.append(values, values[0])
    named = [Column(c.port, f"{argument.signal} at knot {c.form}", c.values, c.vector) for c in columns]
    return Table(argument, values, Choice(tuple(named), coefficients, gain).summed(f"table over {argument.signal}"))


def _smoothest(squares: Projection, columns: Sequence[Column[int]]) -> tuple[float, Vector]:
    """(chi-square taken, values at the knots) under the strongest penalty of second differences that costs little."""
    every = list(range(len(columns)))
    rough = np.diff(np.eye(len(columns)), 2, axis=0)  # second differences; those across a period's ends stay free
    size = float(np.mean([c.vector @ c.vector for c in columns])) or 1.0
    small = SMALL * size * np.eye(len(columns))
    free, coefficients = squares.gain(every, small)
    gain = free
    for strength in np.geomspace(1e-6, 1e3, 19):
        smoother = squares.gain(every, small + strength * size * rough.T @ rough)
        if smoother[0] < KEPT * free:
            break
        gain, coefficients = smoother
    return gain, coefficients
