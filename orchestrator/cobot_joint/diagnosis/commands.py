"""`cobot-joint diagnose`, `verify` and `prove`."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from cobot_joint.errors import UserError
from cobot_joint.files import results_folder, writable
from cobot_joint.interrupts import resumable
from cobot_joint.screen import Screen

console = Screen()
if not console.is_terminal:
    console = Screen(width=160)

CampaignFile = Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="A campaign, or the folder that holds it.")]
Baseline = Annotated[
    str | None,
    typer.Option(
        help="Instead of the diagnosis: refit (tolerances only), sparse (regression on the equations, pysindy) "
        "or gp (Gaussian-process discrepancy)."
    ),
]

Within = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        metavar="SECONDS",
        help="Look at nothing further after that; the answer says what was left out. Not for a frequency response.",
    ),
]


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    for command in (diagnose, verify, prove):
        app.command()(command)


def diagnose(
    campaign: CampaignFile,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results.", show_default="diagnosis beside the campaign")
    ] = None,
    baseline: Baseline = None,
    within: Within = None,
) -> dict[str, Any]:
    """Locate where recordings and system differ, name what is missing, and repair the system.

    Called again after an interruption, it goes on from what it finished.
    """
    from cobot_joint.diagnosis.checks.plausibility import plausible
    from cobot_joint.diagnosis.data.campaign import load_campaign
    from cobot_joint.diagnosis.data.recording import said_once
    from cobot_joint.diagnosis.frequency.response import is_response
    from cobot_joint.diagnosis.report.headline import how_sure, next_step
    from cobot_joint.diagnosis.report.words import left_out
    from cobot_joint.diagnosis.run import diagnose_campaign
    from cobot_joint.results.files import read_json

    if is_response(campaign):
        for option, value in (("baseline", baseline), ("within", within)):
            if value is not None:
                raise UserError(f"--{option} {value} is given, a frequency response has none")
        return _diagnose_response(campaign, out)
    loaded = load_campaign(campaign)
    folder = results_folder(out or loaded.path.parent / "diagnosis")
    with resumable(), _stages() as progress:
        progress("checking the recordings")
        suspicions = plausible(loaded)
    for suspicion in suspicions:
        console.print(f"[yellow]{escape(str(suspicion))}[/yellow]", soft_wrap=True)
    with resumable(), _stages() as progress:
        limit = math.inf if within is None else within
        result = diagnose_campaign(loaded, folder, baseline=baseline, within=limit, progress=progress)
    for note in said_once([(r.name, r.notes) for r in loaded.recordings]):
        console.print(f"[dim]{escape(note)}[/dim]", soft_wrap=True)
    console.print(f"\n[bold]{escape(result.sentence)}[/bold]", soft_wrap=True)
    content = result.diagnosis
    _warn_of_crashes(content)
    for said in (*content.get("mistimed", ()), *content.get("held", ())):
        console.print(f"[yellow]{escape(said)}[/yellow]", soft_wrap=True)
    if said := left_out(content):
        console.print(f"[yellow]{escape(said)}[/yellow]", soft_wrap=True)
    if content["findings"]:
        console.print(_findings(content["findings"]))
    for finding in content["findings"]:
        console.print(f"[dim]{escape(finding['term'])}: {escape(how_sure(finding, content))}[/dim]", soft_wrap=True)
    roles = [r for r in ("train", "holdout") if any(r in c for c in content["channels"].values())]
    for role in roles:
        title = {"train": "training runs", "holdout": "held-out runs"}[role]
        figures = {n: {"noise": c["noise"], **c[role]} for n, c in content["channels"].items() if role in c}
        _print_figures(title, figures, result.units, content.get("repair"))
    console.print(f"next: {escape(next_step(content))}", soft_wrap=True)
    for path in result.files:
        console.print(path, soft_wrap=True)
    return read_json(folder / "diagnosis.json")


def _warn_of_crashes(content: dict[str, Any]) -> None:
    for crash in content.get("crashes", ()):
        console.print(f"[yellow]{escape(crash)}[/yellow]", soft_wrap=True)


def _diagnose_response(campaign: Path, out: Path | None) -> dict[str, Any]:
    """`diagnose` of amplitudes over frequency: every reading of the experiment beside the others."""
    from cobot_joint.diagnosis.frequency_run import diagnose_response_campaign
    from cobot_joint.results.diagnosed import VARIANTS
    from cobot_joint.results.files import read_json

    path = campaign / "campaign.toml" if campaign.is_dir() else campaign
    folder = results_folder(out or path.parent / "diagnosis")
    with resumable(), _stages() as progress:
        result = diagnose_response_campaign(path, folder, progress=progress)
    console.print(f"\n[bold]{escape(result.sentence)}[/bold]", soft_wrap=True)
    _warn_of_crashes(result.diagnosis)
    if result.diagnosis["findings"]:
        console.print(_findings(result.diagnosis["findings"]))
    grid = Table(title="rms of ln(simulated/measured)", title_justify="left", title_style="bold")
    for name in ("reading", *VARIANTS, "named"):
        grid.add_column(name, justify="right" if name in VARIANTS else "left")
    for row in result.diagnosis["readings"]:
        grid.add_row(row["name"], *(f"{row[name]:.4f}" for name in VARIANTS), ", ".join(row["terms"]) or "-")
    console.print(grid)
    for path in result.files:
        console.print(path, soft_wrap=True)
    return read_json(folder / "diagnosis.json")


def verify(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="What diagnose wrote.")],
    campaign: CampaignFile,
) -> dict[str, Any]:
    """Hold the repaired system against the campaign's held-out recordings."""
    from cobot_joint.diagnosis.data.campaign import has_training, load_campaign
    from cobot_joint.diagnosis.repair.verify import read_diagnosis
    from cobot_joint.diagnosis.repair.verify import verify as run

    diagnosis = read_diagnosis(folder)  # before anything takes time
    writable(folder)
    # noise, and what is no measurement, are those of all recordings, as for `diagnose`
    loaded = load_campaign(campaign, roles=("train", "holdout") if has_training(campaign) else ("holdout",))
    content = run(folder, loaded)
    units = {name: unit for recording in loaded.recordings for name, unit in recording.units.items()}
    withheld = ", withheld: see what diagnose said" if diagnosis.get("repair") == "withheld" else ""
    console.print(f"repaired system{withheld}: {escape(content['system'])}", soft_wrap=True)
    _print_figures("held-out runs", content["channels"], units, diagnosis.get("repair"))
    if why := content.get("not_predicted"):
        console.print(f"[yellow]no prediction from short distances: {escape(why)}[/yellow]", soft_wrap=True)
    for name in ("verify.json", "verify.parquet"):
        console.print(folder / name, soft_wrap=True)
    return content


