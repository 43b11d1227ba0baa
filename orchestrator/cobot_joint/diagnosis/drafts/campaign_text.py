"""A first campaign.toml, ready to run: columns guessed onto connectors, and every guess marked as one."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.quantity import convert, is_unit, split_header
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import System
from cobot_joint.system.wiring import shown_by

COMMAND, ACTUAL, ERROR = "command", "actual", "e"
ALIKE = 0.5  # of two names, from which one may stand for the other
# what people call things, in the words that connectors are named with
WORDS = {
    "cmd": COMMAND, "demand": COMMAND, "goal": COMMAND, "ref": COMMAND, "reference": COMMAND, "set": COMMAND,
    "setpoint": COMMAND, "soll": COMMAND, "target": COMMAND, "des": COMMAND, "desired": COMMAND,
    "act": ACTUAL, "fb": ACTUAL, "feedback": ACTUAL, "ist": ACTUAL, "meas": ACTUAL, "measured": ACTUAL,
    "error": ERROR, "err": ERROR, "lag": ERROR, "deviation": ERROR, "abweichung": ERROR, "schleppfehler": ERROR,
    "bremse": "brake", "mot": "motor",
    "speed": "w", "velocity": "w", "n": "w", "omega": "w", "angle": "phi", "position": "phi",
    "pos": "phi", "lage": "phi", "positions": "phi", "winkel": "phi", "geschwindigkeit": "w", "geschwindigkeits": "w",
    "drehzahl": "w", "vel": "w", "spd": "w", "torque": "tau", "trq": "tau", "moment": "tau", "drehmoment": "tau",
    "m": "tau", "current": "i", "iq": "i", "strom": "i",
    "voltage": "v", "spannung": "v", "u": "v", "ab": "sensor", "last": "load", "gyro": "load", "imu": "load",
    "drum": "load", "table": "load", "turntable": "load", "wheel": "load", "carriage": "load", "slide": "load",
}  # fmt: skip
# units at the end of a name, as identifiers have them: `n_rpm`
SUFFIXES = {
    "rpm": "rpm", "rad": "rad", "mrad": "mrad", "deg": "deg", "rad_s": "rad/s", "rads": "rad/s", "radps": "rad/s",
    "deg_s": "deg/s", "degs": "deg/s", "dps": "deg/s", "nm": "N.m", "mnm": "mN.m", "ncm": "N.cm", "mA": "mA",
    "mV": "mV", "mm": "mm", "um": "um", "mm_s": "mm/s", "degc": "degC",
}  # fmt: skip
# words that say what a column is, not whose
QUANTITIES = {COMMAND, ACTUAL, "w", "phi", "tau", "i", "v", "s", "value", "wert"}
WORDED = {"A": "i", "V": "v"}  # at the end of the name of such a quantity: `motor_current_A`, not `phase_A`
PERCENT = ("%", "percent", "0.1 %", "0.1%", "‰", "permille")  # of a rated value
# of what a name may say, of several the first: a `torque_current` is a current
UNITS = {"i": "A", "v": "V", "tau": "N.m", "w": "rad/s", "phi": "rad"}
RATES = {"qd": "w", "dq": "w", "qdot": "w", "q": "phi"}  # of joint angles, as robots' controllers write them
# in a compound, which German writes in one word: Sollposition, Positionssollwert, Istdrehzahl, Stromistwert
GERMAN = re.compile(r"(soll|ist)wert|(?:^|(?<=[\W_]))(soll|ist)(?=[a-z])")
IN_WORDS = re.compile(r"\((?!\d+\))(?P<bracket>[^()]+)\)$|\s(?:in\s|/\s)(?P<word>\S+)$")


@dataclass(frozen=True)
class Guess:
    """A column for a connector, and why."""

    column: Channel
    connector: str
    why: str  # nothing: no guess, it has the connector's name and a unit
    scale: str = ""  # connector's unit per column's, where these do not convert
    hold: bool = False  # whether its values hold until the next one
    mean: bool = False  # whether they are means since the one before
    times: str = ""  # another column that it is multiplied by


@dataclass(frozen=True)
class Lacking:
    """A connector that nothing was found for. expected: a diagnosis asks for it unless a recording says otherwise."""

    connector: Connector
    expected: bool


@dataclass(frozen=True)
class Rated:
    """What a column in % of a rated value could be, or one in counts. hint: what that value is in the connector's unit,
    in words. whole: what the value is of."""

    connector: Connector
    hint: str = ""
    whole: str = "what 100 % of it is"


@dataclass(frozen=True)
class Nominal:
    """A parameter's value in place of the system's, and why."""

    value: float
    why: str


@dataclass(frozen=True)
class Columns:
    """What a log's columns are to a system, and which of its connectors have none."""

    guesses: Sequence[Guess]
    lacking: Sequence[Lacking] = ()
    left: Mapping[str, Sequence[str]] = field(default_factory=dict)  # column that is not used -> what it could be
    percent: Mapping[str, Rated] = field(default_factory=dict)  # column in % that is not used -> what it could be
    unusable: Mapping[str, str] = field(default_factory=dict)  # column -> why
    nominal: Mapping[str, Nominal] = field(default_factory=dict)  # `component.parameter` -> what follows from them
    starts: Mapping[str, str] = field(default_factory=dict)  # `component.variable` -> its start, in words


