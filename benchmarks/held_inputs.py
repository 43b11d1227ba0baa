"""Error over step of the bench in other masters, inputs held: `python -m benchmarks.held_inputs [--peers PYTHON]`.

load_mr_brake, rms against the monolithic loop at 10 us, as rows of a Markdown table; "-": the coupling diverges.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from benchmarks import bench
from benchmarks.peers import Wiring
from benchmarks.peers.client import Peer
from benchmarks.rows_peers import workers

STEPS = [1e-4, 2e-4, 5e-4, 1e-3]  # s


def errors(peer: Peer, wiring: Wiring, table: bench.Table) -> str:
    """`i [A], w [rad/s]` of the motor."""
    try:
        found = bench.errors(peer.run(wiring).columns, wiring.step, table)
    except RuntimeError:  # diverged units end a run
        return "-"
    return f"{found['i_motor']:.1e}, {found['w_motor']:.1e}" if found["w_motor"] < 1e3 else "-"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.held_inputs", description=__doc__)
    parser.add_argument("--peers", default=sys.executable, help="interpreter of the environment that has the peers")
    parser.add_argument("--duration", type=float, default=bench.DURATION, help="s, of the bench")
    arguments = parser.parse_args()
    table = bench.table_of(bench.inputs(), arguments.duration)
    print("| master | scheme | " + " | ".join(f"{step * 1e3:g} ms" for step in STEPS) + " |")
    print("|---|---|" + "--:|" * len(STEPS))
    with tempfile.TemporaryDirectory() as folder, workers(arguments.peers) as (there, absent):
        for name, peer in there.items():
            for scheme in peer.schemes:
                wirings = (bench.wiring(bench.joint(), Path(folder), step, table, scheme) for step in STEPS)
                cells = (errors(peer, wiring, table) for wiring in wirings)
                print(f"| {name} | {scheme} | " + " | ".join(cells) + " |", flush=True)
    for name, why in absent.items():
        print(f"{name} is not here: {why}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
