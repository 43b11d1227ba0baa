"""Rows on many runs and on long ones."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks import bench
from benchmarks.measure import Row, alternate, at_least, at_most, median, ratio, summary, timed
from cobot_joint.cosim import Experiment, simulate_many
from cobot_joint.results.result import Result

RUNS, TURNS = 1000, 5
PER_TURN = RUNS // TURNS
EMPTY = 1e-3  # s of bench time: a run that is all overhead
LENGTHS = (60.0, 600.0, 3600.0)  # s of bench time


def last_speed(result: Result) -> float:
    """What a run leaves behind."""
    return float(result.signals["w_motor"][-1])


def wall(function: Callable[[], None]) -> float:
    """Wall time of a call that works in other processes, s."""
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def many() -> list[Row]:
    """Runs with varied R, k and d: on two processes against one, and what each costs beside its stepping."""
    system, inputs = bench.joint(), bench.inputs()
    spread = np.random.default_rng(1).uniform(0.97, 1.03, (PER_TURN, 3))
    nominal = {"motor_bldc.winding.R": 0.209, "motor_bldc.winding.k": 0.0232, "motor_bldc.friction.d": 7.5e-6}
    variations = [dict(zip(nominal, np.array([*nominal.values()]) * factors, strict=True)) for factors in spread]

    def campaign(jobs: int, stop: float) -> None:
        plain = Experiment(inputs, stop)
        outcomes = list(simulate_many(system, map(plain.with_parameters, variations), jobs=jobs, keep=last_speed))
        if failed := [outcome.error for outcome in outcomes if outcome.error]:
            raise RuntimeError(f"{len(failed)} of {len(outcomes)} runs failed, the first with: {failed[0]}")

    cores = {f"{jobs} core": partial(wall, partial(campaign, jobs, bench.DURATION)) for jobs in (1, 2)}
    one, two = partial(campaign, 1, EMPTY), partial(campaign, 2, EMPTY)
    empty = {"1 core, empty": partial(timed, one), "2 core, empty": partial(wall, two)}
    times = alternate({**cores, **empty}, TURNS)
    costs = {name: median(t) / PER_TURN * 1e3 for name, t in times.items()}
    note = f"{costs['1 core']:.3g} ms per run of {bench.DURATION:g} s on one, {costs['2 core']:.3g} ms on two"
    details = {"seconds": summary(times), "ms per run": costs}
    title = f"{RUNS:,} varied runs in {TURNS} turns, one core / two"
    idle = f"a run of {EMPTY * 1e3:g} ms; on two cores {costs['2 core, empty']:.2g} ms"
    return [
        at_least(title, ratio(times, "1 core", "2 core"), 1.8, "x", note, **details),
        at_most("... overhead per run", costs["1 core, empty"], 2.0, "ms", idle, **details),
    ]


def hour() -> list[Row]:
    """An hour of bench time through the command line, streamed to Parquet: memory and time against shorter runs."""
    seconds, peaks, sizes = {}, {}, {}
    with tempfile.TemporaryDirectory() as folder:
        for length in LENGTHS:
            out = Path(folder) / f"{length:g}"
            call = [sys.executable, "-m", "cobot_joint", "run", bench.SCENARIO, "--out", str(out)]
            seconds[length], peaks[length] = _usage([*call, "--set", f"stop_time={length:g}"])
            sizes[length] = (out / "signals.parquet").stat().st_size / 1e6
    short, middle, long = LENGTHS
    growth = peaks[long] - peaks[middle]
    cost = (seconds[long] - seconds[short]) / (long - short), (seconds[middle] - seconds[short]) / (middle - short)
    details = {"seconds": seconds, "peak MB": peaks, "parquet MB": sizes}
    note = ", ".join(f"{n:g} s: {seconds[n]:.3g} s, {peaks[n]:.0f} MB, file {sizes[n]:.0f} MB" for n in LENGTHS)
    return [
        at_most("an hour of bench time: memory above ten minutes'", growth, 50.0, "MB", note, **details),
        at_most("... time per bench second / ten minutes'", cost[0] / cost[1], 1.1, "x", "linear: 1", **details),
    ]


def _usage(call: list[str]) -> tuple[float, float]:
    """(CPU seconds, largest resident memory in MB) of a command. RuntimeError: the command failed."""
    process = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise RuntimeError(f"{' '.join(call)}: {process.stderr.read().strip()}")
    process.returncode = 0
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
