"""Columns without a unit whose name says what they are, as a robot's or a drive's log has them: `present_current`."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import UNITS, Guess, converts, is_command, quantity, with_named_unit

# fields of ROS messages, geometry_msgs and sensor_msgs: /odom/twist/twist/linear/x; their units by REP 103
FIELDS = {
    re.compile(rf"(^|[/._]){field}[/._][xyz]$"): unit
    for field, unit in {
        "linear": "m/s", "angular": "rad/s", "angular_velocity": "rad/s", "pose[/._]position": "m",
        "translation": "m", "force": "N", "torque": "N.m",
    }.items()
}  # fmt: skip
MOVES = 0.2  # of its largest value, that such a column goes at least


def with_assumed_units(
    columns: Sequence[Channel], connectors: Mapping[str, Connector], *, alone: bool = False
) -> list[Channel]:
    """With SI units of what the names say, where no column beside them gives a unit for that quantity. alone: only of
    those of which there is one, of a robot's joints none: nobody knows which is meant."""
    columns = [replace(c, unit=c.unit or _of_message(c)) for c in columns]
    known = [with_named_unit(c, connectors.values()).unit for c in columns]
    given = {q for q, unit in UNITS.items() if any(own and converts(own, unit) for own in known)}
    bare = [c for c, own in zip(columns, known, strict=True) if own is None]
    kinds = {c.name: (q, is_command(c.name)) for c in bare if (q := quantity(c.name)) and q not in given and moves(c)}
    count = Counter(kinds.values())
    assumed = {name: UNITS[kind[0]] for name, kind in kinds.items() if not alone or count[kind] == 1}
    return [replace(c, unit=assumed.get(c.name, c.unit)) for c in columns]


def _of_message(column: Channel) -> str | None:
    """Of a field of a ROS message that moves."""
    return next((unit for field, unit in FIELDS.items() if field.search(column.name) and moves(column)), None)


def said(guesses: Iterable[Guess], assumed: Sequence[Channel], columns: Sequence[Channel]) -> list[Guess]:
    """The guesses, with what was assumed of the columns' units."""
    units = {a.name: a.unit for a, c in zip(assumed, columns, strict=True) if a.unit != c.unit}
    why = "; no unit is given, [{}] is taken: write another between the brackets"
    return [replace(g, why=g.why + why.format(u)) if (u := units.get(g.column.name)) else g for g in guesses]


def moves(column: Channel) -> bool:
    """Not a supply's voltage, nor an idle joint's current."""
    x = column.values[np.isfinite(column.values)]
    return len(x) > 0 and bool(np.ptp(x) > MOVES * np.max(np.abs(x)))
