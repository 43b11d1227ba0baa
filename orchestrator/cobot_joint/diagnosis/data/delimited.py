"""Delimited text as loggers write it: preamble, names, a row of units, any separator, decimal sign and encoding."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import pyarrow as pa
import pyarrow.csv

from cobot_joint.diagnosis.data.quantity import LONGEST_HEADER, is_duration, is_unit, split_header
from cobot_joint.errors import UserError

SAMPLE = 400  # lines from which the layout is guessed
LONGEST_LINE = 100_000  # characters
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE)
# a time of day, the date before it in any order: 2024-01-31T12:00:00.5Z, 31.01.2024 12:00:00,5, 1/31/2024 2:00:00 PM
STAMP = re.compile(
    r"(?:\d{1,4}[-./]\d{1,2}[-./]\d{2,4}(?:[ T]|, ?))?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(?::(?P<second>\d\d(?:[.,:]\d+)?))?"
    r"(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?(?: ?(?:Z|UTC|GMT|[+-]\d\d:?(?:\d\d)?))?"
)
STAMP_WITH_COMMA = re.compile(r"(\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d),(?=\d)")
CLOCK = re.compile(r"\d{1,2}:\d\d|\d{1,2}[./]\d{1,2}[./]\d{2,4}")  # begins as one, or as a date
DAY = 86400.0  # s
SEPARATORS = (";", "\t", ",", "|", " ")
NAMES = {"tab": "\t", "space": " ", "blank": " "}
NULLS = ["", "nan", "NaN", "NAN", "-nan", "-NaN", "null", "NULL", "NA", "N/A", "#N/A", "n/a"]


@dataclass(frozen=True)
class Layout:
    """What a campaign says of a text file; None: guessed."""

    skip: int | None = None  # lines above the line of names
    separator: str | None = None
    encoding: str | None = None
    decimal: str | None = None


@dataclass(frozen=True)
class Table:
    """Columns as arrow arrays under their headers, `name [unit]`, in the file's order; and what had to be said."""

    headers: list[str]
    columns: list[pa.ChunkedArray]
    first_line: int  # of the data, counted from 1
    notes: list[str]


