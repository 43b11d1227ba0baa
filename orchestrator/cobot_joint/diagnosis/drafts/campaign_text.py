"""A first campaign.toml, ready to run: columns guessed onto connectors, and every guess marked as one."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.quantity import convert
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.errors import UserError

ALIKE = 0.5  # of two names, from which one may stand for the other
# what people call things, in the words that connectors are named with
WORDS = {
    "soll": "command", "set": "command", "target": "command", "goal": "command", "bremse": "brake", "mot": "motor",
    "speed": "w", "velocity": "w", "drehzahl": "w", "n": "w", "omega": "w", "angle": "phi", "position": "phi",
    "pos": "phi", "torque": "tau", "moment": "tau", "drehmoment": "tau", "m": "tau", "current": "i", "strom": "i",
    "voltage": "v", "spannung": "v", "u": "v", "ab": "sensor", "last": "load",
}  # fmt: skip


@dataclass(frozen=True)
class Guess:
    """A column for a connector, and why."""

    column: Channel
    connector: str
    why: str  # nothing: no guess, it has the connector's name and a unit


@dataclass(frozen=True)
class Lacking:
    """A connector that nothing was found for. expected: a diagnosis asks for it unless a recording says otherwise."""

    connector: Connector
    expected: bool


def guess(channels: Sequence[Channel], connectors: Mapping[str, Connector], logged: Iterable[str] = ()) -> list[Guess]:
    """The likeliest pairs by unit and name, each column and connector once; logged: connectors that usually are."""
    usual = set(logged)
    pairs = []
    for channel in channels:
        fitting = [c for c in connectors.values() if _converts(channel.unit, c.unit)]
        for connector in fitting:
            likeness = _likeness(channel.name, connector.name)
            only = channel.unit is not None and len(fitting) == 1
            if likeness >= ALIKE or only:
                why = "by its name" if likeness >= ALIKE else "the only one in this unit"
                why += "" if channel.unit else f"; no unit is given, [{connector.unit or 1}] is taken"
                why = "" if channel.name == connector.name and channel.unit else why
                score = likeness + 0.2 * (connector.name in usual) + 0.3 * only + 0.1 * (channel.unit is not None)
                pairs.append((score, Guess(channel, connector.name, why)))
    chosen: dict[str, Guess] = {}
    for _, candidate in sorted(pairs, key=lambda p: -p[0]):
        if candidate.connector not in chosen and candidate.column not in [g.column for g in chosen.values()]:
            chosen[candidate.connector] = candidate
    for candidate in _only_ones_left(channels, connectors, chosen):
        chosen[candidate.connector] = candidate
    return [chosen[name] for name in connectors if name in chosen]


def _only_ones_left(
    channels: Sequence[Channel], connectors: Mapping[str, Connector], chosen: Mapping[str, Guess]
) -> list[Guess]:
    """Of columns with a unit and connectors without a column, those that have nobody else."""
    columns = [c for c in channels if c.unit and c not in [g.column for g in chosen.values()]]
    left = [c for c in connectors.values() if c.name not in chosen and c.unit]
    fitting = {c.name: [column for column in columns if _converts(column.unit, c.unit)] for c in left}
    return [
        Guess(columns[0], name, "the only one left in this unit")
        for name, columns in fitting.items()
        if len(columns) == 1 and sum(columns[0] in others for others in fitting.values()) == 1
    ]


def _converts(unit: str | None, target: str | None) -> bool:
    if unit is None or target is None:
        return True
    try:
        convert(np.zeros(1), unit, target, "")
    except UserError:
        return False
    return True


def _likeness(column: str, connector: str) -> float:
    a, b = (" ".join(WORDS.get(w, w) for w in re.findall(r"[a-z]+", name.lower())) for name in (column, connector))
    return difflib.SequenceMatcher(None, a, b).ratio()


def campaign_text(
    title: str,
    system: str,
    files: Sequence[str],
    guesses: Sequence[Guess],
    lacking: Sequence[Lacking],
    tolerances: Mapping[str, str] | None = None,
    given: Mapping[str, str] | None = None,
) -> str:
    """campaign.toml with its guesses marked. tolerances: as TOML. given: further keys of recordings."""
    lines = [f"title = {_quoted(title)}", f"system = {_quoted(system)}", ""]
    lines += ["[channels]   # column -> connector of the system; look at every line that says guess"]
    for g in guesses:
        header = g.column.name + (f" [{g.column.unit}]" if g.column.unit else "")
        lines.append(f"{_quoted(header)} = {_quoted(g.connector)}" + (f"   # guess: {g.why}" if g.why else ""))
    for c in (each.connector for each in lacking):
        lines.append(f'# "COLUMN" = {_quoted(c.name)}   # {c.causality} [{c.unit or "1"}]: no column was found')
    if tolerances:
        lines += ["", "[tolerances]   # how far a healthy parameter may be off; guess: the data sheet knows better"]
        lines += [f"{_quoted(name)} = {tolerance}" for name, tolerance in tolerances.items()]
    expected = ", ".join(_quoted(each.connector.name) for each in lacking if each.expected)
    for k, file in enumerate(files):
        role = "holdout" if k == len(files) - 1 > 0 else "train"
        lines += ["", "[[recording]]", f"file = {_quoted(file)}"]
        lines += [f"{key} = {_quoted(value)}" for key, value in (given or {}).items()]
        if role == "holdout":
            lines.append('role = "holdout"   # guess: the last is held out, scored and never fitted')
        if expected:
            lines.append(f"without = [{expected}]   # guess: they were not recorded")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
