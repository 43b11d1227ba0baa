"""Recorded files as raw channels: Parquet and CSV by pyarrow, MAT by scipy and mat73, MDF by asammdf."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.quantity import convert, split_header
from cobot_joint.errors import UserError

TIME_NAMES = ("time", "t", "timestamp", "timestamps", "loop_time")


@dataclass(frozen=True)
class Channel:
    """One recorded channel as the file has it: nothing sorted, resampled or converted yet."""

    name: str
    unit: str | None
    time: NDArray[np.float64]  # s, (n,)
    values: NDArray[np.float64]  # (n,), NaN where the file has no value


def read_channels(path: Path, time_column: str | None = None) -> list[Channel]:
    """All numeric channels of a file, by its suffix.

    `time_column` names the clock where it is not called one of TIME_NAMES (with or without its unit in brackets).
    Raises UserError.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise UserError(f"{path}: suffix {path.suffix!r} is given, one of {', '.join(READERS)} is needed")
    if not path.is_file():
        raise UserError(f"{path}: there is no such file")
    try:
        channels = reader(path, time_column)
    except UserError:
        raise
    except Exception as error:  # each format's library has its own words for a file it cannot read
        raise UserError(f"{path}: cannot be read as {path.suffix[1:]}: {' '.join(str(error).split())[:200]}") from error
    if not channels:
        raise UserError(f"{path}: holds no numeric channel beside the clock")
    return channels


def _parquet(path: Path, time_column: str | None) -> list[Channel]:
    return _columns(path, _arrow(pa.parquet.read_table(path)), time_column)


def _csv(path: Path, time_column: str | None) -> list[Channel]:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        first = file.readline()
    delimiter = max(",;\t", key=first.count)
    options = pa.csv.ConvertOptions(decimal_point="," if delimiter == ";" and _decimal_comma(path) else ".")
    return _columns(
        path,
        _arrow(pa.csv.read_csv(path, parse_options=pa.csv.ParseOptions(delimiter=delimiter), convert_options=options)),
        time_column,
    )


def _decimal_comma(path: Path) -> bool:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        next(file, "")
        return "," in next(file, "")


def _arrow(table: pa.Table) -> dict[str, NDArray[np.float64]]:
    columns: dict[str, NDArray[np.float64]] = {}
    for header, column in zip(table.column_names, table.columns, strict=True):
        if pa.types.is_timestamp(column.type):  # an absolute clock: seconds from its first stamp
            stamps = column.cast(pa.timestamp("ns")).to_numpy()
            columns[header] = np.where(
                np.isnat(stamps), np.nan, (stamps - stamps[~np.isnat(stamps)][:1]) / np.timedelta64(1, "s")
            )
        elif pa.types.is_boolean(column.type) or pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
            columns[header] = column.cast(pa.float64()).to_numpy(zero_copy_only=False)
    return columns


def _mat(path: Path, time_column: str | None) -> list[Channel]:
    import scipy.io

    try:
        content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:  # version 7.3 is HDF5
        import mat73

        content = mat73.loadmat(str(path))
    columns: dict[str, NDArray[np.float64]] = {}

    def collect(name: str, value: object) -> None:
        if isinstance(value, dict):
            for key, item in value.items():
                collect(key, item)
        elif hasattr(value, "_fieldnames"):
            for key in value._fieldnames:
                collect(key, getattr(value, key))
        elif (
            isinstance(value, np.ndarray)
            and value.dtype.kind in "biuf"
            and value.size > 1
            and max(value.shape) == value.size
        ):
            columns[name] = value.astype(float).ravel()

    collect("", {name: value for name, value in content.items() if not name.startswith("__")})
    return _columns(path, columns, time_column)


def _mdf(path: Path, time_column: str | None) -> list[Channel]:
    """MDF keeps a clock per group, so channels of one file may run at different rates."""
    try:
        import asammdf
    except ImportError as error:
        raise UserError(f"{path}: MDF files need asammdf: pip install 'cobot-joint[mdf]'") from error
    with asammdf.MDF(path) as file:
        signals = [
            s for s in file.iter_channels(skip_master=True) if s.samples.ndim == 1 and s.samples.dtype.kind in "biuf"
        ]
        channels = []
        for s in signals:
            name, unit = split_header(s.name)
            values = s.samples.astype(float)
            if s.invalidation_bits is not None:
                values[np.asarray(s.invalidation_bits, dtype=bool)] = np.nan
            channels.append(Channel(name, s.unit or unit, s.timestamps.astype(float), values))
    return channels


def _columns(path: Path, columns: dict[str, NDArray[np.float64]], time_column: str | None) -> list[Channel]:
    """Columns that share one clock, as channels."""
    wanted = (split_header(time_column)[0],) if time_column else TIME_NAMES
    clocks = [header for name in wanted for header in columns if split_header(header)[0].lower() == name.lower()]
    if not clocks:
        raise UserError(
            f"{path}: no time column; columns are {', '.join(columns)}; "
            f'a clock is called {" or ".join(wanted)}, or give time = "..."'
        )
    stated = split_header(time_column)[1] if time_column else None
    time, _ = convert(columns[clocks[0]], split_header(clocks[0])[1] or stated, "s", f"{path}: column {clocks[0]!r}")
    lengths = {header: len(values) for header, values in columns.items() if len(values) != len(time)}
    if lengths:
        header, length = next(iter(lengths.items()))
        raise UserError(f"{path}: {header!r} has {length} samples, its clock {clocks[0]!r} has {len(time)}")
    return [Channel(*split_header(header), time, values) for header, values in columns.items() if header != clocks[0]]


READERS: dict[str, Callable[[Path, str | None], list[Channel]]] = {
    ".parquet": _parquet,
    ".csv": _csv,
    ".mat": _mat,
    ".mf4": _mdf,
    ".mdf": _mdf,
}
