"""What it costs that a unit lives in a process of its own."""

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks import bench
from benchmarks.measure import Row, alternate, at_most, median, summary
from benchmarks.ours import NOTHING
from cobot_joint.cosim import Experiment, Simulation, isolation
from cobot_joint.system import Inputs, System

REACH = 10.0  # us per step and unit
STEP, STOP, ROUNDS = 1e-3, 10.0, 5
RINGS = (1, 2, 10)


def cost() -> list[Row]:
    """Per communication step and unit, wall time: of units that do nothing, and of the bench, all isolated."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [_row(f"{n} in a ring", n, bench.ring(Path(folder), n, STOP), NOTHING, "jacobi") for n in RINGS]
    joint = bench.joint()
    return [*rows, _row("the bench, adaptive", len(joint.components), joint, bench.inputs(), "adaptive")]


def _row(what: str, units: int, system: System, inputs: Inputs, scheme: str) -> Row:
    step = STEP if scheme == "jacobi" else None
    experiment = Experiment(inputs, STOP, scheme=scheme, step=step, output_step=STEP)
    here, there = (_loaded(system, which) for which in ("none", "all"))
    with here, there:
        times = alternate({"here": _wall(here, experiment), "isolated": _wall(there, experiment)}, ROUNDS)
        sweeps = there.counters["sweeps"]
    seconds = median([a - b for a, b in zip(times["isolated"], times["here"], strict=True)])
    title = f"isolation, per step and unit: {what}"
    return at_most(title, seconds / sweeps / units * 1e6, REACH, "us", f"{sweeps} sweeps", seconds=summary(times))


def _loaded(system: System, which: str) -> Simulation:
    before = os.environ.get(isolation.WHICH)
    os.environ[isolation.WHICH] = which
    try:
        return Simulation(system)
    finally:
        if before is None:
            del os.environ[isolation.WHICH]
        else:
            os.environ[isolation.WHICH] = before


def _wall(simulation: Simulation, experiment: Experiment) -> Callable[[], float]:
    """Of a run: its processes wait for one another, so that CPU time tells nothing."""

    def run() -> float:
        start = time.perf_counter()
        simulation.run(experiment)
        return time.perf_counter() - start

    return run
