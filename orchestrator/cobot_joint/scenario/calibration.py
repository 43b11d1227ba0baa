"""The bench's two calibrations (thesis 3.1.1, 3.1.2): a staircase of known inputs, settled readings, a line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import Experiment, simulate
from cobot_joint.errors import UserError
from cobot_joint.results.figures import Curve, Panel, Picture, over_time
from cobot_joint.results.files import SignalsWriter, columns_of, header, provenance, write_csv
from cobot_joint.results.result import Result
from cobot_joint.scenario.model import CurrentSensorCalibration, TorqueCalibration
from cobot_joint.scenario.options import TRANSFER_FUNCTION, Options
from cobot_joint.scenario.report import Progress, Report, Table
from cobot_joint.scenario.time_run import energy_table
from cobot_joint.system import Inputs, System, load_system

RAMP = 0.2  # of a step's length: how long the change to its level takes
READ = 0.2  # of a step's length, at its end: what is averaged


def run_torque_calibration(
    scenario: TorqueCalibration, out: Path, options: Options, progress: Progress | None
) -> Report:
    """Weights on the arm (eq. 3.2) with the rotor held, the line through them (eq. 3.3), and the shunt check."""
    system = _system(scenario, options)
    applied = np.array([scenario.arm.torque(weight) for weight in scenario.weights])
    result = _staircase(scenario, system, "tau_arm", applied, options, progress)
    measured = settled(result, "tau_sensor", len(applied), scenario.settle)
    slope, offset = np.polyfit(measured, applied, 1)
    rmse = float(np.sqrt(np.mean((slope * measured + offset - applied) ** 2)))
    rmse_as_read = float(np.sqrt(np.mean((measured - applied) ** 2)))

    # the shunt check spans the amplifier before there is a line: with the reading left as it is
    load = scenario.shunt.load()
    plain = Options(options.level, options.step, options.scheme, {**scenario.uncalibrated, **options.parameters})
    simulated_load = np.array([load * scenario.shunt.rated_torque])
    shunted = _staircase(scenario, _system(scenario, plain), "tau_arm", simulated_load, plain, None)
    y = settled(shunted, "y", 1, scenario.settle)[0]

    report = _report(scenario, system, result, out)
    rows = [(w, a, m, a - m) for w, a, m in zip(scenario.weights, applied, measured, strict=True)]
    headers = ["weight [kg]", header("applied", "N.m"), header("measured", "N.m"), header("difference", "N.m")]
    line = scenario.line
    report.tables += [
        Table("weights on the arm", headers, rows),
        Table(
            "line applied = slope*measured + offset",
            ["", "slope [1]", header("offset", "N.m"), header("rms error", "N.m"), "rms error as read [N.m]"],
            [
                ("simulated", slope, offset, rmse, rmse_as_read),
                ("eq. 3.3", line["slope"], line["offset"], 0.02328, 0.0504),
            ],
        ),
        Table(
            "shunt check",
            ["", "load over range [%]", header("output", "V")],
            [("simulated", 100 * load, y), ("thesis 3.1.2", 72.0, 3.6)],
        ),
        energy_table(result),
    ]
    report.files[write_csv(out / "torque_calibration.csv", headers, rows)] = "weights and readings"
    curves = [
        Curve("weights", measured, applied, "markers"),
        Curve(f"{slope:.4f} x + {offset:.5f}", measured, slope * measured + offset, "line"),
        Curve("eq. 3.3", measured, line["slope"] * measured + line["offset"], "dashed"),
    ]
    panel = Panel(header("applied torque", "N.m"), curves)
    stem = out / "torque_calibration"
    report.pictures.append(Picture(stem, "applied over measured", report.title, "measured torque [N.m]", [panel]))
    report.values = {
        "slope": float(slope),
        "offset [N.m]": float(offset),
        "rms error [N.m]": rmse,
        "rms error as read [N.m]": rmse_as_read,
        "shunt load [%]": 100 * load,
        "shunt output [V]": float(y),
    }
    return report


def run_current_sensor_calibration(
    scenario: CurrentSensorCalibration, out: Path, options: Options, progress: Progress | None
) -> Report:
    """Known currents through the sensor of each phase: its zero and its slope, as the logger converts them."""
    system = _system(scenario, options)
    currents = np.array(scenario.currents)
    result = _staircase(scenario, system, "i_phase", currents, options, progress)
    report = _report(scenario, system, result, out)
    rows: list[tuple[float | str, ...]] = []
    curves = []
    for name in system.outputs:
        y = settled(result, name, len(currents), scenario.settle)
        slope, zero = np.polyfit(currents, y, 1)
        worst = float(np.max(np.abs(slope * currents + zero - y)))
        rows.append((name, zero, 1e3 * slope, 1e3 * worst))
        curves.append(Curve(name, currents, y, "markers"))
        report.values |= {f"{name}: zero [V]": float(zero), f"{name}: slope [V/A]": float(slope)}
    headers = ["output", header("at 0 A", "V"), header("slope", "mV/A"), header("worst deviation", "mV")]
    rows.append(("thesis 3.1.1", scenario.zero, 1e3 * scenario.slope, ""))
    report.tables.append(Table("ACS712 per phase", headers, rows))
    report.files[write_csv(out / "current_sensor_calibration.csv", headers, rows)] = "zero and slope per phase"
    curves.append(Curve("2.5 V + 185 mV/A", currents, scenario.zero + scenario.slope * currents, "dashed"))
    stem, panel = out / "current_sensor_calibration", Panel(header("output", "V"), curves)
    report.pictures.append(Picture(stem, "output over current", report.title, "current [A]", [panel]))
    return report


def staircase(levels: NDArray[np.float64], length: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(time, value) corners: a ramp to each level, then held; `length` s per level, from 0."""
    time, value = [0.0], [0.0]
    for n, level in enumerate(levels):
        time += [(n + RAMP) * length, (n + 1) * length]
        value += [float(level), float(level)]
    return np.array(time), np.array(value)


