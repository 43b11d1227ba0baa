"""One recorded run, on one regular clock and in the system's units; whatever had to be repaired is said in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.clock import FEWEST, fill, regular_clock, resample, unwrapped, windowed, without_wild
from cobot_joint.diagnosis.data.conditioning import ChannelQuality, assess
from cobot_joint.diagnosis.data.delimited import Layout
from cobot_joint.diagnosis.data.formats import Channel, Log, nearest, read_log
from cobot_joint.diagnosis.data.parameters import first_values
from cobot_joint.diagnosis.data.quantity import convert, is_angle, product, split_header
from cobot_joint.errors import UserError, among

Role = Literal["train", "holdout"]
ROWS = 4  # of a table, of which anything can be said
LARGEST = 1e15  # in any unit of a column; beyond it lie markers for "no value"


@dataclass(frozen=True)
class Connector:
    """What a recorded channel belongs to: a connector of the system."""

    name: str
    causality: Literal["input", "output"]
    unit: str | None = None


@dataclass(frozen=True)
class LeftOut:
    """Samples of a channel that are no measurements, and are taken as not recorded."""

    channel: str  # connector
    kind: Literal["outlier", "clipped", "frozen", "held", "bridged"]
    samples: int
    words: str


@dataclass
class Recording:
    """One run. All arrays share `time`: regular, ascending, (n,).

    Inputs drive the system, linear between samples and finite throughout. Outputs are compared with it; NaN marks
    samples that were not recorded. Keys are connectors of the system.
    """

    name: str
    role: Role
    setup: str
    time: NDArray[np.float64]
    inputs: dict[str, NDArray[np.float64]]
    outputs: dict[str, NDArray[np.float64]]
    units: dict[str, str]
    initial: dict[str, float] = field(default_factory=dict)
    # series that start values are taken from -> start value -> what 1 sigma of where that series begins makes of it
    start_scatter: dict[str, dict[str, float]] = field(default_factory=dict)
    strays: list[dict[str, NDArray[np.float64]]] = field(default_factory=list)  # what each of these makes of outputs
    columns: dict[str, str] = field(default_factory=dict)  # connector -> column as recorded
    believed: set[str] = field(default_factory=set)  # connectors whose factor and sign somebody looked at
    held: set[str] = field(default_factory=set)  # inputs whose values hold until the next one comes
    # outputs that were made of a position's samples: since the one before, or around each
    differences: dict[str, Literal["backward", "central"]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    path: Path | None = None
    scatter: dict[str, float] = field(default_factory=dict)  # of a table: 1 sigma per output; time is no time then
    left_out: list[LeftOut] = field(default_factory=list)
    coarse: bool = False  # whether longer steps of an integrator make no difference to what is compared

    @property
    def step(self) -> float:
        """s between two samples"""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    def centred(self) -> Recording:
        """With differences of neighbours on either side in place of those since the sample before, which are half a
        sample late: what a filter takes for values of an instant."""
        late = [name for name, how in self.differences.items() if how == "backward" and name in self.outputs]
        ahead = {n: np.append((self.outputs[n][:-1] + self.outputs[n][1:]) / 2, np.nan) for n in late}
        return replace(self, outputs=self.outputs | ahead, differences={}) if late else self


@dataclass(frozen=True)
class Column:
    """What a column of a file belongs to: x = sign*scale*column + offset in the connector's unit."""

    connector: str
    scale: float | str = 1.0  # "9.84 mN.m": a quantity, times what the column counts
    sign: Literal[1, -1] = 1
    offset: float | str = 0.0  # "0.3 V"
    derivative: bool = False  # the connector is the column's rate of change, "speed" of a recorded position
    believed: bool = False  # somebody looked at its factor and sign: what is implausible is theirs
    hold: bool = False  # the machine gets every value until the next one comes
    mean: bool = False  # a speed's mean since the sample before, of an encoder's counts
    times: str = ""  # another column of the file, which it is multiplied by: a duty cycle's supply