def prove(
    folder: Annotated[Path, typer.Argument(metavar="SETDIR", help="A folder of folders with a campaign.toml each.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results, by case.", show_default="beside the recordings")
    ] = None,
    baseline: Baseline = None,
    jobs: Annotated[int, typer.Option(min=1, help="Cases at a time.")] = 2,
) -> None:
    """Diagnose every case of a set, verify those with held-out runs, and score where answers are published.

    Finished cases are kept as they are. Published answers are checked against their seals.
    """
    from cobot_joint.diagnosis.evaluation.prove import CaseResult, cases_of
    from cobot_joint.diagnosis.evaluation.prove import prove as run

    if out is not None:
        results_folder(out)
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    stderr = Screen(stderr=True)
    bar = Progress(*columns, TimeRemainingColumn(), console=stderr, transient=True, disable=not stderr.is_terminal)
    with resumable(), bar:
        task = bar.add_task("cases", total=len(cases_of(folder)))

        def done(result: CaseResult) -> None:
            bar.advance(task)
            bar.console.print(f"{result.case}: {result.status}, {result.seconds:.0f} s {escape(result.message)}")

        proof = run(folder, out, baseline=baseline, jobs=jobs, done=done)
    for case, why in (proof.broken_seals or {}).items():
        console.print(f"[bold red]seal of {escape(case)}: {escape(why)}[/bold red]", soft_wrap=True)
    if proof.broken_seals == {}:
        console.print(f"{len(proof.results)} answers are those that were sealed")
    if proof.score is None:
        console.print("no answers.json in the set: nothing to score")
    else:
        _scoreboard(proof.score)
    failed = [r for r in proof.results if r.status == "failed"]
    if failed or proof.broken_seals:
        raise typer.Exit(1)


def _scoreboard(score: dict[str, Any]) -> None:
    """Per case what was said, then the rates."""
    field = any("style" in row for row in score["rows"])
    grid = Table(title="cases", title_justify="left", title_style="bold")
    for name in ("case", "", "concealed", "false claims", "held-out error" if field else "excess error removed"):
        grid.add_column(name)
    for row in score["rows"]:
        cells = _field_row(row) if field else _case_row(row)
        grid.add_row(row["case"], "ok" if row["right"] else "--", *(cell or "" for cell in cells))
    console.print(grid)
    rates = Table(title="scoreboard", title_justify="left", title_style="bold")
    for name in ("measure", "value", "of", "95 %"):
        rates.add_column(name, justify="left" if name == "measure" else "right")
    beside = {name: score[name] for name in ("true_value_in_interval", "seconds_median")}
    for name, value in (score["summary"] | beside).items():
        if isinstance(value, dict):
            interval = "" if value["ci95"] is None else "{:.3f} to {:.3f}".format(*value["ci95"])
            rates.add_row(name, str(value["k"]), str(value["n"]), interval)
        else:
            rates.add_row(name, "" if value is None else f"{value:.4g}", "", "")
    console.print(rates)


def _case_row(row: dict[str, Any]) -> tuple[str, str, str]:
    """What was concealed and what was said of it, what was said beside it, what the repair removes."""
    said = "; ".join(f"{e['name']}: {_said(e)}" for e in row["effects"]) or "nothing"
    return said, ", ".join(row["false"]) or row["why"], _removed(row["excess_removed"])


