"""The command `cobot-joint`.

Exit status: 0 done; 2 the call or a file is wrong (a line on stderr); 130 interrupted; 1 anything else.
Nothing that simulates is imported before it is needed: a person who asks for help gets it at once.
"""

from __future__ import annotations

import inspect
import json
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from enum import Enum
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table as Grid

from cobot_joint.diagnosis import commands as diagnosis
from cobot_joint.diagnosis import own_bench
from cobot_joint.errors import UserError, among, printable
from cobot_joint.files import results_folder, what_is_missing
from cobot_joint.interrupts import Interrupted, interruptible
from cobot_joint.live import command as live
from cobot_joint.precautions import Precautions, common_first
from cobot_joint.screen import Screen
from cobot_joint.version import __version__

if TYPE_CHECKING:
    from cobot_joint.scenario.options import Options
    from cobot_joint.scenario.report import Report, Table

HELP = """A cobot joint's test bench: run it, compare it with recordings, export it.

-q, -v, --json, --isolate and limits may stand anywhere in the call.
"""
RUN_HELP = """Run a scenario: signals.parquet, pictures and a summary.

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
"""

CHECK_HELP = """Whether an FMU of yours can take a component's place, and what it lacks.

Looks at its ports, runs it alone, and says in words what is missing: `no` means that it cannot be used as it is (exit
status 1), `lacks` that something is done without, and what that costs.

\b
Examples:
  cobot-joint check my_gear.fmu --as planetary_gear
  cobot-joint check my_gear.fmu:tau=tau_m,w_o=-speed,J_coupled= --as planetary_gear
"""

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help=HELP,
)
console = Screen()
if not console.is_terminal and "COLUMNS" not in os.environ:
    console = Screen(width=200)  # for a file or another program: a row is a line


class Importer(Enum):
    """For whom a system is exported."""

    ANY = "any"
    ECOS = "ecos"
    LIBCOSIM = "libcosim"


@dataclass
class Output:
    """How much is said, and in which form."""

    verbose: bool = False
    as_json: bool = False


output = Output()
WITHOUT_JSON = {"inspect", "new", "open", "prove"}


def _version(wanted: bool) -> None:
    if wanted:
        print(f"cobot-joint {__version__}")
        raise typer.Exit


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


@dataclass(frozen=True)
class Changes:
    """What a caller changes on a scenario: options of `run`."""

    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="A parameter (motor_bldc.winding.R=0.22) or a setting of the scenario (stop_time=5); repeatable.",
        ),
    ] = None
    unit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=FILE[:PORTS]",
            help="An FMU in a component's place; PORTS where its names differ: tau=tau_m,w=-speed; repeatable.",
        ),
    ] = None
    level: Annotated[
        str | None, typer.Option(help="transfer_function, averaged, simscape or comprehensive: the motor's model.")
    ] = None
    scheme: Annotated[
        str | None, typer.Option(help="Coupling scheme, see below.", show_default="the scenario's, or adaptive")
    ] = None
    step: Annotated[float | None, typer.Option(help="Communication step, s.", show_default="the scheme's own")] = None

    def settings(self) -> dict[str, str]:
        """Of `--set`, the scenario's."""
        return {name: value for name, value in self._set().items() if "." not in name}

    def options(self) -> Options:
        """The rest of them. UserError: a level that there is not."""
        from cobot_joint.scenario.options import Options

        parameters = {name: value for name, value in self._set().items() if "." in name}
        units = _pairs("--unit", self.unit, "NAME=FILE is allowed, for example planetary_gear=my_gear.fmu")
        return Options(self.level, self.step, self.scheme, parameters, units)

    def _set(self) -> dict[str, str]:
        return _pairs("--set", self.set_, "NAME=VALUE is allowed, for example motor_bldc.winding.R=0.22")


_NONE = Changes()
_NO_PRECAUTIONS = Precautions()


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """The command, whose last argument is a dataclass of options, with a command-line option for each of its fields."""
    *own, last = inspect.signature(command, eval_str=True).parameters.values()
    types = get_type_hints(last.annotation, include_extras=True)
    names = [field.name for field in fields(last.annotation)]
    options = [inspect.Parameter(n, last.KEYWORD_ONLY, default=None, annotation=types[n]) for n in names]

    @wraps(command)
    def called(**given: Any) -> None:
        together = last.annotation(**{name: given[name] for name in names})
        command(**{p.name: given[p.name] for p in own}, **{last.name: together})

    called.__signature__ = inspect.Signature([*own, *options])  # type: ignore[attr-defined]
    called.__annotations__ = {p.name: p.annotation for p in (*own, *options)}
    return called