@dataclass(frozen=True)
class Reading:
    """How a file becomes a recording: what a campaign says of it."""

    role: Role = "train"
    setup: str = "default"
    initial: Mapping[str, float | str] = field(default_factory=dict)  # variable of the system -> value or first sample
    time: str | None = None  # the clock's column, where it has an unusual name
    window: tuple[float | None, float | None] = (None, None)  # what of the file's clock is used, s
    late: Mapping[str, float] = field(default_factory=dict)  # column -> s by which its stamps are late
    without: Sequence[str] = ()  # columns or connectors that this file is known to lack
    layout: Layout = field(default_factory=Layout)
    table: Literal["mean", "rows"] | None = None  # not a run but steady states: a file, or each of its lines


def read_recording(
    path: Path,
    connectors: Mapping[str, Connector],
    columns: Mapping[str, Column | str],
    reading: Reading = Reading(),
) -> Recording:
    """Read a file and put it on one regular clock.

    connectors: those of this set-up's system, by name. columns: column -> what it belongs to, or the connector's name;
    a column may carry its unit in brackets, for files that cannot. Raises UserError.
    """
    log = read_log(path, reading.time, reading.layout, table=reading.table == "rows")
    log, notes = replace(log, channels=windowed(log, reading.window, reading.late)), [*log.notes]
    wired = {header: c if isinstance(c, Column) else Column(c) for header, c in columns.items()}
    found = _wanted(log, connectors, wired, reading, notes)
    raw = {name: channel for name, (channel, _, _) in found.items()}
    for channel in raw.values():
        _check_values(log, channel)
    steady = reading.table is not None
    said = [] if reading.table == "mean" else notes  # of a clock, which means do not ask for
    fewest = ROWS if reading.table == "rows" else FEWEST
    time = regular_clock(path, raw, said, confirmed=steady or reading.time is not None, fewest=fewest)
    inputs: dict[str, NDArray[np.float64]] = {}
    outputs, units, positions = dict[str, NDArray[np.float64]](), {}, {}
    left_out: list[LeftOut] = []
    for name, channel in raw.items():
        _, header, column = found[name]
        target = connectors[name].unit
        counted = product(target, "s", str(path)) if column.derivative and target else target
        channel = channel if steady else _going_on(channel, header, column, counted, notes)
        values, units[name] = _in_unit(path, channel, header, column, counted, notes)
        if not steady and not column.believed:
            values, count, words = without_wild(values, measured=connectors[name].causality == "output")
            left_out += [LeftOut(name, "outlier", count, words)] if count else []
        series = resample(channel.name, channel.time, values, time, said)
        if connectors[name].causality == "input":
            series = fill(path, channel.name, time, series, said)
        if column.derivative:  # central differences: their integral does not drift from the position
            positions[channel.name], units[name] = series, target or f"{units[name]}/s"
            series = np.gradient(series, time)
        (outputs if connectors[name].causality == "output" else inputs)[name] = series
    starts = first_values(path, reading.initial, inputs | outputs | positions)
    return Recording(
        name=path.stem,
        role=reading.role,
        setup=reading.setup,
        time=time,
        inputs=inputs,
        outputs=outputs,
        units=units,
        initial=starts[0],
        start_scatter=starts[1],
        columns={name: channel.name for name, channel in raw.items()},
        believed={name for name, (_, _, column) in found.items() if column.believed},
        held=_held(path, connectors, found),
        differences=_differences(path, connectors, found),
        notes=_grouped(notes, len(raw)),
        path=path,
        left_out=left_out,
    )


def _held(
    path: Path, connectors: Mapping[str, Connector], found: Mapping[str, tuple[Channel, str, Column]]
) -> set[str]:
    """Inputs that are. UserError: an output is said to be."""
    those = {name: header for name, (_, header, column) in found.items() if column.hold}
    for name, header in those.items():
        if connectors[name].causality == "output":
            raise UserError(f"{path}: column {header!r}: hold is given, {name!r} is an output; it is for inputs")
    return set(those)


def _differences(
    path: Path, connectors: Mapping[str, Connector], found: Mapping[str, tuple[Channel, str, Column]]
) -> dict[str, Literal["backward", "central"]]:
    """Outputs that were made of a position's samples, and how. UserError: mean is given for an input, or beside
    derivative."""
    for name, (_, header, column) in found.items():
        if column.mean and (connectors[name].causality == "input" or column.derivative):
            what = "derivative, too" if column.derivative else f"{name!r} is an input"
            raise UserError(f"{path}: column {header!r}: mean is given, {what}; it is for a speed's output")
    outputs = {n: column for n, (_, _, column) in found.items() if connectors[n].causality == "output"}
    return {n: "backward" if c.mean else "central" for n, c in outputs.items() if c.mean or c.derivative}


