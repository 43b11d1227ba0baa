"""Where a draft's simulation begins: at the position and speed that a log begins at, all shafts that turn with it as
well."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.conditioning import begins_apart
from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.parameters import first_sample
from cobot_joint.diagnosis.drafts.campaign_text import Guess
from cobot_joint.system.model import System
from cobot_joint.system.shafts import angles_with, speeds_with
from cobot_joint.system.wiring import shown_by


def starts(system: System, guesses: Sequence[Guess], logs: Sequence[Sequence[Channel]] = ()) -> dict[str, str]:
    """`component.state` -> its start in words, of positions whose log begins elsewhere than at 0: a way, or the one
    angle that was logged, with the angles of all that turns with it. Gravity on an arm goes by where it is, and a shaft
    that began elsewhere than the next would be wound up. Of two angles nobody knows whether they count from one zero.
    logs: columns of the further logs: in one of them it may begin elsewhere.
    """
    shown = shown_by(system)
    units = {c.name: c.unit for c in system.components}
    places: dict[str, list[tuple[str, str]]] = {"m": [], "rad": []}
    for g in guesses:
        name = shown.get(g.connector, g.connector)
        component, _, variable = name.partition(".")
        unit = units[component].unit_of(variable) if component in units else None
        if unit in places and units[component].variables[variable].causality == "output":
            places[unit].append((name, g.connector))
    columns = {g.connector: g.column for g in guesses}
    found: dict[str, str] = {}
    for name, connector in places["m"] + (places["rad"] if len(places["rad"]) == 1 else []):
        if any(begins_apart(x, 0.0) is not None for x in _everywhere(columns[connector], logs)):
            found |= {angle: first_sample(connector, times) for angle, times in angles_with(system, name).items()}
    return found | _in_motion(system, guesses, logs)


def _everywhere(column: Channel, logs: Sequence[Sequence[Channel]]) -> list[NDArray[np.float64]]:
    """What a column holds in every log."""
    return [column.values, *(c.values for log in logs for c in log if c.name == column.name)]


def _in_motion(system: System, guesses: Sequence[Guess], logs: Sequence[Sequence[Channel]]) -> dict[str, str]:
    """Speeds of shafts in whose log one turns from the beginning on: left at rest there, a wheel of little friction is
    as far off at the end. Of two logged speeds the first starts what turns with it."""
    found: dict[str, str] = {}
    for g in guesses:
        states = speeds_with(system, g.connector)
        if states and any(begins_apart(x, 0.0) is not None for x in _everywhere(g.column, logs)):
            found = {state: first_sample(g.connector, times) for state, times in states.items()} | found
    return found
