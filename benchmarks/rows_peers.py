"""Rows against other masters: trivial units show what a master costs, the bench's own units what a user gets."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks import bench
from benchmarks.measure import Row, alternate, at_least, at_most, median, missing, ratio, summary
from benchmarks.ours import NOTHING, Ours
from benchmarks.peers import GAUSS_SEIDEL, JACOBI, PEERS, Absent, Run, Wiring
from benchmarks.peers.client import Peer
from cobot_joint.cosim import Simulation

RING = 4  # trivial units
RING_STEPS = 50_000
OWN_COST = 0.25  # us per communication step and unit
STEP, DURATION = 2e-4, 6.0  # s, of the bench in every master; the first of its grips is in it
ROUNDS = 3
OURS = {JACOBI: "jacobi", GAUSS_SEIDEL: "gauss_seidel"}


@contextmanager
def workers(python: str) -> Iterator[tuple[dict[str, Peer], dict[str, str]]]:
    """Every peer that is there, and why the others are not."""
    there: dict[str, Peer] = {}
    absent: dict[str, str] = {}
    for name in PEERS:
        try:
            there[name] = Peer(name, python)
        except Absent as why:
            absent[name] = str(why)
    try:
        yield there, absent
    finally:
        for peer in there.values():
            peer.close()


def _timed(peer: Peer, wiring: Wiring, runs: dict[str, Run]) -> Callable[[], float]:
    def contestant() -> float:
        runs[peer.name] = peer.run(wiring)
        return runs[peer.name].seconds

    return contestant


def own_cost(python: str) -> list[Row]:
    """What a master costs per communication step and unit, measured with units that cost nothing."""
    title = "master's own cost per communication step and FMU (trivial FMUs, outputs recorded)"
    step = 1e-3
    stop = RING_STEPS * step
    with tempfile.TemporaryDirectory() as folder, workers(python) as (there, absent):
        system = bench.ring(Path(folder), RING, stop)
        wiring = bench.wiring(system, Path(folder), step)
        with Simulation(system) as simulation:
            contestants: dict[str, Callable[[], float]] = {
                "ours": Ours(simulation, NOTHING, stop, scheme=OURS[JACOBI], step=step, output_step=step)
            }
            contestants |= {name: _timed(peer, wiring, {}) for name, peer in there.items()}
            times = alternate(contestants, ROUNDS)
    costs = {name: median(t) / RING_STEPS / RING * 1e6 for name, t in times.items()}
    note = "peers: " + ", ".join(f"{name} {cost:.2g}" for name, cost in costs.items() if name != "ours")
    note += "".join(f"; {name} absent: {why}" for name, why in absent.items())
    return [at_most(title, costs["ours"], OWN_COST, "us", note, us=costs, seconds=summary(times))]


def same_bench(python: str) -> list[Row]:
    """The bench's own units in every master, at one step, in the scheme that both know."""
    system, inputs = bench.joint(), bench.inputs()
    table = bench.table_of(inputs, DURATION)
    rows = []
    with (
        tempfile.TemporaryDirectory() as folder,
        workers(python) as (there, absent),
        Simulation(system) as simulation,
        Simulation(system, "reference") as reference,
    ):
        for name, peer in there.items():
            scheme = GAUSS_SEIDEL if GAUSS_SEIDEL in peer.schemes else JACOBI
            runs: dict[str, Run] = {}
            wiring = bench.wiring(system, Path(folder), STEP, table, scheme)
            ours = Ours(simulation, inputs, DURATION, scheme=OURS[scheme], step=STEP, output_step=STEP)
            title = f"{name}: same FMUs, {scheme}, {STEP * 1e3:g} ms, its time / ours"
            rows.append(_against(title, name, _timed(peer, wiring, runs), ours, 10 if name == "fmpy_loop" else 1))
            if name in runs:
                rows[-1].details["rms errors"] = bench.errors(runs[name].columns, STEP, table)
        title = "same scheme (default), step and bits in plain FMPy, its time / ours"
        slow = Ours(reference, inputs, DURATION)
        fast = Ours(simulation, inputs, DURATION)
        rows.append(_against(title, "plain FMPy", slow, fast, 10))
    return rows + [missing(f"{name}: same FMUs, scheme, step", ">= 1 x", why) for name, why in absent.items()]


def _against(title: str, name: str, theirs: Callable[[], float], ours: Ours, limit: float) -> Row:
    try:
        times = alternate({name: theirs, "ours": ours}, ROUNDS)
    except RuntimeError as error:
        return missing(title, f">= {limit} x", str(error).strip().splitlines()[-1])
    note = f"{median(times[name]):.3g} s against {median(times['ours']):.3g} s"
    return at_least(title, ratio(times, name, "ours"), limit, "x", note, seconds=summary(times))