def said_once(notes: Sequence[tuple[str, Sequence[str]]]) -> list[str]:
    """Notes of several recordings, (name, its notes) each: what holds of all once, anything else with their names."""
    whose: dict[str, list[str]] = {}
    for name, own in notes:
        for note in dict.fromkeys(own):
            whose.setdefault(note, []).append(name)
    return [note if len(of) == len(notes) else f"{among(of, 3)}: {note}" for note, of in whose.items()]


def _grouped(notes: list[str], channels: int) -> list[str]:
    """What holds of several channels, said once."""
    names: dict[str, list[str]] = {}
    for note in notes:
        name, colon, what = note.partition(": ")
        names.setdefault(what if colon else note, []).append(name if colon else "")
    whose = {what: "every channel" if len(n) == channels > 1 else ", ".join(n) for what, n in names.items()}
    return [f"{whose[what]}: {what}" if whose[what] else what for what in names]


def _wanted(
    log: Log, connectors: Mapping[str, Connector], columns: Mapping[str, Column], reading: Reading, notes: list[str]
) -> dict[str, tuple[Channel, str, Column]]:
    """Connector -> its channel, header and column. UserError: two for one, none of an output, a channel is missing."""
    found: dict[str, tuple[Channel, str, Column]] = {}
    missing: dict[str, str] = {}
    for header, column in columns.items():
        name = split_header(header)[0]
        channel = _there(log, name, bool({name, header, column.connector} & set(reading.without)))
        if column.connector not in connectors:
            if channel:
                notes.append(
                    f"{name} has no connector {column.connector!r} in set-up {reading.setup!r} and is not used"
                )
        elif channel is None:
            missing.setdefault(column.connector, name)
        elif column.connector in found:
            both = f"{found[column.connector][0].name!r} and {channel.name!r}"
            raise UserError(f"{log.path}: columns {both} are both there for {column.connector!r}, one is allowed")
        else:
            here = channel, header, column
            found[column.connector] = _multiplied(log, *here) if column.times else here
    used = {channel.name for channel, _, _ in found.values()} | {split_header(header)[0] for header in columns}
    used |= {split_header(column.times)[0] for _, _, column in found.values()}
    notes += [f"{name} is not connected to the system and not used" for name in log.names if name not in used]
    there = {*columns, *(split_header(header)[0] for header in columns), *connectors, *log.names}
    there |= {column.connector for column in columns.values()}
    if unknown := [name for name in reading.without if name not in there]:
        raise UserError(
            f"{log.path}: without = {unknown[0]!r} is given, a column or connector is needed: "
            f"{among(columns)}{nearest(unknown[0], list(there))}"
        )
    for name, header in missing.items():
        if name in found:
            continue
        if not {name, header} & set(reading.without):
            raise UserError(
                f"{log.path}: no column {header!r} for {name!r}; the file has {among(log.names)}"
                f"{nearest(header, [n for n in log.names if n not in used])}; "
                f'where it was not recorded, say without = ["{header}"] in its [[recording]]'
            )
        kept = "and stays at its start value" if connectors[name].causality == "input" else "and is not compared"
        notes.append(f"{name} is not recorded {kept}")
    if not any(connectors[name].causality == "output" for name in found):
        known = among(
            h for h, c in columns.items() if c.connector in connectors and connectors[c.connector].causality == "output"
        )
        raise UserError(
            f"{log.path}: none of its columns is an output of the system to compare with; known are {known}; "
            f"the file has {among(log.names)}"
        )
    return found


def _multiplied(log: Log, channel: Channel, header: str, column: Column) -> tuple[Channel, str, Column]:
    """A channel times another of the file, in the unit that this makes. UserError: that one is not there, or empty."""
    (name, stated), where = split_header(column.times), f"{log.path}: column {header!r}: times = {column.times!r}"
    other = log.find(name)
    if other is None or not np.isfinite(other.values).any():
        lacking = "has no value" if other else f"is given, the file has {among(log.names)}{nearest(name, log.names)}"
        raise UserError(f"{where} {lacking}")
    known = np.isfinite(other.values)
    values = channel.values * np.interp(channel.time, other.time[known], other.values[known])
    unit = product(channel.unit or split_header(header)[1], f"1 {other.unit or stated or ''}", where)
    return replace(channel, values=values, unit=unit), split_header(header)[0], column