@app.callback()
@with_options
def common(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show it.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Trace an error to where it arose.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Say the answer as JSON.")] = False,
    precautions: Precautions = _NO_PRECAUTIONS,
) -> None:
    """What holds for every command."""
    precautions.take(context)
    if as_json and context.invoked_subcommand in WITHOUT_JSON:
        allowed = among(sorted(set(_commands()) - WITHOUT_JSON))
        raise UserError(f"--json is given with {context.invoked_subcommand}; allowed it is with {allowed}")
    output.verbose, output.as_json = verbose, as_json
    for one in (console, diagnosis.console, own_bench.console, live.console):
        one.quiet = quiet or as_json


@app.command(help=RUN_HELP)
@with_options
def run(scenario: Scenario, out: Out = None, show_list: List = False, changes: Changes = _NONE) -> None:
    """See RUN_HELP."""
    say_json(_content(run_and_show(scenario, out, changes)))


@app.command()
def demo(out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("results")) -> None:
    """The bench in a minute: its frequency response against the measured Table C.1, then the load test."""
    reports = [run_and_show(name, out / name, Changes()) for name in ("frequency_response", "load_mr_brake")]
    pictures = [path for report in reports for path in report.files if path.suffix == ".png"]
    console.print("\n".join(["\nThe pictures are", *(f"  {path}" for path in pictures)]), style="bold", soft_wrap=True)
    say_json([_content(report) for report in reports])


@app.command()
def export(
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("export"),
    system: Annotated[str, typer.Option(help="A shipped system by name, or an .ssd or .ssp file.")] = "joint",
    unit: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="A shipped unit that the system does not hold; repeatable.")
    ] = None,
    all_platforms: Annotated[
        bool, typer.Option("--all-platforms", help="Compile the units for Linux, Windows and macOS (needs ziglang).")
    ] = False,
    flat_names: Annotated[
        bool, typer.Option("--flat-names", help="friction_tau_C for friction.tau_C: some importers take no dots.")
    ] = False,
    reference: Annotated[
        bool, typer.Option("--reference", help="NAME_in.csv, NAME_ref.csv, NAME_ref.opt per unit: FMI's cross-check.")
    ] = False,
    importer: Annotated[
        Importer, typer.Option("--for", help="ecos and libcosim take no wires at the system's own connectors.")
    ] = Importer.ANY,
) -> None:
    """The units as FMUs, and the system as one .ssp, for other simulators."""
    from cobot_joint.cosim.foreign.cross_check import write_cross_check
    from cobot_joint.system import fmu_names, load_system, without_own_wires, write_fmu, write_fmus, write_ssp
    from cobot_joint.system.flat_names import flatten
    from cobot_joint.system.osp import write_osp
    from cobot_joint.system.platforms import compile_for_all
    from cobot_joint.units import find_fmu, load_unit

    wanted = [change for change, asked in ((flatten, flat_names), (compile_for_all, all_platforms)) if asked]
    exported = write_fmus(load_system(system), results_folder(out), wanted)
    files = [out / name for name in dict.fromkeys(fmu_names(exported).values())]
    files += [write_fmu(load_unit(find_fmu(f"{name}.fmu")), out / f"{name}.fmu", wanted) for name in unit or []]
    if reference:
        files += [file for fmu in tuple(files) for file in write_cross_check(load_unit(fmu), out)]
    if importer is Importer.LIBCOSIM:
        files.append(write_osp(exported, out / "OspSystemStructure.xml"))
    if importer is not Importer.ANY:
        exported = without_own_wires(exported)
    files.append(write_ssp(exported, out / f"{exported.name}.ssp"))
    for file in files:
        console.print(file, soft_wrap=True)
    say_json({"files": [str(file) for file in files]})


