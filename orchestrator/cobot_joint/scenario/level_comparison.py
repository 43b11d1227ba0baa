"""The same tests at every level of the model (thesis 4.1 to 4.3); errors by part of the run beside the thesis's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import simulate
from cobot_joint.errors import UserError
from cobot_joint.results.figures import Curve, Panel, Picture
from cobot_joint.results.files import SignalsWriter, header, provenance
from cobot_joint.scenario.model import LevelComparison, LevelTest, TimeScenario, load_scenario
from cobot_joint.scenario.options import Options
from cobot_joint.scenario.report import Progress, Report, Table
from cobot_joint.scenario.run import run_scenario
from cobot_joint.system import load_system

Vector = NDArray[np.float64]
FINE = 4  # samples of a level per sample of the logger, so that the phases' steps are seen
PARTS = ("transient", "steady", "combined")


def run_level_comparison(scenario: LevelComparison, out: Path, options: Options, progress: Progress | None) -> Report:
    """A table of rms errors and a Parquet file per test, phase currents, then the scenarios of `also` in folders."""
    if options.level is not None:
        raise UserError(
            f"--level {options.level} is given with {scenario.name}, which runs {', '.join(scenario.levels)}"
        )
    report = Report(scenario.title or scenario.name)
    runs = len(scenario.tests) + len(scenario.also)
    for k, test in enumerate(scenario.tests):
        _compare(
            scenario, test, out / ("signals.parquet" if k == 0 else f"signals_{test.key}.parquet"), options, report
        )
        if progress:
            progress(k + 1, runs)
    for k, name in enumerate(scenario.also):
        part = run_scenario(load_scenario(name), out / name, options)
        report.tables += [replace(table, title=f"{name}: {table.title}") for table in part.tables]
        report.files |= part.files
        report.values |= {f"{name}: {what}": value for what, value in part.values.items()}
        if progress:
            progress(len(scenario.tests) + k + 1, runs)
    return report


def _compare(scenario: LevelComparison, test: LevelTest, path: Path, options: Options, report: Report) -> None:
    time, bench = _run(scenario, test, scenario.bench, options, logged=True)
    columns: dict[str, str | None] = {"time": "s"}
    series: dict[str, Vector] = {"time": time}
    errors: dict[str, dict[str, dict[str, float]]] = {}
    phases: dict[str, dict[str, Vector]] = {}
    fine: Vector = time
    for name, signal in scenario.signals.items():
        columns[f"{name}_bench"], series[f"{name}_bench"] = signal.unit, bench[name]
    for level in scenario.levels:
        fine, found = _run(scenario, test, level, options)
        phases[level] = {name: found[name] for name in scenario.phases.signals}
        errors[level] = {}
        for name, signal in scenario.signals.items():
            columns[f"{name}_{level}"], series[f"{name}_{level}"] = signal.unit, found[name][::FINE]
            errors[level][name] = by_part(time, found[name][::FINE] - bench[name], test.transient)
    facts = provenance(load_system(test.bench), scenario=scenario.name, test=test.name, bench="simulated")
    with SignalsWriter(path, columns, facts) as writer:
        writer.write(series)
    report.files[path] = f"{test.name}: the simulated bench and every level"
    report.tables.append(_table(scenario, test, errors))
    report.values |= {
        f"{test.name}, {level}: {name}, {part} [{scenario.signals[name].unit}]": value
        for level, signals in errors.items()
        for name, parts in signals.items()
        for part, value in parts.items()
    }
    report.pictures += [_over_time(scenario, test, series, path), _phase_currents(scenario, test, fine, phases, path)]


def _run(
    scenario: LevelComparison, test: LevelTest, level: str, options: Options, *, logged: bool = False
) -> tuple[Vector, dict[str, Vector]]:
    """(time, signal -> values as they are compared, and the phases); logged: as the bench has it."""
    driven: TimeScenario = load_scenario(test.scenario, {"stop_time": str(test.stop_time)} if test.stop_time else {})
    system = load_system(test.bench if logged else driven.system)
    of_bench = scenario.bench_parameters if logged else {}
    system = replace(options, level=level).applied(system, driven.parameters, of_bench, where=str(driven.path))
    step = driven.output_step if logged else driven.output_step / FINE
    record = [s.of for s in scenario.signals.values()] + ([] if logged else list(scenario.phases.signals))
    coupling = options.coupling(driven)
    experiment = replace(driven.experiment(system), output_step=step, record=record, **coupling)
    result = simulate(system, experiment)
    found = {name: result.signals[s.of] / s.over for name, s in scenario.signals.items()}
    return result.time, found | {name: x for name, x in result.signals.items() if name in scenario.phases.signals}


def by_part(time: Vector, error: Vector, transient: float) -> dict[str, float]:
    """Part of a run -> rms of an error: float64[n] at `time` [s]; until `transient` [s], from there on, and all."""
    before = time < transient
    chosen = zip(PARTS, (before, ~before, np.ones_like(before)), strict=True)
    return {part: float(np.sqrt(np.mean(error[rows] ** 2))) for part, rows in chosen}


def _table(
    scenario: LevelComparison, test: LevelTest, errors: Mapping[str, Mapping[str, Mapping[str, float]]]
) -> Table:
    headers = ["level", "part"]
    for name, signal in scenario.signals.items():
        headers += [header(name, signal.unit), f"thesis [{signal.unit}]"]
    rows: list[list[float | str]] = []
    for level, words in scenario.levels.items():
        for part in PARTS:
            row: list[float | str] = [words if part == PARTS[0] else "", part]
            for name in scenario.signals:
                row += [errors[level][name][part], scenario.printed(test.name, level, name).get(part, "-")]
            rows.append(row)
    return Table(f"{test.name}: rms of level - simulated bench (thesis: - measurement)", headers, rows)


def _over_time(scenario: LevelComparison, test: LevelTest, series: Mapping[str, Vector], path: Path) -> Picture:
    sources = {"bench": "simulated bench", **scenario.levels}
    panels = [
        Panel(header(name, signal.unit), [Curve(w, series["time"], series[f"{name}_{s}"]) for s, w in sources.items()])
        for name, signal in scenario.signals.items()
    ]
    return Picture(path.with_suffix(""), f"{test.name}: every level", test.name, "time [s]", panels)


def _phase_currents(
    scenario: LevelComparison, test: LevelTest, time: Vector, phases: Mapping[str, Mapping[str, Vector]], path: Path
) -> Picture:
    seen = (time >= scenario.phases.begin) & (time <= scenario.phases.end)
    panels = [
        Panel(
            header(name.rpartition(".")[2], "A"),
            [Curve(words, time[seen], phases[level][name][seen]) for level, words in scenario.levels.items()],
        )
        for name in scenario.phases.signals
    ]
    stem = path.with_name(f"{path.stem}_phases")
    return Picture(stem, f"{test.name}: phase currents", f"{test.name}: phase currents", "time [s]", panels)
