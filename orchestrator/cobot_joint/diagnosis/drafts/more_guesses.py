"""Guesses that rest on more than a column's name and unit: on its samples, and on what else was logged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.conditioning import is_rate, quantisation_step
from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.parameters import imposed, place_of
from cobot_joint.diagnosis.data.quantity import convert
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import PERCENT, Guess, converts, fits, guess, header_of, with_named_unit
from cobot_joint.diagnosis.drafts.counted_speeds import with_counted_speeds
from cobot_joint.diagnosis.drafts.current_drive import with_commanded_current
from cobot_joint.diagnosis.drafts.duty_cycle import with_duty_cycle
from cobot_joint.diagnosis.drafts.without_units import said, with_assumed_units
from cobot_joint.system.model import System
from cobot_joint.system.wiring import read_by_loops, shown_by

JUMPS, ALONE = 5, 0.8  # of stairs: so many at least, and so large a share of them with a rest on either side
WIDE = 3.0  # converter's steps, that half of them are higher than: of what was measured slowly, they are as high as one
NOTHING = np.zeros(0)
SPEEDS, PLACES = ("rad/s", "m/s"), ("rad", "m")


def guesses_of(
    system: System, connectors: Mapping[str, Connector], logged: Iterable[str], logs: Sequence[Sequence[Channel]]
) -> list[Guess]:
    """For a system's own connectors, from the columns of the first log. logged: connectors that usually are."""
    columns = with_assumed_units(logs[0], connectors, alone=True)
    guesses = with_commanded_current(system, guess(columns, connectors, logged), columns)
    guesses = with_duty_cycle(system, guesses, connectors, columns)
    guesses += _driving(guesses, connectors, columns)
    guesses = _of_driven_shaft(system, guesses, columns)
    guesses = with_counted_speeds(system, _of_one_shaft(system, guesses, connectors), connectors, logs)
    return said(_with_held_values(guesses, connectors, logs), columns, logs[0])


def _driving(guesses: Sequence[Guess], connectors: Mapping[str, Connector], columns: Sequence[Channel]) -> list[Guess]:
    """The one column that can be the system's one input, where that has none: motion in, torque out. Not one in % of a
    rated value that nobody knows, nor what the machine did for what it was asked."""
    inputs = [c for c in connectors.values() if c.causality == "input" and c.unit]
    used = {g.column.name for g in guesses}
    if len(inputs) != 1 or inputs[0].name in {g.connector for g in guesses}:
        return []
    free = [c for c in columns if c.unit and c.unit not in PERCENT and c.name not in used]
    fitting = [c for c in free if fits(c, inputs[0])]
    return [Guess(c, inputs[0].name, "nothing else can drive the system") for c in fitting if len(fitting) == 1]


def _of_driven_shaft(system: System, guesses: Sequence[Guess], columns: Sequence[Channel]) -> list[Guess]:
    """A position of which the column that moves the system is the rate is that of the shaft that it moves."""
    found = list(guesses)
    for motion in (g for g in guesses if g.connector in imposed(system, {h.connector: NOTHING for h in guesses})):
        place = place_of(system, motion.connector)
        angle = next((c for c in columns if place and c is not motion.column and _is_rate_of(motion.column, c)), None)
        if angle is not None:
            found = [g for g in found if g.column.name != angle.name]
            found.append(Guess(angle, place, f"{header_of(motion.column)!r}, which moves it, is its rate"))
    return found


def _of_one_shaft(system: System, guesses: Sequence[Guess], connectors: Mapping[str, Connector]) -> list[Guess]:
    """A speed that is the rate of a column that was guessed to be a shaft's angle is that shaft's."""
    shown = shown_by(system)
    owner = {name: shown[name].split(".")[0] for name in connectors if name in shown}
    found = list(guesses)
    for angle in (g for g in guesses if g.connector in owner and connectors[g.connector].unit in PLACES):
        for k, speed in enumerate(found):
            is_other = owner.get(speed.connector) not in (None, owner[angle.connector])
            if not is_other or connectors[speed.connector].unit not in SPEEDS:
                continue
            taken = {g.connector for g in found}
            free = [n for n, c in connectors.items()
                    if n not in taken and c.unit in SPEEDS and owner.get(n) == owner[angle.connector]]  # fmt: skip
            if free and _is_rate_of(speed.column, angle.column):
                why = f"it is the rate of {header_of(angle.column)!r}"
                found[k] = replace(speed, connector=free[0], why=why)
    return found


