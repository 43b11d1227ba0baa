"""Error against cost: rms error of the motor's speed against seconds, our schemes and every peer, as one plot."""

import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from benchmarks import bench
from benchmarks.measure import Row, alternate, at_most, median, missing, rms, timed
from benchmarks.monolith import averaged
from benchmarks.ours import Ours
from benchmarks.rows_peers import DURATION, workers
from cobot_joint.cosim import STEPPED, Simulation, SimulationError

STEPS = [1e-3, 5e-4, 2e-4, 1e-4]  # s
ROUNDS = 3
LOOP_STEPS = [200e-6, 100e-6, 50e-6, 20e-6]
TITLE = "error against cost: our error / theirs in no more time, worst point"


@dataclass(frozen=True)
class Point:
    """One run: `who`, its scheme and step [s], seconds, rms error of w_motor [rad/s]."""

    who: str
    scheme: str
    step: float
    seconds: float
    error: float


def measure(python: str) -> tuple[list[Row], list[Point]]:
    """The plot's points, and how far below the peers ours lie."""
    ours, theirs, loops = _ours(), _peers(python), _loops()
    rows = []
    for who in sorted({point.who for point in theirs}):
        ratios = []
        for point in (p for p in theirs if p.who == who):
            cheaper = [p.error for p in ours if p.seconds <= point.seconds]
            ratios.append(min(cheaper) / point.error if cheaper else float("inf"))
        rows.append(at_most(f"{TITLE}: {who}", max(ratios), 1.0, "x", "below 1: ours is the better at every point"))
    return rows or [missing(TITLE, "<= 1 x", "no peer is here")], [*ours, *theirs, *loops]


def _finite(error: float) -> bool:
    return error < 1e3  # rad/s; beyond, the coupling has diverged


def _ours() -> list[Point]:
    system, inputs = bench.joint(), bench.inputs()
    right = bench.answer(bench.table_of(inputs, DURATION))
    points = []
    with Simulation(system) as simulation:
        for scheme in STEPPED:
            for step in STEPS:
                contestant = Ours(simulation, inputs, DURATION, scheme=scheme, step=step)
                try:
                    seconds = median(alternate({scheme: contestant}, ROUNDS)[scheme])
                except SimulationError:
                    continue  # a scheme may diverge at this step: no point
                error = rms(contestant.result.signals["w_motor"] - right["w_motor"])
                if _finite(error):
                    points.append(Point("ours", scheme, step, seconds, error))
    return points


def _peers(python: str) -> list[Point]:
    table = bench.table_of(bench.inputs(), DURATION)
    points = []
    with tempfile.TemporaryDirectory() as folder, workers(python) as (there, _):
        for step in STEPS:
            for name, peer in there.items():
                for scheme in peer.schemes:
                    wiring = bench.wiring(bench.joint(), Path(folder), step, table, scheme)
                    try:
                        run = peer.run(wiring)
                    except RuntimeError:
                        continue  # diverged units end a run: no point
                    error = bench.errors(run.columns, step, table)["w_motor"]
                    if _finite(error):
                        points.append(Point(name, scheme, step, run.seconds, error))
    return points


def _loops() -> list[Point]:
    table = bench.table_of(bench.inputs(), DURATION)
    right = bench.answer(table)
    points = []
    for step in LOOP_STEPS:
        times = alternate({"loop": partial(timed, partial(averaged, table, step))}, ROUNDS)["loop"]
        error = rms(averaged(table, step)["w_motor"] - right["w_motor"])
        points.append(Point("monolithic loop", "RK4", step, median(times), error))
    return points
