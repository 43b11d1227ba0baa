"""A drive that is commanded a current: of a log without a set value, the measured one is what went in."""

from __future__ import annotations

from collections.abc import Sequence

from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import Guess, converts, is_command, with_named_unit
from cobot_joint.diagnosis.drafts.chain import CURRENT_MODE
from cobot_joint.system.model import Component, System

MOTOR = "motor_bldc"  # unit


def with_commanded_current(system: System, guesses: Sequence[Guess], channels: Sequence[Channel]) -> list[Guess]:
    """The guesses, and a column in A for the set value of a drive in current mode that has none: a set value before a
    measured one, which goes in only where something else is left to be compared."""
    found = list(guesses)
    channels = [with_named_unit(c, [Connector("", "input", "A")]) for c in channels]
    for name, motor in _commands(system).items():
        if name in {g.connector for g in found}:
            continue
        currents = [c for c in channels if c.unit and converts(c.unit, "A")]
        asked = [c for c in currents if is_command(c.name)]
        used = {g.column.name: g for g in found}
        measured = [c for c in currents if c.name in used and len(found) > 1]
        for column in (asked or measured)[:1]:
            found = [g for g in found if g.column.name != column.name]
            k_i = float(motor.parameters.get("drive.k_i", motor.unit.variables["drive.k_i"].start) or 1.0)
            what = "its set value" if asked else "no set value is logged, so that what it gives is what went in"
            found.append(Guess(column, name, f"{motor.name} is in current mode; {what}", f"{1 / k_i:g} V/A"))
    return found


def nominal_beside(system: System, guesses: Sequence[Guess]) -> dict[str, float]:
    """`component.parameter` -> nominal value of a drive whose measured current goes in: that is what flows, so its loop
    loses none of it to the back-EMF, which would act as an inertia of k^2/(R w_c)."""
    commands = _commands(system)
    given = {g.connector for g in guesses if g.connector in commands and not is_command(g.column.name)}
    return {f"{commands[name].name}.drive.decoupling": 1.0 for name in given}


def _commands(system: System) -> dict[str, Component]:
    """Inputs of the system that are set values of drives in current mode, and whose."""
    drives = {c.name: c for c in system.components if c.unit.name == MOTOR}
    return {
        wire.source: drives[wire.sink_component]
        for wire in system.connections
        if wire.source_component is None
        and wire.sink_component in drives
        and drives[wire.sink_component].unit.unit_of(wire.sink) == "V"
        and drives[wire.sink_component].parameters.get("drive.mode") == CURRENT_MODE
    }
