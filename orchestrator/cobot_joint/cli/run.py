"""`cobot-joint run` and `demo`: a scenario, its tables and where its files are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table as Grid

from cobot_joint.cli.options import Changes
from cobot_joint.cli.output import console, grid_of, progress_bar, say_json
from cobot_joint.files import results_folder

if TYPE_CHECKING:
    from cobot_joint.scenario.report import Report

HELP = """Run a scenario: signals.parquet, pictures and a summary.

SCENARIO is a shipped one (`--list` shows them), a .toml file, or a system by name or as .ssd or .ssp file, which runs
its default experiment.

\b
Examples:
  cobot-joint run load_mr_brake
  cobot-joint run load_mr_brake --set stop_time=5 --set motor_bldc.winding.R=0.22
  cobot-joint run no_load --level comprehensive --scheme iterative --step 1e-3
  cobot-joint run load_mr_brake --unit planetary_gear=my_gear.fmu
  cobot-joint run load_mr_brake --unit planetary_gear=my_gear.fmu:tau=tau_m,w_o=-speed,J_coupled=
  cobot-joint run my_system.ssp --out results/mine

\b
Coupling schemes:
  jacobi                     all units at once, inputs held over a step
  gauss_seidel               one after the other, inputs interpolated
  gauss_seidel_extrapolated  the same, feedback continued quadratically
  iterative                  swept again until the feedback is met
  adaptive                   step controlled by the coupling error (default)
  monolithic                 units of ours as one system of equations, not stepped by themselves
"""


def _list(wanted: bool) -> None:
    if wanted:
        list_scenarios()
        raise typer.Exit


def _scenarios(begun: str) -> list[str]:
    """For the shell, whose Tab completes what was begun."""
    from cobot_joint.scenario.model import scenario_names

    return [name for name in scenario_names() if name.startswith(begun)]


Scenario = Annotated[str, typer.Argument(help="A scenario or system, by name or as a file.", autocompletion=_scenarios)]
Out = Annotated[Path | None, typer.Option(help="Folder for the results.", show_default="results/SCENARIO")]
List = Annotated[bool, typer.Option("--list", callback=_list, is_eager=True, help="Show the scenarios.")]

_NONE = Changes()


def run(scenario: Scenario, out: Out = None, show_list: List = False, changes: Changes = _NONE) -> None:
    """See HELP."""
    say_json(_content(run_and_show(scenario, out, changes)))


def demo(out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("results")) -> None:
    """The bench in a minute: its frequency response against the measured Table C.1, then the load test."""
    reports = [run_and_show(name, out / name, Changes()) for name in ("frequency_response", "load_mr_brake")]
    pictures = [path for report in reports for path in report.files if path.suffix == ".png"]
    console.print("\n".join(["\nThe pictures are", *(f"  {path}" for path in pictures)]), style="bold", soft_wrap=True)
    say_json([_content(report) for report in reports])


def run_and_show(scenario: str, out: Path | None, changes: Changes) -> Report:
    """Run a scenario with a progress bar, print its tables and where its files are."""
    from cobot_joint.results.draw import Stills

    with Stills() as stills:
        from cobot_joint.scenario.model import load_scenario
        from cobot_joint.scenario.run import run_scenario

        loaded, options = load_scenario(scenario, changes.settings()), changes.options()
        target = results_folder(out or Path("results") / loaded.name)
        with progress_bar(loaded.name) as progress:
            report = run_scenario(loaded, target, options, progress, stills)
    show(report)
    return report


def show(report: Report) -> None:
    """Tables, then files with what they show."""
    console.print(f"\n[bold]{escape(report.title)}[/bold]")
    for table in report.tables:
        console.print(grid_of(table))
    for path, what in report.files.items():
        console.print(f"{escape(str(path))}  [dim]{escape(what)}[/dim]", soft_wrap=True)


def list_scenarios() -> None:
    """One line per scenario: its name, what it does, and the settings that `--set` changes."""
    from cobot_joint.scenario.model import load_scenario, scenario_names, settings_of

    grid = Grid(box=None, pad_edge=False)
    for heading in ("scenario", "what it does", "settings"):
        grid.add_column(heading, overflow="fold")
    for scenario in map(load_scenario, scenario_names()):
        settings = ", ".join(f"{name}={value}" for name, value in settings_of(scenario).items())
        grid.add_row(scenario.name, escape(scenario.title), escape(settings))
    console.print(grid)


def _content(report: Report) -> dict[str, Any]:
    tables = [
        {"title": t.title, "headers": list(t.headers), "rows": [list(row) for row in t.rows]} for t in report.tables
    ]
    return {
        "title": report.title,
        "values": report.values,
        "tables": tables,
        "files": {str(path): what for path, what in report.files.items()},
    }
