"""How much a command says, and in which form."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table as Grid

from cobot_joint.screen import Screen

if TYPE_CHECKING:
    from cobot_joint.scenario.report import Table

console = Screen()
if not console.is_terminal and "COLUMNS" not in os.environ:
    console = Screen(width=200)  # for a file or another program: a row is a line


@dataclass
class Output:
    """How much is said, and in which form."""

    verbose: bool = False
    as_json: bool = False


output = Output()


def say_json(content: object) -> None:
    """On stdout, where `--json` is given."""
    if output.as_json:
        print(json.dumps(content, indent=1))


def grid_of(table: Table) -> Grid:
    grid = Grid(title=escape(table.title), title_justify="left", title_style="bold")
    for k, name in enumerate(table.headers):
        texts = [isinstance(row[k], str) for row in table.rows]
        left = all(texts) or (k == 0 and any(texts))
        grid.add_column(escape(name), justify="left" if left else "right", overflow="fold")
    for row in table.rows:
        grid.add_row(*(escape(cell) if isinstance(cell, str) else f"{cell:.5g}" for cell in row))
    return grid


@contextmanager
def progress_bar(name: str) -> Iterator[Any]:
    """A bar on stderr with the time left; a callback of (done, of) in s of bench time."""
    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.0f} of {task.total:.0f} s")
    stderr = Screen(stderr=True)
    times = TimeElapsedColumn(), TimeRemainingColumn()
    with Progress(*columns, *times, console=stderr, transient=True, disable=not stderr.is_terminal) as bar:
        task = bar.add_task(name, total=1.0)
        yield lambda done, total: bar.update(task, completed=done, total=total)
