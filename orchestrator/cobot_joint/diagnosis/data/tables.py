"""Tables: speed, load -> torque, one row per steady state. Time is only the order in which rows are visited."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.recording import ROWS, Column, Connector, Reading, Recording, read_recording, said_once
from cobot_joint.errors import UserError, among

Vector = NDArray[np.float64]
PARTS = 10  # of a file, whose means say how well its mean is known
HOLD, PER_HOLD = 2.0, 40  # s that a row is held, half of it on the way from the last one; samples of it


def read_table(
    files: Sequence[Path],
    connectors: Mapping[str, Connector],
    columns: Mapping[str, Column | str],
    reading: Reading,
    hold: float = HOLD,
) -> Recording:
    """One recording whose rows are held one after the other; outputs count at the end of each hold only.

    reading.table: "mean", each file is one row, the mean of its channels; "rows", each line of a file is one, without a
    clock. `scatter` is 1 sigma of an output's rows: by how the means of parts of a file differ, or by rows about their
    neighbours, whichever is less. UserError: too few rows, a wrong file.
    """
    runs = [read_recording(file, connectors, columns, reading) for file in files]
    first = runs[0]
    inputs, outputs = ({n: None for r in runs for n in getattr(r, part)} for part in ("inputs", "outputs"))
    rows = {name: np.concatenate([_rows(r, name, reading.table) for r in runs]) for name in inputs | outputs}
    if not inputs:
        raise UserError(f"{files[0]}: a table needs an input that its rows differ by, {among(connectors)} are there")
    if short := next(((r, n) for r in runs for n in inputs if n not in r.inputs), None):
        raise UserError(f"{short[0].path}: it has no {short[1]!r}, which other rows of the table have")
    known = np.all([np.isfinite(rows[n]) for n in inputs], axis=0)
    known &= np.any([np.isfinite(rows[n]) for n in outputs], axis=0)
    rows = {name: x[known] for name, x in rows.items()}
    if (count := int(known.sum())) < ROWS:
        raise UserError(f"{files[0]}: a table of {count} rows is given, {ROWS} at least are needed")
    order = np.lexsort([rows[name] for name in reversed(list(inputs))])
    rows = {name: x[order] for name, x in rows.items()}
    time = np.arange(count * PER_HOLD + 1) * (hold / PER_HOLD)
    return replace(
        first,
        name=files[0].parent.name if len(files) > 1 else files[0].stem,
        time=np.asarray(time, dtype=np.float64),
        inputs={name: _held(rows[name], len(time)) for name in inputs},
        outputs={name: _at_the_ends(rows[name], len(time)) for name in outputs},
        scatter={name: _noise(runs, reading.table, [rows[n] for n in inputs], rows[name], name) for name in outputs},
        differences={},  # a row is a steady state
        units={name: unit for r in runs for name, unit in r.units.items()},
        notes=said_once([(r.path.name if r.path else r.name, r.notes) for r in runs]),
        path=files[0],
    )


def _rows(r: Recording, name: str, kind: str | None) -> Vector:
    x = (r.inputs | r.outputs).get(name, np.full(len(r.time), np.nan))  # a file without that output
    if not np.isfinite(x).any():
        return x if kind == "rows" else np.array([np.nan])
    return x if kind == "rows" else np.array([np.nanmean(x)])


def _held(rows: Vector, samples: int) -> Vector:
    """From each row to the next in the first half of its hold."""
    corners = np.arange(len(rows)) * PER_HOLD
    knots = np.concatenate([[0], np.column_stack([corners + PER_HOLD // 2, corners + PER_HOLD]).ravel()])
    return np.interp(np.arange(samples), knots, np.concatenate([rows[:1], np.repeat(rows, 2)]))


def _at_the_ends(rows: Vector, samples: int) -> Vector:
    series = np.full(samples, np.nan)
    series[(np.arange(len(rows)) + 1) * PER_HOLD] = rows
    return series


def _noise(runs: Sequence[Recording], kind: str | None, inputs: Sequence[Vector], y: Vector, name: str) -> float:
    """1 sigma of a row."""
    there = np.isfinite(y)
    among_rows = scatter([x[there] for x in inputs], y[there])
    errors = [error_of_mean(r.outputs[name]) for r in runs if name in r.outputs] if kind == "mean" else []
    known = [e for e in errors if np.isfinite(e) and e > 0]
    return min(float(np.sqrt(np.mean(np.square(known)))), among_rows) if known else among_rows


def error_of_mean(y: Vector) -> float:
    """1 sigma of a series' mean, by those of its parts, which are to be longer than it remembers. NaN: too short."""
    parts = [part[np.isfinite(part)] for part in np.array_split(y, PARTS)]
    if min(len(part) for part in parts) < 2:
        return float("nan")
    return float(np.std([part.mean() for part in parts], ddof=1) / np.sqrt(PARTS))


def scatter(inputs: Sequence[Vector], y: Vector) -> float:
    """1 sigma of rows about the straight line between their neighbours in the inputs; a jump does not count.

    A row's distance from that line has the variance sigma^2 (1 + a^2 + (1 - a)^2), a the share of one neighbour. The
    median of absolute values over that of the normal distribution, 0.6745, is robust (Huber 1981, Robust Statistics).
    """
    x = inputs[0]
    gap = np.maximum(x[2:] - x[:-2], 1e-300)
    a = np.where(x[2:] > x[:-2], (x[2:] - x[1:-1]) / gap, 0.5)
    rest = y[1:-1] - a * y[:-2] - (1 - a) * y[2:]
    return float(np.median(np.abs(rest) / np.sqrt(1 + a**2 + (1 - a) ** 2)) / 0.6745)