@dataclass(frozen=True)
class Entry:
    """A [[recording]]. given: its further keys. why: what of it is a guess."""

    files: Sequence[str]
    role: str = "train"
    given: Mapping[str, str | int] = field(default_factory=dict)
    why: str = ""


def one_each(files: Sequence[str], given: Mapping[str, str | int] | None = None) -> list[Entry]:
    """An entry per file, the last of several held out."""
    entries = [Entry([file], given=given or {}) for file in files]
    if len(entries) > 1:
        entries[-1] = replace(entries[-1], role="holdout", why="guess: the last is held out, scored and never fitted")
    return entries


def is_command(name: str) -> bool:
    """Whether a column is a set value, by its name: what was asked of the machine, not what it did."""
    return COMMAND in _words(name)


def is_actual(name: str) -> bool:
    """Whether a column is what the machine did, by its name, not what was asked of it."""
    return ACTUAL in _words(name)


def with_named_unit(column: Channel, connectors: Iterable[Connector]) -> Channel:
    """With the unit that its name ends with, or is, where its header has none and a connector takes it: `n_rpm`,
    `rpm`, `torque (Nm)`, `speed in rad/s`."""
    names = "_" + column.name, "_" + column.name.lower()
    ends = [unit for suffix, unit in SUFFIXES.items() if any(name.endswith("_" + suffix) for name in names)]
    ends += [u for u, word in WORDED.items() if column.name.endswith(f"_{u}") and word in _words(column.name[:-2])]
    if words := IN_WORDS.search(column.name):
        ends.append(words["bracket"] or words["word"])
    fitting = (u for u in ends if is_unit(u) and any(c.unit and converts(u, c.unit) for c in connectors))
    unit = next(fitting, None) if column.unit is None else None
    return replace(column, unit=unit) if unit else column


def guess(channels: Sequence[Channel], connectors: Mapping[str, Connector], logged: Iterable[str] = ()) -> list[Guess]:
    """The likeliest pairs by unit and name, each column and connector once; logged: connectors that usually are."""
    usual, in_brackets = set(logged), {c.name for c in channels if c.unit}
    pairs = []
    channels = [with_named_unit(c, connectors.values()) for c in channels]
    for channel in channels:
        named = channel.unit and channel.name not in in_brackets
        fitting = [c for c in connectors.values() if fits(channel, c)]
        for connector in fitting:
            likeness = _likeness(channel.name, connector.name)
            only = channel.unit is not None and len(fitting) == 1
            if likeness >= ALIKE or only:
                others = [c.name for c in channels if c is not channel and c.unit and fits(c, connector)]
                by_unit = f"by its unit, as {among(others, 3)} could be" if others else "the only one in this unit"
                why = "by its name" if likeness >= ALIKE else by_unit
                why += "" if channel.unit else f"; no unit is given, [{connector.unit or 1}] is taken"
                why += "; its unit by its name" if named else ""
                why = "" if channel.name == connector.name and channel.unit else why
                score = likeness + 0.2 * (connector.name in usual) + 0.3 * only + 0.1 * (channel.unit is not None)
                pairs.append((score, Guess(channel, connector.name, why)))
    chosen: dict[str, Guess] = {}
    for _, candidate in sorted(pairs, key=lambda p: -p[0]):
        if candidate.connector not in chosen and candidate.column not in [g.column for g in chosen.values()]:
            chosen[candidate.connector] = candidate
    for candidate in _only_ones_left(channels, connectors, chosen):
        chosen[candidate.connector] = candidate
    for candidate in _motors_own(channels, connectors, chosen):
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
    fitting = {c.name: [column for column in columns if fits(column, c)] for c in left}
    return [
        Guess(columns[0], name, "the only one left in this unit")
        for name, columns in fitting.items()
        if len(columns) == 1 and sum(columns[0] in others for others in fitting.values()) == 1
    ]


