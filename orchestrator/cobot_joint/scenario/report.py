"""The result of a scenario: files, pictures, and tables for the screen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cobot_joint.results.figures import Picture

Progress = Callable[[float, float], None]  # (done, of) in s of bench time


@dataclass(frozen=True)
class Table:
    """Headers with units in brackets; cells are numbers or text."""

    title: str
    headers: Sequence[str]
    rows: Sequence[Sequence[float | str]]


@dataclass
class Report:
    """`files`: path -> what it shows; `pictures`: to be drawn; `values`: figures by name, as in `summary.json`."""

    title: str
    tables: list[Table] = field(default_factory=list)
    files: dict[Path, str] = field(default_factory=dict)
    pictures: list[Picture] = field(default_factory=list)
    values: dict[str, float | str] = field(default_factory=dict)
