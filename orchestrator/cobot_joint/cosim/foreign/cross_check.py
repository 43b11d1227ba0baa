"""A unit's inputs and outputs as files that any simulator can be held against, named and laid out as FMI's cross-check
asks: FMI-CROSS-CHECK-RULES 4.1, 9.1.4 and appendix B, in github.com/modelica/fmi-cross-check.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim.experiment import Experiment
from cobot_joint.cosim.foreign.excitation import AMPLITUDE, OMEGA, alone, motion
from cobot_joint.cosim.simulation import simulate
from cobot_joint.files import write_atomically
from cobot_joint.system.model import Component, Inputs
from cobot_joint.units import Unit

DURATION, STEP = 0.5, 1e-4  # s; coarser steps leave the band that the rules allow, in masters that hold inputs
MOST_OUTPUTS = 10  # as the rules recommend
INERTIA = "kg.m2"  # no signal: stays at its start value


def write_cross_check(unit: Unit, folder: Path) -> list[Path]:
    """NAME_in.csv (where the unit has Real inputs), NAME_ref.csv and NAME_ref.opt, from rest.

    Parameters stay at their start values, inputs are linear between rows. UserError: the unit does not run.
    """
    name = unit.path.stem
    time = np.linspace(0.0, DURATION, round(DURATION / STEP) + 1)
    inputs = inputs_over(unit, time)
    outputs = [v.name for v in unit.variables.values() if v.causality == "output" and v.type == "Real"][:MOST_OUTPUTS]
    bench = alone(Component("unit", unit.path.name, unit), [*inputs, *outputs])
    run = simulate(bench, Experiment(Inputs(time, inputs), DURATION, output_step=STEP, step=STEP))
    options = {"StartTime": 0.0, "StopTime": DURATION, "StepSize": STEP, "OutputIntervalLength": STEP, "RelTol": 1e-6}
    files = [
        _write_csv(folder / f"{name}_ref.csv", run.time, {output: run[output] for output in outputs}),
        _write(folder / f"{name}_ref.opt", "".join(f"{key}, {value}\n" for key, value in options.items())),
    ]
    return [_write_csv(folder / f"{name}_in.csv", time, inputs), *files] if inputs else files


def inputs_over(unit: Unit, time: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Over time [s], (samples,) each: flanges swing with their angles and speeds, all else between nothing and twice
    its amplitude, so that no load changes sides in a backlash, where small differences grow.

    Inertias, and what is only added to something, stay as they are.
    """
    moved = {name: s for name, s in motion(unit).items() if name not in {flange.tau for flange in unit.flanges}}
    values = {name: np.vectorize(signal)(time) for name, signal in moved.items()}
    names = [v.name for v in unit.variables.values() if v.causality == "input" and v.type == "Real"]
    for k, name in enumerate(name for name in names if not (name in moved or name.endswith("_add"))):
        if unit.unit_of(name) != INERTIA:
            amplitude = AMPLITUDE * float(unit.variables[name].nominal or 1.0)
            values[name] = amplitude * (1 - np.cos((OMEGA + k) * time))
    return values


def _write_csv(path: Path, time: NDArray[np.float64], columns: Mapping[str, NDArray[np.float64]]) -> Path:
    header = ",".join(f'"{name}"' for name in ("time", *columns))
    rows = (",".join(f"{value:.9g}" for value in row) for row in zip(time, *columns.values(), strict=True))
    return _write(path, "\n".join([header, *rows, ""]))


def _write(path: Path, text: str) -> Path:
    write_atomically(path, lambda file: file.write_text(text, encoding="utf-8", newline="\n"))
    return path
