"""`cobot-joint inspect` and `new`: from a log, or from nothing, to a first campaign."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from cobot_joint.errors import UserError, among
from cobot_joint.files import results_folder
from cobot_joint.screen import Screen

if TYPE_CHECKING:
    from cobot_joint.diagnosis.checks.inspection import Inspection
    from cobot_joint.diagnosis.data.recording import Connector
    from cobot_joint.diagnosis.drafts.campaign_text import Columns
    from cobot_joint.diagnosis.drafts.chain import Chain
    from cobot_joint.system.model import System

console = Screen()
if not console.is_terminal:
    console = Screen(width=160)
POINTS = 4000  # of a channel in a picture
STIFF = 50.0  # Hz, at which a load rings on a spring that a machine has only in the model


def inspect(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Recordings: CSV, Parquet, MAT, MDF, MCAP.")],
    system: Annotated[
        str | None,
        typer.Option(help="A shipped system by name, or an .ssd or .ssp file: writes a first campaign.toml."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for pictures and campaign.toml.")] = None,
    time: Annotated[
        str | None,
        typer.Option(
            help="The clock's column and unit, 'loop_time [ms]', or how far rows without one are apart: '10 ms'."
        ),
    ] = None,
    skip: Annotated[int | None, typer.Option(min=0, help="Lines above the line of names.")] = None,
    separator: Annotated[str | None, typer.Option(help="Between cells; 'tab' and 'space' have names.")] = None,
    encoding: Annotated[str | None, typer.Option(help="Of a text file: utf-8, latin-1.")] = None,
) -> None:
    """Look at logs: columns, units, clock, gaps, ranges, noise, saturation, suspicions."""
    import numpy as np

    from cobot_joint.diagnosis.checks.inspection import inspect_log
    from cobot_joint.diagnosis.data.delimited import Layout
    from cobot_joint.results.draw import draw
    from cobot_joint.results.figures import Picture, over_time
    from cobot_joint.system.read import find_system

    if system is not None and Path(system).suffix == ".toml":
        raise UserError(
            f"--system {system} is given, a campaign; the .ssd or .ssp that it has as its system is allowed"
        )
    if system is not None:
        find_system(system)  # before logs are read for minutes
    found = [inspect_log(path, time, Layout(skip, separator, encoding)) for path in logs]
    for path, i in zip(logs, found, strict=True):
        _show(path, i)
    if out is None and system is None:
        return
    folder = results_folder(out or logs[0].parent)
    if out is not None:
        stems = [path.stem for path in logs]
        for k, (path, i) in enumerate(zip(logs, found, strict=True)):
            stem = path.stem if stems.count(path.stem) == 1 else f"{path.stem} ({stems[: k + 1].count(path.stem)})"
            r, every = i.recording, max(1, len(i.recording.time) // POINTS)
            signals = {n: x[::every] for n, x in r.outputs.items()}
            at = np.arange(float(len(r.time))) if i.table else r.time
            panels = over_time(at[::every], signals, r.units)
            axis = "row" if i.table else "time [s]"
            for file in draw(Picture(folder / stem, "signals", path.name, axis, panels)):
                console.print(file, soft_wrap=True)
    if system is not None:
        asked = {"time": time, "skip": skip, "separator": separator, "encoding": encoding}
        given = {key: value for key, value in asked.items() if value is not None}
        given |= {"table": "rows"} if found[0].table else {}
        for words in _first_campaign(folder, system, logs, found, given):
            console.print(escape(words), soft_wrap=True)


def _show(path: Path, i: Inspection) -> None:
    import numpy as np

    r = i.recording
    gaps = int(np.sum(~np.isfinite(next(iter(r.outputs.values())))))
    about = f"{len(r.time)} samples, {r.time[-1] - r.time[0]:.4g} s at {1 / r.step:.5g} Hz, {gaps} not recorded"
    clock = escape(i.log.clock or "as told, or one per channel")
    about = f"{len(r.time)} rows, {gaps} values missing" if i.table else f"clock {clock}, {about}"
    console.print(f"\n[bold]{escape(str(path))}[/bold]: {about}", soft_wrap=True)
    grid = Table()
    for name in ("column", "unit", "from", "to", "noise", "step", "saturated", "missing"):
        grid.add_column(name, justify="left" if name in ("column", "unit") else "right")
    for name, q in i.quality.items():
        unit = next(c.unit for c in i.log.channels if c.name == name) or "none given"
        step = f"{q.step:.4g}" if q.step else "-"
        noise = f"{q.noise:.3g}" if np.isfinite(q.noise) else "-"
        numbers = [f"{q.low:.5g}", f"{q.high:.5g}", noise, step, str(q.saturated), str(q.missing)]
        grid.add_row(escape(name), escape(unit), *numbers)
    console.print(grid)
    for words in i.words:
        console.print(f"  {escape(words)}", soft_wrap=True)


def _first_campaign(
    folder: Path, system: str, logs: list[Path], found: list[Inspection], given: dict[str, str | int]
) -> list[str]:
    """campaign.toml in the folder; where it is, and what it lacks. UserError: one is there already."""
    from cobot_joint.diagnosis.data.campaign import connectors_of, system_connectors, systems_of
    from cobot_joint.diagnosis.data.campaign_file import CampaignFile, RecordingEntry
    from cobot_joint.diagnosis.drafts.campaign_text import (
        Columns,
        Entry,
        Lacking,
        campaign_text,
        in_percent,
        left_over,
        one_each,
    )
    from cobot_joint.diagnosis.drafts.constant_speeds import as_table
    from cobot_joint.diagnosis.drafts.counted_speeds import in_counts
    from cobot_joint.diagnosis.drafts.current_drive import nominal_beside, percent_of_drive
    from cobot_joint.diagnosis.drafts.duty_cycle import supplied
    from cobot_joint.diagnosis.drafts.more_guesses import guesses_of, with_only_place, with_rates
    from cobot_joint.diagnosis.drafts.starts import starts
    from cobot_joint.diagnosis.drafts.without_units import with_assumed_units
    from cobot_joint.system.read import load_system
    from cobot_joint.system.wiring import driving, read_by_loops, unwired

    path = folder / "campaign.toml"
    if path.exists():
        raise UserError(f"{path} is there already; --out names another folder")
    named = os.path.relpath(system, folder) if Path(system).suffix in (".ssd", ".ssp") else system
    defaults, setups = systems_of(path, CampaignFile(system=named, recording=[RecordingEntry(file="")]))
    setup, file = next(iter(setups.items()))
    own = load_system(file)
    connectors = connectors_of(file, setup, defaults.logged)
    every = system_connectors(file)
    offered = [c for n, c in every.items() if n in unwired(own) and n not in read_by_loops(own)]
    mine = {*own.inputs, *own.outputs} if own.inputs else {*own.outputs, *driving(own)}  # else not of its components
    connectors = {n: c for n, c in connectors.items() if n in mine}
    columns = found[0].log.channels
    guesses = guesses_of(own, connectors, defaults.logged, [i.log.channels for i in found])
    percent = percent_of_drive(own, guesses, columns, in_percent(columns, guesses, connectors.values()))
    usual = [c for n, c in connectors.items() if not defaults.logged or n in defaults.logged]
    matched = {g.connector for g in guesses}
    wanted = [Lacking(c, c.name in defaults.logged) for c in usual if c.name not in matched]
    tolerances = {} if defaults.tolerances else usual_tolerances(file)
    channels = with_assumed_units(list({c.name: c for i in found for c in i.log.channels}.values()), connectors)
    unusable = {name: why for i in found for name, why in i.log.unusable.items()}
    guesses = with_only_place(own, guesses, every, left_over(own, channels, guesses, offered), channels)
    guesses = with_rates(own, guesses, every, left_over(own, channels, guesses, offered), columns)
    left = left_over(own, channels, guesses, offered)
    percent |= in_counts(channels, guesses, offered)
    beginnings = starts(own, guesses, [i.log.channels for i in found])
    nominal = nominal_beside(own, guesses) | supplied(own, guesses, columns)
    drafted = Columns(guesses, wanted, left, percent, unusable, nominal, beginnings)
    files = [Path(os.path.relpath(log, folder)).as_posix() for log in logs]
    entries = as_table(own, guesses, [i.log for i in found], Entry(files, given=given)) or one_each(files, given)
    title = logs[0].stem if len(logs) == 1 else logs[0].resolve().parent.name or logs[0].stem
    path.write_text(campaign_text(title, named, entries, drafted, tolerances), encoding="utf-8")
    return [str(path), *_nothing_compared(logs[0], every, drafted), *_nothing_drives(own, drafted)]


def _nothing_compared(log: Path, connectors: Mapping[str, Connector], drafted: Columns) -> list[str]:
    """What a draft lacks that compares nothing."""
    found = [connectors[g.connector] for g in drafted.guesses] + [rated.connector for rated in drafted.percent.values()]
    if any(c.causality == "output" for c in found):
        return []
    outputs = among([each.connector.name for each in drafted.lacking if each.connector.causality == "output"])
    return [f"{log}: no column looks like an output of the system ({outputs}): fill in [channels], which has them all"]


def _nothing_drives(system: System, drafted: Columns) -> list[str]:
    """What a draft lacks, or does without; nothing: it has an input."""
    if not system.inputs or any(g.connector in system.inputs for g in drafted.guesses):
        return []
    inputs = among(list(system.inputs))
    if drafted.starts and len(system.components) == 1:  # a motor without its voltage does not coast
        return [f"no column is an input of the system ({inputs}): each run coasts from where its log begins"]
    return [f"no column is an input of the system: `diagnose` needs one for {inputs}, or a start in [initial]"]


def usual_tolerances(system: Path) -> dict[str, str]:
    """`component.parameter` -> how far off, as TOML, of components whose units are parts of a chain."""
    from cobot_joint.diagnosis.drafts.chain import PARTS, tolerances
    from cobot_joint.system.read import load_system

    usual: dict[str, Mapping[str, str]] = {}
    for part in PARTS.values():  # one unit may be several parts: the first, but for a component with a part's name
        if part.fits:
            usual.setdefault(part.unit, part.fits)
    components = load_system(system).components
    own = {c.name: PARTS[c.name].fits for c in components if c.name in PARTS and PARTS[c.name].unit == c.unit.name}
    return {
        f"{c.name}.{name}": line
        for c in components
        for name, line in tolerances(c, own.get(c.name, usual.get(c.unit.name, {}))).items()
    }


def new(
    chain: Annotated[
        str | None,
        typer.Option(
            help="Parts in a row: loop, motor, motion, gear, harmonic, cycloidal, sensor, elastic, shaft, "
            "load, link, pendulum, screw, brake; or friction, alone: a table of speeds and torques."
        ),
    ] = None,
    from_: Annotated[str | None, typer.Option("--from", help="A system to start from, by name or file.")] = None,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("bench"),
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="PART.NAME=VALUE",
            help="From a data sheet: 'motor.torque_constant=38.5 mNm/A'; repeatable.",
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Write over what lies in the folder.")] = False,
    list_: Annotated[bool, typer.Option("--list", help="Show what --set takes, or the parts; write nothing.")] = False,
) -> None:
    """Write a readable system (.ssd) and a campaign for a machine of your own."""
    from cobot_joint.diagnosis.drafts.chain import Chain, kept_in_words, with_data_sheet, write_readable
    from cobot_joint.diagnosis.drafts.chain import chain as make
    from cobot_joint.diagnosis.drafts.shafts import mesh_in_words, shaft_in_words, with_stiff_parts
    from cobot_joint.system.read import load_system

    if list_ and chain is None and from_ is None:
        _list_parts()
        return
    if (chain is None) == (from_ is None):
        raise UserError("new: one of --chain motor,gear,sensor,load and --from joint is needed; --list shows the parts")
    parts = [n.strip() for n in (chain or "").split(",")]
    made = make(parts) if chain is not None else Chain(load_system(str(from_)), {})
    values = dict(_assignment(text) for text in set_ or [])
    made = with_stiff_parts(with_data_sheet(made, values), values)
    if chain is not None and not made.system.inputs:
        raise UserError(
            f"new: --chain {chain} is given, and nothing drives its first part; motor, loop, motion, load, link, "
            "pendulum, screw or friction is allowed there"
        )
    if list_:
        _list_parameters(made)
        return
    folder = results_folder(out)
    for name in ("system.ssd", "campaign.toml"):
        if (folder / name).exists() and not overwrite:
            raise UserError(f"{folder / name} is there already; --out names another folder, --overwrite writes over it")
    words = [(name, part.words) for name, part in made.parts.items()]
    console.print(write_readable(made.system, words, folder / "system.ssd"), soft_wrap=True)
    if chain:
        said = [*shaft_in_words(made, values), *mesh_in_words(made, values), *_supply(made, values)]
        console.print(*said, *kept_in_words(made, values), sep="", end="")
    console.print(*_ringing(made), *_commanded(made, values), *_weightless(made), sep="", end="")
    (folder / "campaign.toml").write_text(_campaign(made.system, folder), encoding="utf-8")
    console.print(folder / "campaign.toml", soft_wrap=True)


def _list_parts() -> None:
    """Every part that a chain may have."""
    from cobot_joint.diagnosis.drafts.chain import PARTS

    grid = Table("part", "what it is", "unit")
    for name, part in PARTS.items():
        grid.add_row(name, escape(part.words), part.unit)
    console.print(grid, "--chain motor,gear,load --list shows what --set takes of these", sep="\n")


def _list_parameters(made: Chain) -> None:
    """Every parameter that a value may be given for, those of data sheets first."""
    grid = Table()
    for name in ("--set", "value", "unit", "what it is"):
        grid.add_column(name, justify="right" if name == "value" else "left")
    for c in made.system.components:
        sheet = made.parts[c.name].data_sheet if c.name in made.parts else ()
        every = [n for n, v in c.unit.variables.items() if v.causality == "parameter" and v.type == "Real"]
        for n in (*sheet, *(n for n in every if n not in sheet)):
            value = float(c.parameters.get(n, c.unit.variables[n].start) or 0.0)
            unit, words = c.unit.unit_of(n) or "1", c.unit.variables[n].description or ""
            grid.add_row(escape(f"{c.name}.{n}"), f"{value:g}", escape(unit), escape(words))
        grid.add_section()
    console.print(grid)


def _supply(made: Chain, given: Collection[str]) -> list[str]:
    """At what speed a supply that nobody gave holds a motor; nothing: it was given, or there is no motor."""
    if "motor" not in made.parts or any(name.split(".")[-1] in ("v_bus", "supply_voltage") for name in given):
        return []
    motor = made.system.component("motor").parameters
    v_bus, k = motor["inverter.v_bus"], motor["winding.k"]
    fastest = f", which holds it below {v_bus / k:.3g} rad/s" if k > 0 else ""
    return [f"the motor's supply of {v_bus:g} V is assumed{fastest}: --set 'motor.v_bus=VALUE'\n"]


def _commanded(made: Chain, given: Collection[str]) -> list[str]:
    """What a servo loop's output is taken for, where nobody said."""
    if "loop" not in made.parts or any(name.endswith("mode") for name in given):
        return []
    current = "--set motor.drive.mode=current"
    return [f"the loop's output is taken for the motor's voltage; where it commands a current: {current}\n"]