def settled(result: Result, name: str, n: int, length: float) -> NDArray[np.float64]:
    """float64[n]: means over the end of each level"""
    means = []
    for k in range(n):
        end = (result.time > (k + 1 - READ) * length) & (result.time <= (k + 1) * length + 1e-9)
        means.append(float(result.signals[name][end].mean()))
    return np.array(means)


def _system(scenario: TorqueCalibration | CurrentSensorCalibration, options: Options) -> System:
    if options.level == TRANSFER_FUNCTION:
        raise UserError(f"--level {TRANSFER_FUNCTION} is given with {scenario.name}: only frequency_response has it")
    return options.applied(load_system(scenario.system), scenario.parameters, where=str(scenario.path))


def _staircase(
    scenario: TorqueCalibration | CurrentSensorCalibration,
    system: System,
    name: str,
    levels: NDArray[np.float64],
    options: Options,
    progress: Progress | None,
) -> Result:
    time, value = staircase(levels, scenario.settle)
    inputs = Inputs(time, {name: value})
    experiment = Experiment(inputs, float(time[-1]), record=system.recorded, **options.coupling(scenario))
    return simulate(system, experiment, progress)


def _report(
    scenario: TorqueCalibration | CurrentSensorCalibration, system: System, result: Result, out: Path
) -> Report:
    report = Report(scenario.title or scenario.name)
    path = out / "signals.parquet"
    facts = provenance(system, scenario=scenario.name, scheme=result.scheme, step=result.step, energy=result.energy)
    with SignalsWriter(path, columns_of(system), facts) as writer:
        writer.write({"time": result.time, **result.signals})
    report.files[path] = "signals, units and provenance"
    panels = over_time(result.time, result.signals, result.units)
    report.pictures.append(Picture(out / "signals", "signals over time", report.title, "time [s]", panels))
    return report