def _removed(excess: float | None) -> str:
    """Of the held-out error above noise; a repair that adds to it removes nothing."""
    if excess is None:
        return ""
    return f"{100 * excess:.1f} %" if excess >= 0 else "worse"


def _field_row(row: dict[str, Any]) -> tuple[str, str, str]:
    """The same of a machine with a background; the error above noise as repaired over calibrated."""
    said = [f"{e['name']} ({e['over_background']} x background): {_said(e)}, {e['sure']:.2f}" for e in row["effects"]]
    false = ", ".join(f"{term} {sure:.2f}" for term, sure in row["false"])
    ratio = "" if row["ratio"] is None else f"{row['ratio']:.3f}{', worse' if row['worse'] else ''}"
    return "; ".join(said) or "nothing", false or ("" if row["answered"] else "no answer"), ratio


def _said(effect: dict[str, Any]) -> str:
    return "named" if effect["named"] else "located" if effect["located"] else "missed"


def _findings(findings: list[dict[str, Any]]) -> Table:
    from cobot_joint.diagnosis.report.words import load_history

    grid = Table(title="findings", title_justify="left", title_style="bold")
    for name in ("term", "sure", "since", "parameters", "could also be"):
        grid.add_column(name)
    for f in findings:
        values = [f"{n} = {p['value']:.4g} {p['unit']}".removesuffix(" 1") for n, p in f["parameters"].items()]
        if f.get("shape"):
            values.append(f"{f['shape']['port']} = {f['shape']['formula'] or 'a table'}")
        if f.get("load_history"):
            values.append(load_history(f["load_history"]) or "")
        onset = "at times" if f.get("load_history") else "start" if f["onset"] is None else f"{f['onset']:.2f} s"
        equivalent = ", ".join(f["equivalent"]) or "-"
        grid.add_row(f["term"], f"{100 * f['confidence']:.0f} %", onset, "\n".join(values), equivalent)
    return grid


def _print_figures(
    runs: str, channels: dict[str, dict[str, Any]], units: dict[str, str], repair: str | None = None
) -> None:
    """Errors of free runs, and of predictions where there are some: these are what a repair is judged by."""
    console.print(_figures(f"rms of recording - simulation, {runs}", channels, units, repair))
    predicted = {n: {"noise": c["noise"], **c["predicted"]} for n, c in channels.items() if c.get("predicted")}
    if predicted:
        first = next(iter(predicted.values()))
        lost = f" (of {', '.join(first['free'])} free runs: no filter follows them)" if first.get("free") else ""
        title = f"rms of predictions over {first['horizon']:g} s, {runs}{lost}"
        console.print(_figures(title, predicted, units, repair))


def _figures(
    title: str, channels: dict[str, dict[str, Any]], units: dict[str, str], repair: str | None = None
) -> Table:
    from cobot_joint.results.diagnosed import VARIANTS

    grid = Table(title=title, title_justify="left", title_style="bold")
    grid.add_column("channel")
    for name in ("unit", "noise", *VARIANTS):
        withheld = repair == "withheld" and name == "repaired"
        grid.add_column("withheld" if withheld else name, justify="right")
    for channel, row in channels.items():
        cells = ["-" if row[name] is None else f"{row[name]:.4g}" for name in ("noise", *VARIANTS)]
        grid.add_row(channel, units.get(channel, ""), *cells)
    return grid


@contextmanager
def _stages() -> Iterator[Callable[[str], None]]:
    """What is being done, on stderr; a callback of words. Without a terminal: a line per stage, with the time."""
    stderr, begun = Screen(stderr=True), time.monotonic()
    if not stderr.is_terminal:
        yield _Lines(begun)
        return
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    with Progress(*columns, console=stderr, transient=True) as bar:
        task = bar.add_task("reading", total=None)
        yield lambda words: bar.update(task, description=escape(words))


class _Lines:
    """Progress in lines: every stage once, and within one every PAUSE seconds how far it is.

    The first stage, in which files are found wrong, is said with the second: such an error is one line.
    """

    PAUSE = 10.0  # s

    def __init__(self, begun: float) -> None:
        self.begun, self.stage, self.last = begun, "", -self.PAUSE
        self.first: str | None = None
        self.one_at_a_time = threading.Lock()

    def __call__(self, words: str) -> None:
        with self.one_at_a_time:
            self._say(words)

    def _say(self, words: str) -> None:
        now, stage = time.monotonic() - self.begun, words.split(": ")[0]
        if stage == self.stage and now - self.last < self.PAUSE:
            return
        line = f"{now:5.0f} s  {words}"
        if not self.stage:
            self.first = line
        else:
            for said in filter(None, (self.first, line)):
                sys.stderr.write(f"{said}\n")  # at once: an interruption finds no line half written
            self.first = None
        self.stage, self.last = stage, now