def _weightless(made: Chain) -> list[str]:
    """Masses on a slope, or hanging from an angle, that weigh nothing: gravity is 0 unless it is given."""
    light = [c for c in made.system.components if "gravity.g" in c.unit.variables and not c.parameters.get("gravity.g")]
    sloped = [c.name for c in light if c.parameters.get("gravity.slope") or c.parameters.get("gravity.phi_0")]
    return [f"{name} is weightless, though a slope is given: --set {name}.gravity.g=9.81\n" for name in sloped]


def _ringing(made: Chain) -> list[str]:
    """What a load behind recorded motion rings at on the sensor's spring, where little damps it, and what to set where
    no data sheet gives a spring; nothing: there is no such load."""
    names = list(made.parts)
    parts = {c.name: c for c in made.system.components}
    if len(names) < 3 or names[:2] != ["motion", "sensor"] or parts[names[2]].unit.name != "driven_load":
        return []
    load, spring = parts[names[2]].parameters, parts["sensor"].parameters
    J = load.get("body.J", 0.0) + load.get("body.m", 0.0) * load.get("body.r", 0.0) ** 2
    c_s, d_s = spring["shaft.c_s"], spring["shaft.d_s"]
    if not J > 0 or not c_s > 0 or d_s >= math.sqrt(c_s * J):  # half of critical damping, 2 sqrt(c_s J)
        return []
    f, damped = math.sqrt(c_s / J) / (2 * math.pi), d_s / (2 * math.sqrt(c_s * J))
    c = max(c_s, J * (2 * math.pi * STIFF) ** 2)
    stiff = f"--set sensor.c_s={c:.4g} --set sensor.d_s={1.4 * math.sqrt(c * J):.3g}"
    return [
        f"on the sensor's spring the {names[2]} rings at {f:.3g} Hz, damped by {100 * damped:.2g} %: recorded motion "
        f"excites it. If the machine has no such spring: {stiff}\n"
    ]


def _campaign(system: System, folder: Path) -> str:
    """A campaign over system.ssd whose columns have the connectors' names and units."""
    import numpy as np

    from cobot_joint.diagnosis.data.formats import Channel
    from cobot_joint.diagnosis.drafts.campaign_text import Columns, Guess, campaign_text, one_each

    nothing = np.zeros(0)
    guesses = [
        Guess(Channel(n, c.unit, nothing, nothing), n, f"your column for {c.description or n}, in its unit")
        for n, c in (dict(system.inputs) | dict(system.outputs)).items()
    ]
    tolerances = usual_tolerances(folder / "system.ssd")
    entries = one_each(["run1.csv", "run2.csv"])
    return campaign_text(folder.resolve().name, "system.ssd", entries, Columns(guesses), tolerances)


def _assignment(text: str) -> tuple[str, str]:
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise UserError(f"--set {text!r} is given, PART.NAME=VALUE is allowed, for example 'motor.R=0.61 Ohm'")
    return name, value
