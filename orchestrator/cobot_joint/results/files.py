"""Signals as Parquet: `name [unit]` headers, provenance in the file, written in pieces so that memory stays flat."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from cobot_joint.errors import UserError
from cobot_joint.files import remove_partial, write_atomically
from cobot_joint.results.result import Result
from cobot_joint.system.model import System
from cobot_joint.version import __version__

ROWS_PER_GROUP = 20_000  # at least, in each row group but the last
METADATA = "cobot-joint"  # key of the provenance, JSON, in the Parquet file's metadata


def header(name: str, unit: str | None) -> str:
    """`w_motor [rad/s]`; a signal without unit is `name [1]`."""
    return f"{name} [{unit or '1'}]"


def columns_of(system: System) -> dict[str, str | None]:
    """Signal -> unit as a run of the system writes them: time, then what `System.recorded` says."""
    return {"time": "s"} | {name: system.unit_of(name) for name in system.recorded}


def versions() -> dict[str, str]:
    """Of the program and what its figures depend on."""
    libraries = {name: version(name) for name in ("fmpy", "numpy", "pyarrow")}
    return {"cobot-joint": __version__, "python": platform.python_version(), **libraries}


def provenance(system: System | None, **more: Any) -> dict[str, Any]:
    """Where figures come from: versions, the FMUs and every parameter that was set, and what else the caller knows.

    `system` of None: a formula, no units.
    """
    components = system.components if system else ()
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "system": system.name if system else None,
        "fmus": {
            c.name: {"file": c.unit.path.name, "guid": c.unit.description.guid, "version": c.unit.description.version}
            for c in components
        },
        "parameters": {f"{c.name}.{name}": value for c in components for name, value in c.parameters.items()},
        **more,
    }


class SignalsWriter:
    """Writes rows to a Parquet file as they come; the file appears under its name when all are there, or not at all.

    `columns`: signal -> unit, in the file's order. As a context manager; on an exception nothing is left behind.
    """

    def __init__(
        self,
        path: Path,
        columns: Mapping[str, str | None],
        provenance: Mapping[str, Any],
        rows_per_group: int = ROWS_PER_GROUP,
    ):
        self.path, self.partial = path, path.with_name(f".{path.name}.{os.getpid()}.partial")
        self.columns = dict(columns)
        self.provenance = dict(provenance)
        fields = [pa.field(header(name, unit), pa.float64()) for name, unit in columns.items()]
        self.schema = pa.schema(fields)
        self.rows_per_group = rows_per_group
        self._waiting: list[pa.Table] = []
        self._files = ExitStack()

    def __enter__(self) -> SignalsWriter:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        remove_partial(self.path)
        try:
            self._writer = self._files.enter_context(
                pq.ParquetWriter(self.partial, self.schema, compression="zstd", use_dictionary=False)
            )
        except BaseException:  # interrupted, with the file open and nobody to close it
            self.partial.unlink(missing_ok=True)
            raise
        return self

    def write(self, signals: Mapping[str, NDArray[np.float64]]) -> None:
        """The next rows; signal -> float64[n]. Signals that are not given are 0."""
        if unknown := set(signals) - set(self.columns):
            raise KeyError(f"{self.path}: no column for {', '.join(sorted(unknown))}")
        n = len(next(iter(signals.values())))
        arrays = [_array(signals.get(name, np.zeros(n))) for name in self.columns]
        self._waiting.append(pa.Table.from_arrays(arrays, schema=self.schema))
        if sum(len(table) for table in self._waiting) >= self.rows_per_group:
            self._flush()

    def _flush(self) -> None:
        if self._waiting:
            self._writer.write_table(pa.concat_tables(self._waiting))
            self._waiting.clear()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._flush()
                self._writer.add_key_value_metadata({METADATA: json.dumps(self.provenance)})
            self._files.close()
            if kind is None:
                self.partial.replace(self.path)
        finally:
            self.partial.unlink(missing_ok=True)


def _array(x: NDArray[np.float64]) -> pa.Array:
    """The same numbers for Arrow; `pa.array` would do it, but imports pandas to see whether this is one of its."""
    x = np.ascontiguousarray(x, dtype=np.float64)
    return pa.Array.from_buffers(pa.float64(), len(x), [None, pa.py_buffer(x.data)])


def read_provenance(path: Path) -> dict[str, Any]:
    """What `SignalsWriter` wrote into a file's metadata."""
    found: dict[str, Any] = json.loads((pq.read_metadata(path).metadata or {})[METADATA.encode()])
    return found


def read_signals(path: Path) -> Result:
    """A file that `SignalsWriter` wrote. UserError: not such a file."""
    try:
        table, facts = pq.read_table(path), read_provenance(path)
    except (pa.ArrowInvalid, KeyError, OSError) as error:
        raise UserError(f"{path}: not a signals file of cobot-joint: {' '.join(str(error).split())}") from error
    columns = {name.rpartition(" [")[0]: name for name in table.column_names}
    signals = {name: table[column].to_numpy() for name, column in columns.items()}
    units = {name: column.rpartition(" [")[2].removesuffix("]") for name, column in columns.items() if name != "time"}
    energy = {name: tuple(works) for name, works in facts.get("energy", {}).items()}
    time = signals.pop("time")
    return Result(time, signals, energy, str(facts.get("scheme", "")), float(facts.get("step", 0.0)), units, facts)


def read_json(path: Path) -> dict[str, Any]:
    """A file with one JSON object. UserError: not such a file."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: not a JSON file: {error}") from error
    if not isinstance(found, dict):
        raise UserError(f"{path}: a JSON object is needed")
    return found


def write_text(path: Path, text: str) -> Path:
    """A whole file or none."""
    write_atomically(path, lambda file: file.write_text(text, encoding="utf-8"))
    return path


def write_csv(path: Path, headers: Sequence[str], rows: Sequence[Sequence[object]]) -> Path:
    """A table for people and spreadsheets; numbers with nine digits."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(headers)
    table.writerows([f"{v:.9g}" if isinstance(v, float) else v for v in row] for row in rows)
    return write_text(path, text.getvalue())
