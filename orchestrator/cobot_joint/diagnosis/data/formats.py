"""Recorded files as raw channels, each format by its library; text by `delimited`, HDF5 and bags by `nested`."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.delimited import Layout, read_delimited, seconds_of_day
from cobot_joint.diagnosis.data.nested import matlab_hdf5, ros2_bag
from cobot_joint.diagnosis.data.quantity import convert, duration, is_duration, split_header, without_parentheses
from cobot_joint.errors import UserError, among

TIME = ("time", "t", "timestamp", "timestamps", "loop_time", "zeit", "elapsed", "elapsed_time")
TIME_UNITS = ("s", "ms", "us", "ns")  # at the end of such a name
TIME_NAMES = (*TIME, *(f"{name}_{unit}" for unit in TIME_UNITS for name in TIME))  # the likelier one first
# a clock that is named by its unit alone; not `s`, which is a way
NAMED_BY_UNIT = {"ms": "ms", "msec": "ms", "millis": "ms", "milliseconds": "ms", "us": "us", "usec": "us",
                 "micros": "us", "microseconds": "us", "ns": "ns", "sec": "s", "secs": "s", "seconds": "s"}  # fmt: skip
TIME_WORDS = {"time", "stamp", "stamps", "timestamp", "timestamps", "zeit", "zeitstempel", "clock", "elapsed", "ts",
              "sec", "seconds"}  # fmt: skip
ROWS = 16  # a matrix of more rows is a picture or a table of its own


class NoClock(UserError):
    """No column of the file can be its clock."""


@dataclass(frozen=True)
class Channel:
    """One recorded channel as the file has it: nothing sorted, resampled or converted yet."""

    name: str
    unit: str | None
    time: NDArray[np.float64]  # s, (n,)
    values: NDArray[np.float64]  # (n,), NaN where the file has no value


@dataclass(frozen=True)
class Log:
    """A file: its channels, and what of it is no channel, with the reason."""

    path: Path
    channels: list[Channel]
    unusable: dict[str, str] = field(default_factory=dict)  # column -> why
    clock: str | None = None  # the column that was taken for it
    first_line: int = 1  # of a text file's data: line of a sample = first_line + index
    notes: list[str] = field(default_factory=list)

    @property
    def names(self) -> list[str]:
        """Of every channel."""
        return [channel.name for channel in self.channels]

    def find(self, wanted: str) -> Channel | None:
        """The channel of that name, or the only one whose path in the file ends with it. None: there is none.

        UserError: it is there and cannot be used, or is there several times.
        """
        for names in ([wanted], [n for n in (*self.names, *self.unusable) if n.endswith((f".{wanted}", f"/{wanted}"))]):
            for name in names:
                if name in self.unusable and len(names) == 1:
                    raise UserError(f"{self.path}: column {name!r} {self.unusable[name]}")
            found = [channel for channel in self.channels if channel.name in names]
            if len(names) > 1 and found:
                raise UserError(f"{self.path}: column {wanted!r} is given, the file has {among(names)}")
            if found:
                return found[0]
        return None


@dataclass
class Raw:
    """A column before it is known which one is the clock."""

    header: str
    values: NDArray[np.float64] | str  # or why it is none
    is_stamps: bool = False  # dates or times of day, in s

    def __post_init__(self) -> None:
        self.name, self.unit = split_header(self.header)


def read_log(path: Path, time: str | None = None, layout: Layout | None = None, *, table: bool = False) -> Log:
    """A file's numeric channels, by its suffix.

    time: the clock's column, where it has an unusual name, its unit in brackets; or `"10 ms"`, how far rows are apart
    where there is none. table: there is no clock, rows count.
    Raises UserError.
    """
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise UserError(f"{path}: suffix {path.suffix!r} is given, one of {', '.join(READERS)} is needed")
    if not path.is_file():
        raise UserError(f"{path}: there is no such file")
    try:
        log = READERS[suffix](path, time, layout or Layout(), table)
    except UserError:
        raise
    except ImportError as error:
        raise UserError(f"{path}: {suffix[1:]} files need {EXTRAS.get(suffix, error.name)}") from error
    except Exception as error:  # each format's library has its own words for a file it cannot read
        raise UserError(f"{path}: cannot be read as {suffix[1:]}: {' '.join(str(error).split())[:200]}") from error
    if not log.channels:
        first = next((f" ({name} {why})" for name, why in log.unusable.items()), "")
        raise UserError(f"{path}: holds no numeric channel beside the clock{first}")
    return log


def nearest(name: str, names: Iterable[str]) -> str:
    """`; the nearest is 'w_motor'` for the end of a message, or nothing."""
    known = {n.lower(): n for n in names}
    match = difflib.get_close_matches(name.lower(), known, 1, 0.5)
    return f"; the nearest is {known[match[0]]!r}" if match else ""


def _parquet(path: Path, time: str | None, layout: Layout, table: bool) -> Log:
    with pa.parquet.ParquetFile(path) as file:  # `read_table` imports pandas
        content = file.read()
    raw = []
    for header, data, kind in zip(content.column_names, content.columns, content.schema, strict=True):
        about: dict[bytes, bytes] = {key.lower(): value for key, value in dict(kind.metadata or {}).items()}
        unit = next((about[key].decode(errors="replace") for key in (b"unit", b"units") if key in about), None)
        raw.append(_raw(f"{header} [{unit}]" if unit and split_header(header)[1] is None else header, data))
    return _log(path, raw, time, table)


def _text(path: Path, time: str | None, layout: Layout, table: bool) -> Log:
    content = read_delimited(path, layout)
    columns = zip(content.headers, content.columns, strict=True)
    raw = [_raw(header, data, content.first_line) for header, data in columns]
    return _log(path, raw, time, table, content.first_line, content.notes)


def _raw(header: str, data: pa.ChunkedArray, first_line: int | None = None) -> Raw:
    stamps = _stamps(data)
    return Raw(header, _arrow(data, first_line)) if stamps is None else Raw(header, stamps, is_stamps=True)


def _stamps(column: pa.ChunkedArray) -> NDArray[np.float64] | None:
    """Seconds from the first of dates, times of day or both. None: the column holds something else."""
    kind = column.type
    if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
        stamps = column.cast(pa.timestamp("ns")).cast(pa.int64())
        values = stamps.to_numpy(zero_copy_only=False)
        known = [v for v in values[:1000] if v == v]
        whole = np.ma.masked_invalid(values.astype(float)) if values.dtype.kind == "f" else values
        return np.asarray((whole - (known[0] if known else 0)) * 1e-9, dtype=float)
    if pa.types.is_time(kind):
        column = column.cast(pa.string())
    if not pa.types.is_string(column.type) or not column.null_count < len(column):
        return None
    seconds = seconds_of_day(column.to_pylist())
    return None if seconds is None else np.array(seconds) - next(s for s in seconds if s == s)


def _arrow(column: pa.ChunkedArray, first_line: int | None = None) -> NDArray[np.float64] | str:
    """Numbers; else why not, with place and value."""
    kind = column.type
    if pa.types.is_integer(kind):  # of an epoch in ns a double knows no microseconds
        values = column.to_numpy(zero_copy_only=False)
        if values.dtype.kind in "iu" and len(values) and float(values.max()) > 2**53:
            values = values.astype(np.int64) - np.int64(values[0])
        return np.asarray(values, dtype=float)
    if pa.types.is_boolean(kind) or pa.types.is_floating(kind):
        doubles = column.cast(pa.float64()).combine_chunks()
        # `to_numpy` imports pandas, which takes as long as a few simulations
        return doubles.to_numpy(zero_copy_only=False) if doubles.null_count else np.array(np.from_dlpack(doubles))
    if pa.types.is_null(kind):
        return "has no values"
    if not (pa.types.is_string(kind) or pa.types.is_large_string(kind)):
        return f"holds {kind}, numbers are needed"
    for k, cell in enumerate(column.to_pylist()):
        try:
            float(cell or "nan")
        except ValueError:
            place = f"sample {k + 1}" if first_line is None else f"line {first_line + k}"
            return f"holds {str(cell)[:40]!r} in {place}, a number is needed (an empty cell: not recorded)"
    return "holds text, numbers are needed"


def _mat(path: Path, time: str | None, layout: Layout, table: bool) -> Log:
    import scipy.io

    try:
        content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:  # version 7.3 is HDF5
        content = matlab_hdf5(path)
    found = [
        (name, value) for key, item in content.items() if not key.startswith("__") for name, value in _arrays(key, item)
    ]
    lengths = Counter(max(value.shape) for _, value in found)
    columns = {name: value for name, value in found if value.ndim == 1}
    clock = None if table or duration(time or "") else _clock_name(path, list(columns), [], time)
    n = len(columns[clock]) if clock else lengths.most_common(1)[0][0] if lengths else 0
    raw = []
    for name, value in found:
        if value.ndim == 1:
            raw.append(Raw(name, value.astype(float)))
        elif value.ndim == 2 and n in value.shape and min(value.shape) <= ROWS:
            rows = value if value.shape[1] == n else value.T
            raw += [Raw(f"{name}[{k}]", row.astype(float)) for k, row in enumerate(rows)]
        else:
            raw.append(Raw(name, f"is an array of {' x '.join(map(str, value.shape))}, its clock has {n} samples"))
    return _log(path, raw, time, table)


def _arrays(name: str, value: object) -> Iterator[tuple[str, NDArray]]:
    """Numeric arrays of more than one value under their paths: `rec.act_pos`, `runs[1].t`."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _arrays(f"{name}.{key}", item)
    elif hasattr(value, "_fieldnames"):
        for key in value._fieldnames:
            yield from _arrays(f"{name}.{key}", getattr(value, key))
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype.kind == "O"):
        for k, item in enumerate(value if isinstance(value, list) else value.ravel()):
            yield from _arrays(f"{name}[{k}]", item)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.size > 1:
        yield name, value.squeeze()


