"""The command `cobot-joint`.

Exit status: 0 done; 2 the call or a file is wrong (a line on stderr); 130 interrupted; 1 anything else.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table as Grid

from cobot_joint.diagnosis import commands as diagnosis
from cobot_joint.diagnosis import own_bench
from cobot_joint.errors import UserError, among
from cobot_joint.files import results_folder, what_is_missing, write_atomically
from cobot_joint.interrupts import Interrupted, interruptible
from cobot_joint.scenario.report import Report, Table

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="A cobot joint's test bench: run it, export it, compare it with recordings.",
)
console = Console()
if not console.is_terminal:
    console = Console(width=200)

Out = Annotated[Path | None, typer.Option(help="Folder for the results.", show_default="results/SCENARIO")]
Level = Annotated[
    str | None, typer.Option(help="transfer_function, averaged, simscape or comprehensive: the motor's model.")
]
Step = Annotated[float | None, typer.Option(help="Communication step, s.", show_default="the scheme's own")]
Scheme = Annotated[str | None, typer.Option(help="Coupling scheme.", show_default="the scenario's, or the default")]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="A unit's parameter (motor_bldc.winding.R=0.22) or a setting of the scenario (stop_time=5); repeatable.",
    ),
]


@app.command()
def run(
    scenario: Annotated[str, typer.Argument(help="A shipped scenario by name, or a .toml file.")],
    out: Out = None,
    level: Level = None,
    step: Step = None,
    scheme: Scheme = None,
    set_: Set = None,
) -> None:
    """Run a scenario: signals.parquet, pictures and a summary."""
    run_and_show(scenario, out, level, step, scheme, set_ or [])


@app.command()
def demo(out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("results")) -> None:
    """The bench in a minute: its frequency response against the measured Table C.1, then the load test."""
    pictures: list[Path] = []
    for scenario in ("frequency_response", "load_mr_brake"):
        report = run_and_show(scenario, out / scenario, None, None, None, [])
        pictures += [path for path in report.files if path.suffix == ".png"]
    console.print("\n".join(["\nThe pictures are", *(f"  {path}" for path in pictures)]), style="bold", soft_wrap=True)


@app.command()
def export(
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("export"),
    system: Annotated[str, typer.Option(help="A shipped system by name, or an .ssd or .ssp file.")] = "joint",
) -> None:
    """The units as FMUs, and the system as one .ssp, for other simulators."""
    from cobot_joint.system import fmu_names, load_system, write_ssp

    loaded = load_system(system)
    results_folder(out)
    names = fmu_names(loaded)
    for name, path in {names[c.name]: c.unit.path for c in loaded.components}.items():
        write_atomically(out / name, partial(_copy, path))
        console.print(out / name)
    console.print(write_ssp(loaded, out / f"{loaded.name}.ssp"))


def run_and_show(
    scenario: str, out: Path | None, level: str | None, step: float | None, scheme: str | None, assignments: list[str]
) -> Report:
    """Run a scenario with a progress bar, print its tables and where its files are."""
    from cobot_joint.scenario import load_scenario
    from cobot_joint.scenario.options import Options
    from cobot_joint.scenario.run import run_scenario

    given = dict(_assignment(text) for text in assignments)
    settings = {name: value for name, value in given.items() if "." not in name}
    parameters = {name: value for name, value in given.items() if "." in name}
    loaded = load_scenario(scenario, settings)
    options = Options(level, step, scheme, parameters)
    target = results_folder(out or Path("results") / loaded.name)
    with _progress(loaded.name) as progress:
        report = run_scenario(loaded, target, options, progress)
    show(report)
    return report


def show(report: Report) -> None:
    """Tables, then files with what they show."""
    console.print(f"\n[bold]{report.title}[/bold]")
    for table in report.tables:
        console.print(_grid(table))
    for path, what in report.files.items():
        console.print(f"{path}  [dim]{what}[/dim]", soft_wrap=True)


def _copy(source: Path, file: Path) -> None:
    file.write_bytes(source.read_bytes())


def _assignment(text: str) -> tuple[str, str]:
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise UserError(f"--set {text!r} is given, NAME=VALUE is allowed, for example motor_bldc.winding.R=0.22")
    return name, value


def _grid(table: Table) -> Grid:
    grid = Grid(title=table.title, title_justify="left", title_style="bold")
    for k, name in enumerate(table.headers):
        text = any(isinstance(row[k], str) for row in table.rows)
        grid.add_column(name.replace("[", r"\["), justify="left" if text and k == 0 else "right")
    for row in table.rows:
        grid.add_row(*(cell.replace("[", r"\[") if isinstance(cell, str) else f"{cell:.5g}" for cell in row))
    return grid


@contextmanager
def _progress(name: str) -> Iterator[Any]:
    """A bar on stderr with the time left; a callback of (done, of) in s of bench time."""
    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.0f} of {task.total:.0f} s")
    stderr = Console(stderr=True)
    times = TimeElapsedColumn(), TimeRemainingColumn()
    with Progress(*columns, *times, console=stderr, transient=True, disable=not stderr.is_terminal) as bar:
        task = bar.add_task(name, total=1.0)
        yield lambda done, total: bar.update(task, completed=done, total=total)


diagnosis.register(app)
for command in (own_bench.inspect, own_bench.new):
    app.command()(command)


def main() -> None:
    """Entry point."""
    sys.exit(_status())


def _status() -> int:
    try:
        with interruptible():
            return int(app(standalone_mode=False) or 0)
    except Interrupted as how:
        return _say(", ".join(["interrupted", *how.args]), 130)
    except UserError as error:
        return _say(error, 2)
    except typer.TyperException as error:
        return _say(_usage(error), 2)
    except OSError as error:
        return _say(what_is_missing(error), 1)
    except RuntimeError as error:  # a unit failed while it ran: SimulationError says which and when
        from cobot_joint.cosim import SimulationError

        if not isinstance(error, SimulationError):
            raise
        return _say(error, 1)


def _usage(error: typer.TyperException) -> str:
    message = " ".join(error.format_message().split())
    if message.startswith("No such command"):
        message += f" Allowed are {among(sorted(c.name or c.callback.__name__ for c in app.registered_commands))}."  # type: ignore[union-attr]
    return message


def _say(what: object, status: int) -> int:
    print(f"cobot-joint: {' '.join(str(what).split())}", file=sys.stderr)
    return status


if __name__ == "__main__":
    main()
