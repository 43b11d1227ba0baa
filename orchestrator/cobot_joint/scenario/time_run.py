"""One run of a system over time: inputs from the scenario, signals streamed to disk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import Simulation, SimulationError
from cobot_joint.cosim.energy import warn_of_residuals
from cobot_joint.errors import UserError
from cobot_joint.results.figures import Picture, over_time
from cobot_joint.results.files import SignalsWriter, columns_of, provenance
from cobot_joint.results.result import Result
from cobot_joint.scenario.model import TimeScenario
from cobot_joint.scenario.options import TRANSFER_FUNCTION, Options
from cobot_joint.scenario.report import Progress, Report, Table
from cobot_joint.system import load_system
from cobot_joint.system.wiring import warn_of_unconnected

MOST_POINTS = 25_000  # per signal in a picture
ROWS_PER_CHUNK = 1_000  # between two looks at the progress


class Digest:
    """Minimum, maximum, mean and rms of signals that pass by, and a thinned copy to draw."""

    def __init__(self, stride: int):
        self.stride, self.n = stride, 0
        self.time: list[NDArray[np.float64]] = []
        self.thinned: dict[str, list[NDArray[np.float64]]] = {}
        self.moments: dict[str, NDArray[np.float64]] = {}

    def take(self, time: NDArray[np.float64], signals: Mapping[str, NDArray[np.float64]]) -> None:
        """One chunk."""
        keep = slice(-self.n % self.stride, None, self.stride)
        self.n += len(time)
        self.time.append(time[keep].copy())  # a view would keep the whole chunk
        for name, x in signals.items():
            self.thinned.setdefault(name, []).append(x[keep].copy())
            low, high, total, squares = self.moments.get(name, np.array([np.inf, -np.inf, 0.0, 0.0]))
            self.moments[name] = np.array([min(low, x.min()), max(high, x.max()), total + x.sum(), squares + x @ x])

    def drawn(self) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
        """(time, signal -> samples) of the thinned copy"""
        return np.concatenate(self.time), {name: np.concatenate(parts) for name, parts in self.thinned.items()}

    def rows(self, units: Mapping[str, str | None]) -> list[tuple[str, float, float, float, float]]:
        """(header, min, max, mean, rms) per signal"""
        return [
            (f"{name} [{units[name] or '1'}]", low, high, total / self.n, float(np.sqrt(squares / self.n)))
            for name, (low, high, total, squares) in self.moments.items()
        ]


def run_over_time(scenario: TimeScenario, out: Path, options: Options, progress: Progress | None) -> Report:
    """`out`/signals.parquet and its pictures. Memory does not grow with the stop time.

    SimulationError: a unit fails; signals.parquet has the rows until then.
    """
    if options.level == TRANSFER_FUNCTION:
        raise UserError(
            f"--level {TRANSFER_FUNCTION} is given with {scenario.name}; it relates speed to current without load "
            "(thesis 3.2.4): only frequency_response has it"
        )
    system = options.applied(load_system(scenario.system), scenario.parameters, where=str(scenario.path))
    warn_of_unconnected(system)
    experiment = replace(scenario.experiment(system), **options.coupling(scenario))
    columns = columns_of(load_system(scenario.columns_of) if scenario.columns_of else system)
    digest = Digest(1 + int((scenario.stop_time - scenario.start_time) / scenario.output_step) // MOST_POINTS)
    facts = provenance(system, scenario=scenario.name, level=options.level or "as the units have it")
    path = out / "signals.parquet"
    failure: SimulationError | None = None
    with Simulation(system) as simulation, SignalsWriter(path, columns, facts) as writer:
        try:
            for last in simulation.stream(experiment, progress, ROWS_PER_CHUNK):
                writer.write({"time": last.time, **last.signals})
                digest.take(last.time, last.signals)
        except SimulationError as error:
            if digest.n == 0:
                raise
            failure = error
            writer.provenance["failure"] = str(error)
        writer.provenance |= {"scheme": last.scheme, "step": last.step, "energy": last.energy}
    if failure:
        raise SimulationError(f"{failure}; {path} has the {digest.n} rows until then")
    warn_of_residuals(last.energy)
    report = Report(scenario.title or scenario.name)
    report.files[path] = "signals, units and provenance"
    time, drawn = digest.drawn()
    report.pictures.append(
        Picture(out / "signals", "signals over time", report.title, "time [s]", over_time(time, drawn, columns))
    )
    report.tables = [
        Table("signals", ["signal", "min", "max", "mean", "rms"], digest.rows(columns)),
        energy_table(last),
    ]
    report.values = {f"energy residual {name}": last.energy_residual(name) for name in last.energy}
    report.values |= {"scheme": last.scheme, "step": last.step}
    return report


def energy_table(result: Result) -> Table:
    """Energy residual of every mechanical connection."""
    return Table(
        "energy",
        ["mechanical connection", "given [J]", "taken [J]", "residual [%]"],
        [(name, given, taken, 100 * result.energy_residual(name)) for name, (given, taken, _) in result.energy.items()],
    )