def _mdf(path: Path, time: str | None, layout: Layout, table: bool) -> Log:
    """MDF keeps a clock per group, so channels may run at different rates; alike names carry the group's."""
    import asammdf

    channels, unusable = [], {}
    with asammdf.MDF(path) as file:
        names = Counter(channel.name for group in list[Any](file.groups) for channel in group.channels)
        groups: list[Any] = list(file.groups)
        for k, group in enumerate(groups):
            label = re.sub(r"\s+", "_", getattr(group.channel_group, "acq_name", "") or f"group{k}")
            for index, channel in enumerate(group.channels):
                if index == file.masters_db.get(k):
                    continue
                name, unit = split_header(channel.name if names[channel.name] == 1 else f"{label}.{channel.name}")
                s = file.get(group=k, index=index)
                if s.samples.ndim != 1 or s.samples.dtype.kind not in "biuf":
                    unusable[name] = "holds no plain numbers"
                    continue
                values = s.samples.astype(float)
                if s.invalidation_bits is not None:
                    values[np.asarray(s.invalidation_bits, dtype=bool)] = np.nan
                channels.append(Channel(name, s.unit or unit, s.timestamps.astype(float), values))
    return Log(path, channels, unusable)


def _bag(path: Path, time: str | None, layout: Layout, table: bool) -> Log:
    series, unusable = ros2_bag(path)
    return Log(path, [Channel(name, None, *rows) for name, rows in series.items()], unusable)