def _there(log: Log, name: str, may_lack: bool) -> Channel | None:
    """A log's channel. None: there is none, or it holds nothing and may be missing."""
    if may_lack and name in log.unusable:
        return None
    channel = log.find(name)
    return None if channel and may_lack and not np.isfinite(channel.values).any() else channel


def _check_values(log: Log, channel: Channel) -> None:
    """UserError: a channel holds nothing, or a number that no instrument gives."""
    wild = np.abs(channel.values) > LARGEST
    if wild.any():
        k = int(np.argmax(wild))
        raise UserError(
            f"{log.path}: column {channel.name!r} holds {channel.values[k]:g} at {channel.time[k]:g} s, "
            f"up to {LARGEST:g} is allowed (an empty cell: not recorded)"
        )
    if not np.isfinite(channel.values).any():
        raise UserError(f"{log.path}: column {channel.name!r} has no value in any of its {len(channel.values)} samples")


def _in_unit(
    path: Path, channel: Channel, header: str, column: Column, target: str | None, notes: list[str]
) -> tuple[NDArray[np.float64], str]:
    """sign*scale*column + offset in the connector's unit."""
    where = f"{path}: column {channel.name!r}"
    stated = split_header(header)[1]
    if stated and channel.unit and not np.isclose(convert(np.ones(1), channel.unit, stated, where)[0][0], 1):
        notes.append(
            f"{channel.name}: the file says [{channel.unit}] and the campaign [{stated}]; the file's is used, "
            "a scale corrects it"
        )
    unit = channel.unit or stated
    if isinstance(column.scale, str):
        try:
            quantity = product(unit, column.scale, f"{where}: scale")
            values, unit = convert(channel.values, quantity, target, f"{where}: scale")
        except UserError as error:
            lacking = "" if unit else f'; the column has no unit: "{channel.name} [UNIT]" gives it one'
            raise UserError(f"{error}{lacking}") from None
    else:
        values, unit = convert(channel.values, unit, target, where)
        values = values if column.scale == 1 else column.scale * values
    values = -values if column.sign < 0 else values
    offset = column.offset
    if isinstance(offset, str):
        size = offset.strip().removeprefix("-")  # a unit's factor has no sign
        offset = float(convert(np.ones(1), size, target or unit, f"{where}: offset")[0][0])
        offset = -offset if str(column.offset).strip().startswith("-") else offset
    return (values + offset if offset else values), unit


def _going_on(channel: Channel, header: str, column: Column, target: str | None, notes: list[str]) -> Channel:
    """With the jumps of a single-turn encoder taken out, before any scale: its turn is a whole one there."""
    unit = channel.unit or split_header(header)[1] or (target if column.scale == 1 else None)
    if not is_angle(unit):
        return channel
    turn = 2 * np.pi / float(convert(np.ones(1), unit, "rad", channel.name)[0][0])
    values, jumps = unwrapped(channel.values, turn)
    if not jumps:
        return channel
    notes.append(f"{channel.name}: begins anew after a turn, {jumps} times: it goes on instead")
    return replace(channel, values=values)


def condition(recordings: Sequence[Recording]) -> dict[str, ChannelQuality]:
    """Per compared channel, over all recordings that have it: the logger is the same in all of them."""
    names = dict.fromkeys(name for r in recordings for name in r.outputs)
    return {name: _of_channel(name, [r for r in recordings if name in r.outputs]) for name in names}


def _of_channel(name: str, recordings: Sequence[Recording]) -> ChannelQuality:
    """Of the runs that have it; where there are only tables, of their rows: the scatter is the noise, and white. An
    encoder's counts between two samples are off by two roundings, which no window shows while their number stays."""
    in_time = [r for r in recordings if name not in r.scatter]
    quality = assess(*(r.outputs[name] for r in in_time or recordings))
    if any(r.differences.get(name) == "backward" for r in in_time):
        return replace(quality, noise=float(np.fmax(quality.noise, quality.step / np.sqrt(6))))
    if in_time:
        return quality
    variance = float(np.mean([r.scatter[name] ** 2 for r in recordings]))
    return replace(quality, noise=float(np.sqrt(variance)), colour=0.0)