def _motors_own(
    channels: Sequence[Channel], connectors: Mapping[str, Connector], chosen: Mapping[str, Guess]
) -> list[Guess]:
    """Of columns with a unit that are alone in it, or alone name no part of the machine, and fit several connectors
    without a column, that of the motor: a drive logs its own encoder, as "Velocity actual value"."""
    columns = [c for c in channels if c.unit and c not in [g.column for g in chosen.values()]]
    found = []
    for column in columns:
        fitting = [c for c in connectors.values() if c.name not in chosen and c.unit and fits(column, c)]
        own = [c.name for c in fitting if c.causality == "output" and "motor" in _words(c.name)]
        others = [c for c in columns if c is not column and converts(c.unit, column.unit)]
        nobodys = not names_a_part(column.name) and all(names_a_part(c.name) for c in others)
        if (not others or nobodys) and len(own) == 1 and len(fitting) > 1:
            could = among([c.name for c in fitting if c.name != own[0]], 3)
            found.append(Guess(column, own[0], f"the motor's, since a drive logs its own; it could be {could}"))
    return found


def names_a_part(name: str) -> bool:
    """Whether a column's name says whose it is."""
    return bool(_own_words(name))


def left_over(
    system: System, channels: Iterable[Channel], guesses: Sequence[Guess], offered: Iterable[Connector]
) -> dict[str, list[str]]:
    """Column that no guess uses -> connectors that it could be by its unit, else by its name; the likeliest first.

    Those of a unit of which a guessed column shows something else come before others, where the names share a word:
    `knee_angle` beside `knee_speed`. What adds to an angle is an error of it, not an angle."""
    used = {name for g in guesses for name in (g.column.name, split_header(g.times)[0])}
    taken = {g.connector for g in guesses}
    free = [c for c in offered if c.name not in taken and c.unit and not is_error_of_angle(c)]
    whose = {connector: name.split(".")[0] for connector, name in shown_by(system).items()}
    owners = [(whose[g.connector], _own_words(g.column.name)) for g in guesses if g.connector in whose]
    left = {}
    for channel in (with_named_unit(c, free) for c in channels):
        near = {owner for owner, words in owners if words & _own_words(channel.name)}
        alike = {
            c.name: _likeness(channel.name, c.name) + (c.name.split(".")[0] in near)
            for c in free
            if converts(channel.unit, c.unit)
            and not (c.causality == "output" and is_command(channel.name))
            and (ERROR in _words(channel.name)) == c.name.split(".")[-1].startswith("e_")
        }
        plain = channel.unit in (None, "1", *PERCENT)
        fitting = [n for n, likeness in alike.items() if not plain or likeness >= ALIKE]
        if channel.name not in used:
            left[header_of(channel)] = sorted(fitting, key=lambda n: -alike[n])
    return left


def in_percent(channels: Iterable[Channel], guesses: Sequence[Guess], offered: Iterable[Connector]) -> dict[str, Rated]:
    """Column in % that no guess uses -> the connector whose words its name has: of a rated torque, or current."""
    used, taken = {g.column.name for g in guesses}, {g.connector for g in guesses}
    free = [c for c in offered if c.name not in taken and c.unit]
    found = {}
    for channel in channels:
        named = [c for c in free if set(_words(c.name)) <= set(_words(channel.name))]
        if channel.unit in PERCENT and channel.name not in used and named:
            found[header_of(channel)] = Rated(max(named, key=lambda c: _likeness(channel.name, c.name)))
    return found


def is_error_of_angle(connector: Connector) -> bool:
    """Whether it is added to an angle."""
    return connector.name.endswith("_add") and connector.unit == "rad"


def is_torque(name: str) -> bool:
    """Whether a column is one, by its name."""
    return "tau" in _words(name)


def quantity(name: str) -> str:
    """i, v, tau, w or phi, by its words; letters alone only where they are all of it. "": it says none."""
    tokens = re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower())
    words = {WORDS.get(t, "") for t in tokens if len(t) > 1 or len(tokens) == 1} | {RATES.get(t, "") for t in tokens}
    return next((q for q in UNITS if q in words), "")


def _own_words(name: str) -> set[str]:
    """Those of a name that say whose it is, not what."""
    return set(_words(name)) - {*QUANTITIES, *SUFFIXES, *(unit.lower() for unit in WORDED)}


def header_of(column: Channel) -> str:
    """As a campaign names it."""
    return column.name + (f" [{column.unit}]" if column.unit else "")


def fits(column: Channel, connector: Connector) -> bool:
    """By its unit, and what was asked of the machine is not what it did, nor the other way round."""
    asked = connector.causality == "output" and is_command(column.name)
    done = connector.causality == "input" and is_command(connector.name) and is_actual(column.name)
    unit = column.unit or UNITS.get(quantity(column.name))
    return converts(unit, connector.unit) and not asked and not done


def converts(unit: str | None, target: str | None) -> bool:
    """Whether it may be the same quantity; where one is not given, too."""
    if unit is None or target is None:
        return True
    try:
        convert(np.zeros(1), unit, target, "")
    except UserError:
        return False
    return True