def _is_rate_of(speed: Channel, angle: Channel) -> bool:
    """Whether the angle is the speed's integral."""
    w, phi = (_in_base_units(c) for c in (speed, angle))
    return w is not None and phi is not None and is_rate(w, np.interp(speed.time, angle.time, phi), speed.time)


def _in_base_units(column: Channel) -> NDArray[np.float64] | None:
    """In rad, m or their rates; None: it has another unit, or none."""
    for unit in (*SPEEDS, *PLACES):
        if column.unit and converts(column.unit, unit):
            return convert(column.values, column.unit, unit, column.name)[0]
    return None


def _with_held_values(
    guesses: Sequence[Guess], connectors: Mapping[str, Connector], logs: Iterable[Sequence[Channel]]
) -> list[Guess]:
    """Inputs that are stairs in some log hold their values: drawn as lines, they would rise before they were asked to.
    logs: their columns."""
    stairs = {c.name for columns in logs for c in columns if is_stairs(c.values)}
    why = "its samples repeat, as values do that hold until the next one"
    return [
        replace(g, hold=True, why=f"{g.why}; {why}" if g.why else why)
        if g.column.name in stairs and g.connector in connectors and connectors[g.connector].causality == "input"
        else g
        for g in guesses
    ]


def is_stairs(x: NDArray[np.float64]) -> bool:
    """Whether a channel jumps from value to value and rests in between: (n,)"""
    change = np.abs(np.diff(x[np.isfinite(x)]))
    jumps = np.flatnonzero(change[1:-1]) + 1
    if len(jumps) < JUMPS:
        return False
    alone = (change[jumps - 1] == 0) & (change[jumps + 1] == 0)
    return bool(np.mean(alone) >= ALONE and np.median(change[jumps]) > WIDE * quantisation_step(x[np.isfinite(x)]))


def with_rates(
    system: System,
    guesses: Sequence[Guess],
    connectors: Mapping[str, Connector],
    left: Mapping[str, Sequence[str]],
    channels: Iterable[Channel],
) -> list[Guess]:
    """A column that is the rate of a position that was guessed is the speed of that part, where the part has one more:
    a carriage's. connectors, left: as in `with_only_place`."""
    shown = shown_by(system)
    places = {shown.get(g.connector, g.connector).split(".")[0]: g for g in guesses
              if g.connector in connectors and connectors[g.connector].unit in PLACES}  # fmt: skip
    found, by_header = list(guesses), {header_of(c): c for c in channels}
    for header, names in left.items():
        own = [n for n in names if n.split(".")[0] in places and connectors[n].causality == "output"]
        own = [n for n in own if connectors[n].unit in SPEEDS]
        place = places[own[0].split(".")[0]] if len(own) == 1 else None
        if place is not None and header in by_header and _is_rate_of(by_header[header], place.column):
            found.append(Guess(by_header[header], own[0], f"it is the rate of {header_of(place.column)!r}"))
    return found


def with_only_place(
    system: System,
    guesses: Sequence[Guess],
    connectors: Mapping[str, Connector],
    left: Mapping[str, Sequence[str]],
    channels: Iterable[Channel],
) -> list[Guess]:
    """Where no motion was guessed, and one column can be the angle or way of one shaft alone, or of the one that a loop
    reads: that; else the one column that can be the speed of one part alone. Without motion, hardly a friction could be
    told.

    connectors: those of the system and of its components; left: column that is not used -> what it could be.
    """
    if any(connectors[g.connector].unit in (*SPEEDS, *PLACES) for g in guesses if _is_output(connectors, g.connector)):
        return list(guesses)
    loops = {name.split(".")[0] for name in read_by_loops(system)}
    read = {f"{w.source_component}.{w.source}" for w in system.connections if w.sink_component in loops}
    named = {header_of(c): c for c in (with_named_unit(c, connectors.values()) for c in channels)}
    for units, why in ((PLACES, "no speed was recorded, and "), (SPEEDS, "")):
        fitting = {
            header: [n for n in names if _is_output(connectors, n) and connectors[n].unit in units]
            for header, names in left.items()
        }
        found = [(header, names) for header, names in fitting.items() if names]
        if len(found) != 1 or found[0][0] not in named:
            continue
        ((header, names),) = found
        own = names if len(names) == 1 else [n for n in names if n in read]
        if len(own) == 1:
            reason = "nothing else can be this" if len(names) == 1 else "this is what the loop reads"
            return [*guesses, Guess(named[header], own[0], why + reason)]
    return list(guesses)


def _is_output(connectors: Mapping[str, Connector], name: str) -> bool:
    return name in connectors and connectors[name].causality == "output"
