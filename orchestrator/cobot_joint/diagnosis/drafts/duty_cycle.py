"""A duty cycle for the voltage that nobody logged: of a bridge, on average the same share of its supply's voltage."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.quantity import convert, split_header
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import PERCENT, Guess, Nominal, converts, header_of
from cobot_joint.system.model import System

NAMED = {"pwm", "duty", "dutycycle"}
SUPPLIES = {"vbat", "vbus", "battery", "batt", "bat", "supply", "bus", "vin", "input", "dc", "vdc", "pack"}
FULL = (1.0, 100.0, 255.0, 1000.0, 1023.0, 4095.0, 32767.0, 65535.0)  # what a controller calls all of the supply
SUPPLY = "inverter.v_bus"


def with_duty_cycle(
    system: System, guesses: Sequence[Guess], connectors: Mapping[str, Connector], columns: Sequence[Channel]
) -> list[Guess]:
    """Where no column is the voltage that drives the system, and one is named as a duty cycle: that, times its supply's
    voltage where that is a column."""
    guessed, used = {g.connector for g in guesses if not _supply(g.column)}, {g.column.name for g in guesses}
    driven = [c for c in connectors.values() if c.causality == "input" and c.unit == "V" and c.name not in guessed]
    supplies = [float(c.parameters.get(SUPPLY, c.unit.variables[SUPPLY].start) or 0.0)
                for c in system.components if SUPPLY in c.unit.variables]  # fmt: skip
    named = [c for c in columns if NAMED & set(re.findall("[a-z]+", c.name.lower())) and c.name not in used]
    if not (len(driven) == len(supplies) == len(named) == 1):
        return list(guesses)
    (column,), (connector,), (v_bus,) = named, driven, supplies
    if column.unit not in (None, "1", *PERCENT):
        return list(guesses)
    largest = float(np.nanmax(np.abs(column.values), initial=0.0))
    full = next((n for n in FULL if largest <= n), None)
    if full is None:
        return list(guesses)
    share = 1.0 if column.unit in PERCENT else 1 / full
    at = "100 %" if column.unit in PERCENT else f"{full:g}"
    found = [supply for c in columns if (supply := _supply(c))]
    guesses = [g for g in guesses if g.connector != connector.name]
    if len(found) == 1:
        (supply,) = found
        why = f"by its name; {supply!r} is taken for its supply, all of it at {at}"
        scale = f"{share:.6g}" if share != 1 else ""
        return [*guesses, Guess(column, connector.name, why, scale, times=supply)]
    why = f"by its name; {v_bus:g} V at {at} is assumed"
    return [*guesses, Guess(column, connector.name, why, f"{share * v_bus:.6g} V")]


def supplied(system: System, guesses: Sequence[Guess], columns: Sequence[Channel]) -> dict[str, Nominal]:
    """`component.parameter` -> the highest voltage of a supply that was logged, where that is beyond the system's."""
    logged = {supply: c for c in columns if (supply := _supply(c))}
    highest = [
        float(np.nanmax(convert(logged[g.times].values, split_header(g.times)[1], "V", g.times)[0]))
        for g in guesses
        if g.times in logged
    ]
    known = [c for c in system.components if SUPPLY in c.unit.variables]
    if not highest or len(known) != 1:
        return {}
    (motor,) = known
    own = float(motor.parameters.get(SUPPLY, motor.unit.variables[SUPPLY].start) or 0.0)
    most = Nominal(float(f"{max(highest):.4g}"), "the highest voltage that its supply was logged at")
    return {f"{motor.name}.{SUPPLY}": most} if 0 < own < max(highest) else {}


def _supply(column: Channel) -> str:
    """The header of a column that is named as a supply's voltage, and is in volts; "": it is none."""
    words = re.findall("[a-z]+", column.name.lower())
    unit = column.unit or ("V" if {"voltage", "spannung"} & set(words) or words[-1:] == ["v"] else None)
    named = SUPPLIES & set(words) and unit is not None and converts(unit, "V") and np.isfinite(column.values).any()
    return header_of(replace(column, unit=unit)) if named else ""