def _log(
    path: Path, raw: list[Raw], time: str | None, table: bool, first_line: int = 1, notes: list[str] | None = None
) -> Log:
    """Columns that share one clock, as channels; those that cannot be one, with the reason."""
    counts = Counter(column.name for column in raw)
    usable = {c.name: c for c in raw if counts[c.name] == 1 and not isinstance(c.values, str)}
    unusable = {c.name: c.values for c in raw if isinstance(c.values, str)}
    unusable |= {name: f"is there {n} times; rename them" for name, n in counts.items() if n > 1}
    step = 1.0 if table else duration(time or "")
    if step is not None:
        clock, stamps = None, np.arange(max((len(c.values) for c in usable.values()), default=0)) * step
    else:
        clock = _clock_name(path, [c.name for c in raw], _likely(usable), time)
        if clock in unusable:
            raise UserError(f"{path}: the clock {clock!r} {unusable[clock]}")
        stamps = _seconds(path, usable.pop(clock), time)
    for name, column in list(usable.items()):
        if column.is_stamps:
            unusable[name] = "holds dates or times of day and is not the clock"
            del usable[name]
        elif len(column.values) != len(stamps):
            unusable[name] = f"has {len(column.values)} samples, its clock {clock!r} has {len(stamps)}"
            del usable[name]
    channels = [Channel(c.name, c.unit, stamps, c.values) for c in usable.values()]  # type: ignore[arg-type]
    return Log(path, channels, unusable, clock, first_line, notes or [])


