"""One recorded run, on one regular clock and in the system's units; whatever had to be repaired is said in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.formats import Channel, read_channels
from cobot_joint.diagnosis.data.quantity import convert, split_header
from cobot_joint.errors import UserError

Role = Literal["train", "holdout"]
GAP = 2.5  # steps between two samples above which what lies between counts as not recorded
ROUNDED = 0.01  # steps by which the stamps of a regular clock may be off, by rounding
JITTER = 1e-3  # steps by which a stamp may miss the regular clock before its samples are interpolated onto it


@dataclass(frozen=True)
class Connector:
    """What a recorded channel belongs to: a connector of the system."""

    name: str
    causality: Literal["input", "output"]
    unit: str | None = None


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
    columns: dict[str, str] = field(default_factory=dict)  # connector -> column as recorded
    notes: list[str] = field(default_factory=list)
    path: Path | None = None

    @property
    def step(self) -> float:
        """s between two samples"""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))


def read_recording(
    path: Path,
    connectors: Mapping[str, Connector],
    columns: Mapping[str, str],
    *,
    role: Role = "train",
    setup: str = "default",
    initial: Mapping[str, float | str] | None = None,
    time_column: str | None = None,
    window: tuple[float | None, float | None] = (None, None),
    late: Mapping[str, float] | None = None,
) -> Recording:
    """Read a file and put it on one regular clock.

    connectors: those of this set-up's system, by name. columns: column -> connector; a column may carry its unit in
    brackets, for files that cannot. initial: variable of the system -> value, or "first sample" of the channel of that
    name, "first sample of NAME" of another. window: what of the file's clock is used, s. late: column -> s by which its
    stamps are late. Raises UserError.
    """
    notes: list[str] = []
    units_of_columns = dict(map(split_header, columns))
    connector_of = {split_header(column)[0]: connector for column, connector in columns.items()}
    raw: dict[str, Channel] = {}
    for channel in _windowed(read_channels(path, time_column), window, late):
        if channel.name not in connector_of:
            notes.append(f"{channel.name} is not connected to the system and not used")
        elif connector_of[channel.name] in connectors:
            raw[connector_of[channel.name]] = channel
        else:
            notes.append(
                f"{channel.name} has no connector {connector_of[channel.name]!r} in set-up {setup!r} and is not used"
            )
    time = _regular_clock(path, raw, notes)
    inputs, outputs, units = {}, {}, {}
    for name, channel in raw.items():
        where = f"{path}: column {channel.name!r}"
        stated = units_of_columns[channel.name]
        if stated and channel.unit:  # the two must at least convert
            convert(np.zeros(1), channel.unit, stated, where)
        values, units[name] = convert(channel.values, channel.unit or stated, connectors[name].unit, where)
        series = _resample(channel.name, channel.time, values, time, notes)
        if connectors[name].causality == "output":
            outputs[name] = series
        else:
            inputs[name] = _fill(path, channel.name, time, series, notes)
    if not outputs:
        allowed = ", ".join(
            column for column, name in columns.items() if name in connectors and connectors[name].causality == "output"
        )
        raise UserError(
            f"{path}: none of its columns is an output of the system to compare with; known are {allowed or 'none'}"
        )
    for name in sorted(set(connectors) & set(connector_of.values()) - set(raw)):
        kept = "and stays at its start value" if connectors[name].causality == "input" else "and is not compared"
        notes.append(f"{name} is not recorded {kept}")
    return Recording(
        name=path.stem,
        role=role,
        setup=setup,
        time=time,
        inputs=inputs,
        outputs=outputs,
        units=units,
        initial=_initial(path, initial or {}, inputs | outputs),
        columns={name: channel.name for name, channel in raw.items()},
        notes=notes,
        path=path,
    )


def _windowed(
    channels: list[Channel], window: tuple[float | None, float | None], late: Mapping[str, float] | None
) -> list[Channel]:
    """Channels with the stamps of late ones put right, cut to the window; those that share a clock go on sharing it."""
    shifts = dict(late or {})
    begin, end = (-np.inf if window[0] is None else window[0]), (np.inf if window[1] is None else window[1])
    clocks: dict[tuple[int, float], tuple[NDArray[np.float64], NDArray[np.bool_]]] = {}
    found = []
    for channel in channels:
        shift = shifts.pop(channel.name, 0.0)
        key = (id(channel.time), shift)
        if key not in clocks:
            time = channel.time - shift
            inside = ~((time < begin) | (time > end))
            clocks[key] = (time[inside], inside)
        time, inside = clocks[key]
        found.append(replace(channel, time=time, values=channel.values[inside]))
    if shifts:
        known = ", ".join(channel.name for channel in channels)
        raise UserError(f"late: column {next(iter(shifts))!r} is given, {known} are there")
    return found


def _regular_clock(path: Path, raw: dict[str, Channel], notes: list[str]) -> NDArray[np.float64]:
    """The fastest channel's median step, over the time that all channels share.

    Puts each channel's own clock in order first.
    """
    if not raw:
        raise UserError(f"{path}: none of its columns belongs to the system")
    clocks = {id(channel.time): channel for channel in reversed(raw.values())}
    ordered = {}
    for key, channel in clocks.items():
        whose = "the clock" if len(clocks) == 1 else f"the clock of {channel.name}"
        ordered[key] = _in_order(path, whose, channel.time, notes)
    for name, channel in list(raw.items()):
        keep = ordered[id(channel.time)]
        raw[name] = Channel(channel.name, channel.unit, channel.time[keep], channel.values[keep])
    times = list({id(c.time): c.time for c in raw.values()}.values())
    if min(map(len, times)) < 3:
        raise UserError(f"{path}: {min(map(len, times))} usable samples are given, 3 at least are needed")
    step = min(_step(t) for t in times)
    start, stop = max(t[0] for t in times), min(t[-1] for t in times)
    if stop - start < 2 * step:
        raise UserError(
            f"{path}: its channels share {max(stop - start, 0.0):g} s, 2 steps of {step:g} s at least are needed"
        )
    return np.asarray(start + step * np.arange(int(np.floor((stop - start) / step + 1e-6)) + 1))


def _step(time: NDArray[np.float64]) -> float:
    """The mean of a clock that is regular up to the rounding of its stamps, else the median: gaps do not count."""
    mean = (time[-1] - time[0]) / (len(time) - 1)
    regular = np.abs(time - time[0] - mean * np.arange(len(time))).max() < ROUNDED * mean
    return _nice(float(mean if regular else np.median(np.diff(time))))


def _nice(step: float) -> float:
    """Differences carry rounding, 0.0009999999999994: the nearest number of four digits, if it is that."""
    rounded = float(f"{step:.4g}")
    return rounded if abs(rounded - step) < 1e-6 * step else step


def _in_order(path: Path, whose: str, time: NDArray[np.float64], notes: list[str]) -> NDArray[np.intp]:
    """Indices of samples whose stamps ascend: unreadable and repeated ones dropped, strays sorted, restarts cut."""
    keep = np.flatnonzero(np.isfinite(time))
    if len(keep) < len(time):
        notes.append(f"{whose} has {len(time) - len(keep)} unreadable time stamps, dropped")
    back = np.flatnonzero(np.diff(time[keep]) < 0)
    if len(back):
        order = keep[np.argsort(time[keep], kind="stable")]
        moved = int(np.max(np.abs(np.argsort(order, kind="stable") - np.arange(len(order)))))
        if moved <= max(10, len(keep) // 1000):
            notes.append(f"{whose} runs backward {len(back)} times, by at most {moved} samples, sorted")
            keep = order
        else:  # the clock restarts: two runs in one file cannot be told to be one
            pieces = np.split(keep, back + 1)
            longest = max(pieces, key=len)
            notes.append(
                f"{whose} restarts {len(back)} times (first at {time[keep[back[0]]]:g} s); the longest piece is used, "
                f"{time[longest[0]]:g} to {time[longest[-1]]:g} s, "
                f"and {len(keep) - len(longest)} of {len(keep)} samples are not"
            )
            keep = longest
    fresh = np.concatenate([[True], np.diff(time[keep]) > 0]) if len(keep) else np.zeros(0, dtype=bool)
    if not fresh.all():
        notes.append(f"{whose} repeats {int((~fresh).sum())} time stamps, the first sample of each is used")
    return keep[fresh]


def _resample(
    name: str, time: NDArray[np.float64], values: NDArray[np.float64], clock: NDArray[np.float64], notes: list[str]
) -> NDArray[np.float64]:
    """Values on the regular clock, linear in between; NaN where the recording has a gap or no value."""
    step = clock[1] - clock[0]
    valid = np.isfinite(values)
    if not valid.any():
        notes.append(f"{name} has no values")
        return np.full(len(clock), np.nan)
    if not valid.all():
        notes.append(f"{name} has no value in {int((~valid).sum())} of {len(values)} samples, left out")
    t, x = time[valid], values[valid]
    inside = np.clip(np.searchsorted(t, clock, side="right") - 1, 0, max(len(t) - 2, 0))
    nearest = np.where(
        np.abs(t[inside] - clock) <= np.abs(t[np.minimum(inside + 1, len(t) - 1)] - clock),
        inside,
        np.minimum(inside + 1, len(t) - 1),
    )
    miss = np.abs(t[nearest] - clock)
    own = float(np.median(np.diff(t))) if len(t) > 1 else step
    between = np.interp(clock, t, x)
    series = np.where(miss <= JITTER * step, x[nearest], between)
    # a gap: further apart than the channel's own steps, and not a sample of the channel itself
    width = np.diff(t)[inside] if len(t) > 1 else np.zeros(len(clock))
    lost = (
        (miss > JITTER * step) & (width > GAP * max(own, step))
        | (clock < t[0] - JITTER * step)
        | (clock > t[-1] + JITTER * step)
    )
    moved = (miss > JITTER * step) & ~lost
    if moved.any():
        notes.append(
            f"{name}: {int(moved.sum())} of {len(clock)} samples are off the regular clock of {step:g} s "
            f"(by up to {miss[moved].max():.2g} s), interpolated"
        )
    if lost.any():
        gaps = int(np.sum(np.diff(np.concatenate([[0], lost.astype(int)])) == 1))
        notes.append(
            f"{name}: {gaps} gaps, {int(lost.sum())} of {len(clock)} samples, first at {clock[np.argmax(lost)]:g} s"
        )
    return np.where(lost, np.nan, series)


def _fill(
    path: Path, name: str, time: NDArray[np.float64], series: NDArray[np.float64], notes: list[str]
) -> NDArray[np.float64]:
    """An input must be known throughout: bridged in a straight line where it was not recorded."""
    lost = ~np.isfinite(series)
    if lost.mean() > 0.5:
        raise UserError(
            f"{path}: input {name!r} is recorded {100 * (1 - lost.mean()):.0f} % of the time, half at least is needed"
        )
    if lost.any():
        notes.append(
            f"{name} drives the system: {int(lost.sum())} samples that were not recorded are bridged in a straight line"
        )
        series = np.interp(time, time[~lost], series[~lost])
    return series


def _initial(
    path: Path, initial: Mapping[str, float | str], series: Mapping[str, NDArray[np.float64]]
) -> dict[str, float]:
    values: dict[str, float] = {}
    for name, given in initial.items():
        if isinstance(given, (int, float)):
            values[name] = float(given)
            continue
        channel = given.removeprefix("first sample").removeprefix(" of ") or name
        if not given.startswith("first sample") or channel not in series:
            raise UserError(
                f"{path}: initial {name!r} = {given!r} is given, "
                f'a number or "first sample" of one of {", ".join(series)} is needed'
            )
        values[name] = float(series[channel][np.argmax(np.isfinite(series[channel]))])
    return values