def _words(name: str) -> list[str]:
    """`PosCmd_1` -> phi, command; `Positionssollwert` -> phi, command"""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()
    apart = GERMAN.sub(lambda found: f" {found[1] or found[2]} ", apart)
    return [WORDS.get(word, word) for word in re.findall(r"[a-z]+", apart)]


def _likeness(column: str, connector: str) -> float:
    return difflib.SequenceMatcher(None, " ".join(_words(column)), " ".join(_words(connector))).ratio()


def campaign_text(
    title: str, system: str, entries: Sequence[Entry], columns: Columns, tolerances: Mapping[str, str] | None = None
) -> str:
    """campaign.toml with its guesses marked. tolerances: as TOML, "" for a parameter that is 0, after "# "
    where it is only offered."""
    lines = [f"title = {_quoted(title)}", f"system = {_quoted(system)}", "", *_channels(columns)]
    if columns.nominal:
        lines += ["", "[parameters]"]
        lines += [f"{_quoted(name)} = {n.value:g}   # guess: {n.why}" for name, n in columns.nominal.items()]
    if columns.starts:
        lines += ["", "[initial]   # guess: the simulation begins where the log does"]
        lines += [f"{_quoted(name)} = {_quoted(start)}" for name, start in columns.starts.items()]
    if tolerances:
        lines += ["", "[tolerances]   # how far a healthy parameter may be off; guess: the data sheet knows better"]
        lines += [_tolerance(name, tolerance) for name, tolerance in tolerances.items()]
    expected = ", ".join(_quoted(each.connector.name) for each in columns.lacking if each.expected)
    for entry in entries:
        lines += ["", "[[recording]]", *_recording(entry)]
        if expected:
            lines.append(f"without = [{expected}]   # guess: they were not recorded")
    return "\n".join(lines) + "\n"


def _recording(entry: Entry) -> list[str]:
    """The entry's lines, its last key with what of it is a guess."""
    several = ",\n        ".join(_quoted(file) for file in entry.files)
    lines = [f"file = [{several}]" if len(entry.files) > 1 else f"file = {several}"]
    lines += [f"{key} = {_toml(value)}" for key, value in entry.given.items()]
    lines += [f"role = {_quoted(entry.role)}"] if entry.role != "train" else []
    lines[-1] += f"   # {entry.why}" if entry.why else ""
    return lines


def _tolerance(name: str, tolerance: str) -> str:
    if tolerance.startswith("# "):
        return f"# {_quoted(name)} = {tolerance.removeprefix('# ')}"
    if tolerance:
        return f"{_quoted(name)} = {tolerance}"
    return f"# {_quoted(name)} = [0.0, MOST]   # it is 0 in the system: give a range if your machine has any"


def _channels(columns: Columns) -> list[str]:
    """Every column of the log and every connector, those without the other as comments."""
    lines = ["[channels]   # column -> connector of the system; look at every line that says guess"]
    for g in columns.guesses:
        why = f"   # guess: {g.why}" if g.why else ""
        more = ([f"scale = {_quoted(g.scale)}"] if g.scale else []) + (["hold = true"] if g.hold else [])
        more += ["mean = true"] if g.mean else []
        more += [f"times = {_quoted(g.times)}"] if g.times else []
        to = f"{{ {', '.join([f'to = {_quoted(g.connector)}', *more])} }}" if more else _quoted(g.connector)
        lines.append(f"{_quoted(header_of(g.column))} = {to}{why}")
    for c in (each.connector for each in columns.lacking):
        lines.append(f'# "COLUMN" = {_quoted(c.name)}   # {c.causality} [{c.unit or "1"}]: no column was found')
    for header, rated in columns.percent.items():
        to = f"{{ to = {_quoted(rated.connector.name)}, scale = {_quoted(f'RATED {rated.connector.unit}')} }}"
        why = f"not used: in place of RATED, {rated.whole}{rated.hint}"
        lines.append(f"# {_quoted(_line(header))} = {to}   # {why}")
    for header, fitting in ((h, f) for h, f in columns.left.items() if h not in columns.percent):
        why = f"not used; it could be {among(fitting, 5)}" if fitting else "not used: no connector is like it"
        lines.append(f"# {_quoted(_line(header))} = {_quoted(fitting[0] if fitting else 'CONNECTOR')}   # {why}")
    lines += [f"# {_quoted(_line(name))} cannot be used: it {_line(why)}" for name, why in columns.unusable.items()]
    return lines


def _line(text: str) -> str:
    """In one line, for a comment ends with it."""
    return " ".join(text.split())


def _toml(value: str | int) -> str:
    return str(value) if isinstance(value, int) else _quoted(value)


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