@app.command(help=CHECK_HELP)
def check(
    fmu: Annotated[str, typer.Argument(metavar="FMU[:PORTS]", help="An FMU; PORTS where its names differ.")],
    place: Annotated[str, typer.Option("--as", metavar="NAME", help="The component in whose place it would come.")],
    system: Annotated[str, typer.Option(help="A system by name, or an .ssd or .ssp file.")] = "joint",
) -> None:
    """See CHECK_HELP."""
    from cobot_joint.cosim.foreign.standalone import examine
    from cobot_joint.scenario.report import Table
    from cobot_joint.system import load_system

    findings = examine(load_system(system), place, fmu)
    rows = [(f.verdict, f.what, f.detail) for f in findings]
    console.print(_grid(Table(f"{fmu} as {place} of {system}", ["", "looked at", "found"], rows)))
    say_json({"findings": [{"verdict": v, "what": what, "detail": detail} for v, what, detail in rows]})
    if "no" in {f.verdict for f in findings}:
        raise typer.Exit(1)


def run_and_show(scenario: str, out: Path | None, changes: Changes) -> Report:
    """Run a scenario with a progress bar, print its tables and where its files are."""
    from cobot_joint.results.draw import Stills

    with Stills() as stills:
        from cobot_joint.scenario.model import load_scenario
        from cobot_joint.scenario.run import run_scenario

        loaded, options = load_scenario(scenario, changes.settings()), changes.options()
        target = results_folder(out or Path("results") / loaded.name)
        with _progress(loaded.name) as progress:
            report = run_scenario(loaded, target, options, progress, stills)
    show(report)
    return report


def show(report: Report) -> None:
    """Tables, then files with what they show."""
    console.print(f"\n[bold]{escape(report.title)}[/bold]")
    for table in report.tables:
        console.print(_grid(table))
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


def say_json(content: object) -> None:
    """On stdout, where `--json` is given."""
    if output.as_json:
        print(json.dumps(content, indent=1))


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


def _pairs(option: str, texts: list[str] | None, allowed: str) -> dict[str, str]:
    pairs = {}
    for text in texts or []:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise UserError(f"{option} {text!r} is given, {allowed}")
        pairs[name] = value
    return pairs


def _grid(table: Table) -> Grid:
    grid = Grid(title=escape(table.title), title_justify="left", title_style="bold")
    for k, name in enumerate(table.headers):
        texts = [isinstance(row[k], str) for row in table.rows]
        left = all(texts) or (k == 0 and any(texts))
        grid.add_column(escape(name), justify="left" if left else "right", overflow="fold")
    for row in table.rows:
        grid.add_row(*(escape(cell) if isinstance(cell, str) else f"{cell:.5g}" for cell in row))
    return grid


@contextmanager
def _progress(name: str) -> Iterator[Any]:
    """A bar on stderr with the time left; a callback of (done, of) in s of bench time."""
    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.0f} of {task.total:.0f} s")
    stderr = Screen(stderr=True)
    times = TimeElapsedColumn(), TimeRemainingColumn()
    with Progress(*columns, *times, console=stderr, transient=True, disable=not stderr.is_terminal) as bar:
        task = bar.add_task(name, total=1.0)
        yield lambda done, total: bar.update(task, completed=done, total=total)


diagnosis.register(app)
for command in (own_bench.inspect, own_bench.new):
    app.command()(command)
app.command("open")(live.open_)


def main() -> None:
    """Entry point."""
    sys.exit(_status(common_first(sys.argv[1:])))


def _status(arguments: list[str]) -> int:
    try:
        with interruptible():
            answer = app(arguments, prog_name="cobot-joint", standalone_mode=False)
            if isinstance(answer, dict):
                say_json(answer)
                return 0
            return int(answer or 0)
    except Interrupted as how:
        return _say(", ".join(["interrupted", *how.args]), 130)
    except UserError as error:
        return _say(error, 2)
    except typer.TyperException as error:
        return _say(_usage(error), 2)
    except OSError as error:
        return _say(what_is_missing(error), 1)
    except RuntimeError as error:  # a unit failed while it ran: SimulationError says which and when
        from cobot_joint.cosim.instances import SimulationError

        if not isinstance(error, SimulationError):
            raise
        return _say(error, 1)


def _commands() -> list[str]:
    return [c.name or c.callback.__name__ for c in app.registered_commands if c.callback]


def _usage(error: typer.TyperException) -> str:
    message = " ".join(error.format_message().split())
    if message.startswith("No such command"):
        message += f" Allowed are {among(sorted(_commands()))}."
    return message


def _say(what: object, status: int) -> int:
    if output.verbose:
        traceback.print_exc()
    print(f"cobot-joint: {printable(' '.join(str(what).split()))}", file=sys.stderr)
    return status


if __name__ == "__main__":
    main()