def read_delimited(path: Path, layout: Layout) -> Table:
    """Read a text file. UserError: no layout fits, a row has too many or too few cells."""
    text, encoding = _decoded(path, layout.encoding)
    lines = _sample(path, text)
    notes: list[str] = []
    if _is_wrapped(lines):
        text, beside = _unwrapped(text)
        lines = _sample(path, text)
        notes = [f"a spreadsheet has put {len(beside)} cells beside the log, left out: {beside[0]!r}"] if beside else []
    if layout.skip is not None and layout.skip >= len(lines):
        raise UserError(f"{path}: skip = {layout.skip} is given, fewer than its first {len(lines)} lines are allowed")
    separator = NAMES.get(layout.separator or "", layout.separator) or _separator(lines[layout.skip or 0 :])
    if separator not in SEPARATORS and len(separator) != 1:
        raise UserError(f'{path}: separator {separator!r} is given, one character, "tab" or "space" is allowed')
    if separator != "," and any(STAMP_WITH_COMMA.search(line) for line in lines):
        text = STAMP_WITH_COMMA.sub(r"\1.", text)
        lines = _sample(path, text)
    rows = _without_end([_cells(line, separator) for line in lines])
    if not any(map(_is_data, rows)):
        first = next((row[0] for row in rows[len(rows) // 2 :] if row), "")
        clock = f"; {first!r} is no time: seconds or 2024-01-31 12:00:00.5 are read" if CLOCK.match(first) else ""
        raise UserError(f"{path}: no row of numbers is in its first {len(lines)} lines (read as {encoding}){clock}")
    start, headers = _headers(rows, layout.skip)
    decimal = layout.decimal or _decimal(path, rows[start:], separator, text)
    if separator == " ":
        text = "\n".join(" ".join(line.split()) for line in text.splitlines())
    table = _parsed(path, text, start, headers, separator, decimal)
    return replace(table, notes=notes + table.notes)


def _decoded(path: Path, encoding: str | None) -> tuple[str, str]:
    """The text and the encoding in which it was read: as given, by its first bytes, UTF-8, else Latin-1."""
    content = path.read_bytes()
    if encoding is None:
        marks = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}
        encoding = next((name for mark, name in marks.items() if content.startswith(mark)), "utf-8")
        try:
            return content.decode(encoding), encoding
        except UnicodeDecodeError:
            encoding = "latin-1"
    try:
        return content.decode(encoding).removeprefix("\ufeff"), encoding
    except LookupError as error:
        raise UserError(
            f'{path}: encoding {encoding!r} is given, a name such as "utf-8" or "latin-1" is needed'
        ) from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: it is not {encoding}: byte {error.start} is {content[error.start]:#x}") from error


def _sample(path: Path, text: str) -> list[str]:
    """The first lines. UserError: none, or lines as no log has them."""
    if "\x00" in text[:10_000]:
        raise UserError(f"{path}: it holds zero bytes, a text file is needed")
    lines: list[str] = []
    at = 0
    while at < len(text) and len(lines) < SAMPLE:
        end = text.find("\n", at)
        end = len(text) if end < 0 else end
        if end - at > LONGEST_LINE:
            raise UserError(
                f"{path}: line {len(lines) + 1} has {end - at} characters, a log's line has at most {LONGEST_LINE}"
            )
        lines.append(text[at:end].rstrip("\r"))
        at = end + 1
    if not any(line.strip() for line in lines):
        raise UserError(f"{path}: cannot be read as csv: it is empty")
    return lines


def _is_wrapped(lines: Sequence[str]) -> bool:
    """A log in the first column of a spreadsheet: each line carries the commas of its empty cells."""
    filled = [line for line in lines if line.strip()]
    return len(filled) > 2 and sum(line.endswith(",,") and ";" in line for line in filled) > 0.9 * len(filled)


def _unwrapped(text: str) -> tuple[str, list[str]]:
    """The first cell of each line, and what stood in others."""
    rows = list(csv.reader(io.StringIO(text)))
    return "\n".join(row[0] if row else "" for row in rows), [cell for row in rows for cell in row[1:] if cell.strip()]


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    parts = next(csv.reader([line], delimiter=separator)) if '"' in line else line.split(separator)
    return [cell.strip().strip('"').strip() for cell in parts]


def _without_end(rows: list[list[str]]) -> list[list[str]]:
    """Less the empty cell behind a separator that ends every row of numbers; under a name it is an empty column."""
    data = [k for k, row in enumerate(rows) if _is_data(row)]
    whole = data[:-1] or data  # the last may have been cut
    width = len(rows[whole[0]]) if whole else 0
    named = any(len(row) == width and row[-1] for row in rows[max(data[0] - 2, 0) : data[0]]) if data else False
    if named or not all(len(rows[k]) > 1 and not rows[k][-1] for k in whole):
        return rows
    return [row[:-1] if len(row) > 1 and not row[-1] else row for row in rows]


def seconds_of_day(cells: Sequence[str | None]) -> list[float] | None:
    """Of stamps, NaN where a cell is empty; a day later where they begin anew. None: one cell is no stamp.

    Days are counted by midnights alone: whether 01/02 is in January, the steps of a log are the same.
    """
    found, days, before = list[float](), 0.0, 0.0
    for cell in cells:
        stamp = STAMP.fullmatch(cell.strip()) if cell else None
        if cell and cell.strip() and stamp is None:
            return None
        if stamp is None:
            found.append(float("nan"))
            continue
        hour = int(stamp["hour"])
        if stamp["half"]:
            hour = hour % 12 + (12 if stamp["half"] in "Pp" else 0)
        second = re.sub("[,:]", ".", stamp["second"] or "0")
        of_day = 3600.0 * hour + 60.0 * int(stamp["minute"]) + float(second)
        days += DAY if of_day < before - DAY / 2 else 0.0
        before = of_day
        found.append(days + of_day)
    return found


def _number(cell: str) -> bool:
    return bool(NUMBER.fullmatch(cell) or STAMP.fullmatch(cell))


def _is_data(row: Sequence[str]) -> bool:
    """Its first cell is a number or a time stamp, or most of its cells are."""
    filled = [cell for cell in row if cell]
    return bool(filled) and (_number(row[0]) or 2 * sum(map(_number, filled)) > len(filled))


def _separator(lines: Sequence[str]) -> str:
    """That which cuts most of the sample's last lines into as many cells, more than one, and most of them numbers."""

    def fits(separator: str) -> tuple[float, int]:
        rows = [_cells(line, separator) for line in lines[len(lines) // 2 :] if line.strip()]
        (width, often), *_ = Counter(map(len, rows)).most_common(1) or [(0, 0)]
        cells = [cell for row in rows if len(row) == width for cell in row if cell]
        numbers = sum(map(_number, cells)) / len(cells) if cells else 0.0
        return (often / max(len(rows), 1) * numbers if width > 1 else 0.0), width

    best = max(SEPARATORS, key=fits)
    return best if fits(best)[0] > 0 else ","


def _headers(rows: Sequence[Sequence[str]], skip: int | None) -> tuple[int, list[str]]:
    """Index of the first row of data, and `name [unit]` per column. skip: rows above the names, where it is known."""
    data = [k for k, row in enumerate(rows) if k >= (skip or 0) and _is_data(row)]
    width = Counter(len(rows[k]) for k in data[len(data) // 2 :]).most_common(1)[0][0]
    start = next(k for k in data if len(rows[k]) == width)
    above = [k for k in range(skip or 0, start) if any(rows[k])]
    if skip is not None and above:
        names, units = rows[above[0]], rows[above[1]] if len(above) > 1 else []
    elif len(above) > 1 and _is_units(rows[above[-1]]) and _is_names(rows[above[-2]], width):
        names, units = rows[above[-2]], rows[above[-1]]
    else:
        names, units = rows[above[-1]] if above else [], []
    if names and len(names) == width + 1 and (names[0] in ("#", "%") or not names[-1]):
        names = names[1:] if names[0] in ("#", "%") else names[:-1]
    headers = [_header(names, units, k) for k in range(max(width, len(names)))]
    return start, headers


def _header(names: Sequence[str], units: Sequence[str], k: int) -> str:
    name = names[k].lstrip("#%").strip() if k < len(names) else ""
    unit = units[k].removeprefix("[").removesuffix("]").strip() if k < len(units) else ""
    if not name:
        name = "time" if k == 0 and unit and is_duration(unit) else f"column_{k + 1}"
    return f"{name} [{unit}]" if unit and len(name) < LONGEST_HEADER and split_header(name)[1] is None else name


def _is_names(row: Sequence[str], width: int) -> bool:
    filled = [cell for cell in row if cell]
    return len(row) in (width, width + 1) and len(set(filled)) == len(filled) >= 1 and not any(map(_number, filled))


def _is_units(row: Sequence[str]) -> bool:
    """Only units of measure, and one at least that is nothing else: in brackets, a quotient, a percentage, a time."""
    filled = [cell for cell in row if cell]
    marked = any(cell.startswith("[") or any(c in cell for c in "/%°") or is_duration(cell) for cell in filled)
    return bool(filled) and all(map(is_unit, filled)) and marked


def _decimal(path: Path, rows: Sequence[Sequence[str]], separator: str, text: str) -> str:
    """text: all of it, where the first rows are whole numbers. Between commas a number with a comma is quoted."""
    cells = [cell for row in rows for cell in row if NUMBER.fullmatch(cell)]
    commas, points = sum("," in c for c in cells), sum("." in c for c in cells)
    if not commas and not points and separator != ",":
        numbers = STAMP.sub("", text)
        commas, points = (len(re.findall(rf"\d\{sign}\d", numbers)) for sign in ",.")
        points = 0 if commas > points else points  # of names
    if not commas:
        return "."
    if points:
        raise UserError(f'{path}: both 1,5 and 1.5 occur among its numbers: say decimal = "," or "."')
    return ","


def _parsed(path: Path, text: str, start: int, headers: list[str], separator: str, decimal: str) -> Table:
    """The rows from `start` on. A last row that was cut when the logger was switched off is said, others refused."""
    notes: list[str] = []
    bad: list[pa.csv.InvalidRow] = []
    width = len(headers)

    def invalid(row: pa.csv.InvalidRow) -> Literal["skip"]:
        bad.append(row)
        return "skip"

    at = 0
    for _ in range(start):
        at = text.index("\n", at) + 1
    body = text[at:]
    first = body[: body.find("\n")] if "\n" in body else body
    trailing = separator != " " and first.rstrip("\r").endswith(separator)  # each row ends with a separator
    names = [str(k) for k in range(width + (1 if trailing and first.count(separator) == width else 0))]
    table = pa.csv.read_csv(
        io.BytesIO(body.encode()),
        read_options=pa.csv.ReadOptions(column_names=names, use_threads=False),
        parse_options=pa.csv.ParseOptions(delimiter=separator, invalid_row_handler=invalid),
        convert_options=pa.csv.ConvertOptions(decimal_point=decimal, null_values=NULLS, strings_can_be_null=True),
    )
    last = body.rstrip().rpartition("\n")[2].rstrip("\r")
    for row in bad:
        if row.text.strip() == last.strip() and row is bad[-1]:
            notes.append(f"the last row has {row.actual_columns} cells of {len(names)}, left out")
        else:
            line = text.count("\n", 0, text.find(row.text)) + 1
            raise UserError(
                f"{path}: line {line} has {row.actual_columns} cells, {len(names)} are needed: {row.text[:60]!r}"
            )
    return Table(headers, [table.column(k) for k in range(width)], start + 1, notes)
