"""The figures on which the real recordings are judged: python proof/real/judge.py, after cobot-joint prove proof/real.

A folder may follow that holds other results, by case (diagnose --out FOLDER/CASE, then verify). Every figure comes
from verify.parquet (recorded signals beside those that the co-simulated units gave on held-out runs) or, for the
frequency response, from diagnosis.json. A case that has not been proved is skipped with a word.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

HERE = Path(__file__).parent
RESULTS = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE
VARIANTS = ("nominal", "calibrated", "repaired")
TRAINED_CURRENT = 7.9  # A, the largest in the first half of system_id_test_2
Vector = NDArray[np.float64]
Figures = dict[str, float]  # variant -> value


def signals(case: str) -> tuple[NDArray[Any], dict[str, Vector]]:
    """verify.parquet: the recording's name per row, and `channel.variant` -> (n,), units left out."""
    table = pq.read_table(RESULTS / case / "verify.parquet")
    columns = {name.split(" [")[0]: table[name].to_numpy() for name in table.column_names if name != "recording"}
    return np.array(table["recording"].to_pylist()), columns


def rms(x: Vector) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(x**2)))


def thesis_table_c1(case: str) -> Iterator[tuple[str, Figures, float]]:
    """rms of ln(simulated/measured) per reading of the experiment; the best one is judged."""
    readings = json.loads((RESULTS / case / "diagnosis.json").read_text())["readings"]
    best = min(readings, key=lambda r: r["repaired"])
    for r in readings:
        yield f"rms log error, {r['name']}", {v: r[v] for v in VARIANTS}, 0.02 if r is best else np.nan


def emps(case: str) -> Iterator[tuple[str, Figures, float]]:
    """Position and control voltage over the run with pulses."""
    _, x = signals(case)
    yield "position, rms [um]", {v: 1e6 * rms(x[f"s.{v}"] - x["s.recorded"]) for v in VARIANTS}, 2.3
    size = np.linalg.norm(x["u.recorded"])
    force = {v: float(100 * np.linalg.norm(x[f"u.{v}"] - x["u.recorded"]) / size) for v in VARIANTS}
    yield "force, norm of error over norm [%]", force, 5.5


def xl330_pendulum(case: str) -> Iterator[tuple[str, Figures, float]]:
    """Mean absolute position error of each run, and their mean."""
    run, x = signals(case)
    per_run = {
        name: {v: float(np.mean(np.abs(x[f"phi.{v}"] - x["phi.recorded"])[run == name])) for v in VARIANTS}
        for name in dict.fromkeys(run)
    }
    for name, figures in per_run.items():
        yield f"position, mean |error| of {name} [rad]", figures, np.nan
    mean = {v: float(np.mean([f[v] for f in per_run.values()])) for v in VARIANTS}
    yield "position, mean |error| over the runs [rad]", mean, 0.05


def ak80_9(case: str) -> Iterator[tuple[str, Figures, float]]:
    """Torque over the second half, and split at the largest current of the first."""
    _, x = signals(case)
    error = {v: x[f"torque.{v}"] - x["torque.recorded"] for v in VARIANTS}
    yield "torque, rms [N.m]", {v: rms(error[v]) for v in VARIANTS}, 0.69
    recorded = HERE.parents[2] / "shared/recordings/real/ak80_9/system_id_test_2.csv"
    time, current = np.loadtxt(recorded, delimiter=",", skiprows=1, usecols=(0, 4)).T
    inside = np.interp(x["time"], time, np.abs(current)) <= TRAINED_CURRENT
    for name, part in (("inside", inside), ("outside", ~inside)):
        yield f"torque, rms {name} the trained currents [N.m]", {v: rms(error[v][part]) for v in VARIANTS}, np.nan


CASES: tuple[Callable[[str], Iterator[tuple[str, Figures, float]]], ...] = (
    thesis_table_c1,
    emps,
    xl330_pendulum,
    ak80_9,
)


def main() -> int:
    """0: every figure that is there reaches what it has to; 1: one does not."""
    missed = 0
    print(f"{'case':16} {'figure':62} {'nominal':>10} {'calibrated':>10} {'repaired':>10} {'to reach':>9}")
    for judge in CASES:
        case = judge.__name__
        needed = "diagnosis.json" if judge is thesis_table_c1 else "verify.parquet"
        if not (RESULTS / case / needed).is_file():
            print(f"{case:16} not proved yet, {case}/{needed} is missing: cobot-joint prove proof/real")
            continue
        for figure, values, reach in judge(case):
            cells = " ".join(f"{values[v]:10.4g}" for v in VARIANTS)
            ok = "" if np.isnan(reach) else "ok" if values["repaired"] <= reach else "missed"
            missed += ok == "missed"
            print(f"{case:16} {figure:62} {cells} {'' if np.isnan(reach) else f'{reach:9.4g}'} {ok}".rstrip())
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
