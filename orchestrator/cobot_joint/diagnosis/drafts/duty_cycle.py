"""A duty cycle for the voltage that nobody logged: of a bridge, on average the same share of its supply's voltage."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import PERCENT, Guess
from cobot_joint.system.model import System

NAMED = {"pwm", "duty", "dutycycle"}
FULL = (1.0, 100.0, 255.0, 1000.0, 1023.0, 4095.0, 32767.0, 65535.0)  # what a controller calls all of the supply
SUPPLY = "inverter.v_bus"


def with_duty_cycle(
    system: System, guesses: Sequence[Guess], connectors: Mapping[str, Connector], columns: Sequence[Channel]
) -> list[Guess]:
    """Where no column is the voltage that drives the system, and one is named as a duty cycle: that."""
    guessed, used = {g.connector for g in guesses}, {g.column.name for g in guesses}
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
    per_unit = v_bus if column.unit in PERCENT else v_bus / full
    at = "100 %" if column.unit in PERCENT else f"{full:g}"
    why = f"by its name; {v_bus:g} V at {at} is assumed"
    return [*guesses, Guess(column, connector.name, why, f"{per_unit:.6g} V")]