def _likely(columns: Mapping[str, Raw]) -> list[str]:
    """Those that could be the clock, by the first of these that any has: stamps that rise; a unit of time; a word for
    time in the name (`stamp_s`), never falling; its unit as the name (`ms_today`), rising."""

    def rises(name: str, least: float = float(np.finfo(float).tiny)) -> bool:
        values = columns[name].values
        return not isinstance(values, str) and len(values) > 1 and bool(np.all(np.diff(values) >= least))

    words = {name: re.split(r"[^a-z]+", name.lower()) for name in columns}
    stamps = [name for name, c in columns.items() if c.is_stamps and rises(name)]
    timed = [name for name, c in columns.items() if c.unit and is_duration(c.unit)]
    named = [name for name in columns if TIME_WORDS & {*words[name]} and rises(name, 0.0)]
    counted = [name for name in columns if words[name][0] in NAMED_BY_UNIT and rises(name)]
    return stamps or timed or named or counted or [n for n, c in columns.items() if c.is_stamps and rises(n, 0.0)]


def _clock_name(path: Path, names: list[str], likely: list[str], time: str | None) -> str:
    """The clock's column: as told, by its usual names, or the only likely one."""
    if time:
        wanted = split_header(time)[0]
        for found in ([n for n in names if n == wanted], [n for n in names if n.lower() == wanted.lower()],
                      [n for n in names if n.endswith((f".{wanted}", f"/{wanted}"))]):  # fmt: skip
            if len(found) == 1:
                return found[0]
        raise UserError(f"{path}: time = {time!r} is given, columns are {among(names)}{nearest(wanted, names)}")
    for usual in TIME_NAMES:
        found = [n for n in names if without_parentheses(n).lower().replace(" ", "_") == usual]
        found = found or [n for n in names if n.lower().endswith((f".{usual}", f"/{usual}"))]
        if len(found) == 1:
            return found[0]
        if found:
            raise UserError(f'{path}: {among(found)} could be the clock: say which, time = "{found[0]} [s]"')
    if len(likely) == 1:
        return likely[0]
    raise NoClock(
        f"{path}: no time column; columns are {among(names)}; a clock is called {' or '.join(TIME_NAMES[:6])}, "
        f'or say which it is, time = "{names[0] if names else "NAME"} [s]", or how far rows are apart, time = "10 ms"'
    )


def _seconds(path: Path, clock: Raw, time: str | None) -> NDArray[np.float64]:
    if clock.is_stamps:
        return np.asarray(clock.values, dtype=float)
    stated = split_header(time)[1] if time else None
    named = re.search(f"[_ ]({'|'.join(TIME_UNITS)})$", clock.name.lower())
    counted = NAMED_BY_UNIT.get(re.split(r"[^a-z]+", clock.name.lower())[0])
    unit = clock.unit or stated or (named[1] if named else counted)
    assert not isinstance(clock.values, str)
    return np.asarray(convert(clock.values, unit, "s", f"{path}: column {clock.header!r}")[0])


READERS: dict[str, Callable[[Path, str | None, Layout, bool], Log]] = {
    ".parquet": _parquet,
    ".csv": _text,
    **dict.fromkeys((".txt", ".tsv", ".log", ".dat", ".asc"), _text),
    ".mat": _mat,
    ".mf4": _mdf,
    ".mdf": _mdf,
    ".mcap": _bag,
}
EXTRAS = {
    **dict.fromkeys((".mf4", ".mdf"), "asammdf: pip install 'cobot-joint[mdf]'"),
    ".mcap": "mcap-ros2-support: pip install 'cobot-joint[rosbag]'",
}
