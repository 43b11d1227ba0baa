"""A drive that is commanded a current: of a log without a set value, the measured one is what went in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.quantity import convert
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import (
    PERCENT,
    Guess,
    Nominal,
    Rated,
    converts,
    header_of,
    is_command,
    is_torque,
    names_a_part,
    with_named_unit,
)
from cobot_joint.diagnosis.drafts.chain import FORWARD
from cobot_joint.system.model import Component, System
from cobot_joint.system.shafts import RATIO
from cobot_joint.system.wiring import CURRENT_MODE, shown_by

MOTOR = "motor_bldc"  # unit
NEAR = 1.35  # within which a factor is taken for a gear's


def with_commanded_current(system: System, guesses: Sequence[Guess], channels: Sequence[Channel]) -> list[Guess]:
    """The guesses, and a column in A or N.m for the set value of a drive in current mode that has none: a set value
    before a measured current, which goes in only where something else is left to be compared. And a torque that names
    no part for the current that nobody logged: the drive takes it from that."""
    found = list(guesses)
    channels = [with_named_unit(c, [Connector("", "input", unit) for unit in ("A", "N.m")]) for c in channels]
    for name, motor in _commands(system).items():
        k_i, k = _value(motor, "drive.k_i") or 1.0, _value(motor, "winding.k")
        currents = [c for c in channels if c.unit and converts(c.unit, "A")]
        torques = _torques(channels, found) if k else []
        shown = _shown(system, motor)
        if shown and shown not in {g.connector for g in found}:
            told = [c for c in torques if not is_command(c.name) and not names_a_part(c.name)][:1]
            why = f"a torque of {motor.name} in current mode, over its torque constant"
            found += [Guess(column, shown, why, f"{1 / k:g} A/(N.m)") for column in told]
        if name in {g.connector for g in found}:
            continue
        used = {g.column.name for g in found}
        asked = [c for c in (*currents, *torques) if is_command(c.name)]
        measured = [c for c in (*currents, *torques) if c.name in used and len(found) > 1]
        for column in (asked or measured)[:1]:
            found = [g for g in found if g.column.name != column.name]
            what = "its set value" if asked else "no set value is logged, so that what it gives is what went in"
            scale = f"{1 / k_i:g} V/A"
            if column in torques:
                N = _behind_gear(system, column, next((g.column for g in found if g.connector == shown), None), k)
                scale = f"{1 / (k * k_i * N):g} V/(N.m)"
                what += f", {N:.6g} times the motor's by its current" if N != 1 else _if_behind(system, k * k_i)
            found.append(Guess(column, name, f"{motor.name} is in current mode; {what}", scale))
    return found


def percent_of_drive(
    system: System, guesses: Sequence[Guess], channels: Sequence[Channel], known: Mapping[str, Rated]
) -> dict[str, Rated]:
    """With columns in % of a torque that are nothing else: the set value of a drive in current mode, its current; where
    no set value was logged, what was measured is what went in."""
    found, taken = dict(known), {g.connector for g in guesses} | {r.connector.name for r in known.values()}
    used = {g.column.name for g in guesses}
    commands = _commands(system)
    behind_loops = [("", c) for c in _drives(system).values() if c not in commands.values()]  # told by no input
    for name, motor in (*commands.items(), *behind_loops):
        k_i, k, shown = _value(motor, "drive.k_i") or 1.0, _value(motor, "winding.k"), _shown(system, motor)
        for column in (c for c in channels if c.unit in PERCENT and is_torque(c.name) and c.name not in used):
            went_in = name not in {"", *taken} and not any(is_command(c.name) and is_torque(c.name) for c in channels)
            asked = is_command(column.name) or went_in
            connector = Connector(name, "input", "V") if asked else Connector(shown, "output", "A")
            if header_of(column) in found or not connector.name or connector.name in taken or names_a_part(column.name):
                continue
            taken.add(connector.name)
            hint = f"; 1 {connector.unit} is a torque of {k * (k_i if asked else 1):g} N.m"
            found[header_of(column)] = Rated(connector, hint)
    return found


def _behind_gear(system: System, torque: Channel, current: Channel | None, k: float) -> float:
    """How many times the motor's torque a column is, by the current that was measured beside it: a robot's controller
    asks for the joint's, behind the gear. 1: as the motor's, or no current tells."""
    if current is None or not (current.unit and converts(current.unit, "A")) or not np.ptp(torque.values) > 0:
        return 1.0
    amperes, _ = convert(current.values, current.unit, "A", current.name)
    newton_metres, _ = convert(torque.values, torque.unit, "N.m", torque.name)
    x, y = newton_metres - np.nanmean(newton_metres), np.interp(torque.time, current.time, amperes)
    known = np.isfinite(x) & np.isfinite(y)
    times = 1 / (k * abs(float(x[known] @ y[known]) / float(x[known] @ x[known]) or np.inf))
    near = [N for N in _ratios(system) if abs(np.log(times / N)) < min(np.log(NEAR), abs(np.log(times)))]
    return near[0] if near else 1.0


def _if_behind(system: System, k: float) -> str:
    """What a torque's scale is where it is that of the joint, in words; nothing: there is no gear."""
    others = [f"{1 / (k * N):g} V/(N.m)" for N in _ratios(system)]
    return f"; if it is the torque behind the gear, {' or '.join(others)}" if others else ""


def _ratios(system: System) -> list[float]:
    """Of gears that step down, without signs."""
    gears = [c for c in system.components if RATIO in c.unit.variables]
    ratios = [abs(float(c.parameters.get(RATIO, c.unit.variables[RATIO].start) or 0.0)) for c in gears]
    return [N for N in ratios if N > 1]


def _torques(channels: Sequence[Channel], found: Sequence[Guess]) -> list[Channel]:
    """Columns that no guess uses, of a torque by unit and name."""
    used = {g.column.name for g in found}
    return [c for c in channels if c.unit and c.name not in used and converts(c.unit, "N.m") and is_torque(c.name)]


def _shown(system: System, motor: Component) -> str:
    """The system's output that is the motor's current; "": none is."""
    return next((name for name, shown in shown_by(system).items() if shown == f"{motor.name}.i"), "")


def _value(motor: Component, parameter: str) -> float:
    return float(motor.parameters.get(parameter, motor.unit.variables[parameter].start) or 0.0)


def nominal_beside(system: System, guesses: Sequence[Guess]) -> dict[str, Nominal]:
    """`component.parameter` -> nominal value of a drive whose measured current goes in: that is what flows, so its loop
    loses none of it to the back-EMF, which would act as an inertia of k^2/(R w_c). Nothing where that is so already."""
    commands = _commands(system)
    given = {g.connector for g in guesses if g.connector in commands and not is_command(g.column.name)}
    drives = [commands[name] for name in given]
    all_of_it = Nominal(1.0, "a measured current is what flows, whatever the drive's loop does")
    return {f"{drive.name}.{FORWARD}": all_of_it for drive in drives if _value(drive, FORWARD) != 1.0}


def _commands(system: System) -> dict[str, Component]:
    """Inputs of the system that are set values of drives in current mode, and whose."""
    drives = _drives(system)
    return {
        wire.source: drives[wire.sink_component]
        for wire in system.connections
        if wire.source_component is None
        and wire.sink_component in drives
        and drives[wire.sink_component].unit.unit_of(wire.sink) == "V"
    }


def _drives(system: System) -> dict[str, Component]:
    """Motors whose drive is in current mode, by name."""
    motors = [c for c in system.components if c.unit.name == MOTOR]
    return {c.name: c for c in motors if c.parameters.get("drive.mode") == CURRENT_MODE}
