"""Scheme monolithic beside adaptive, on one core: `python -m benchmarks.monolithic [SHARED]`, as Markdown tables.

Errors are rms against the reference solutions in SHARED/reference. Terms are switched on one at a time, over 16 s of
proof/open/case14's runs; there the difference is that between the two schemes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np
import pyarrow.parquet as pq

from benchmarks.measure import rms
from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.results.result import Result
from cobot_joint.system import Inputs
from cobot_joint.system.model import System
from cobot_joint.system.read import load_system

SCENARIOS, CHANNELS = ("no_load", "load_mr_brake", "load_hand", "reversals"), ("i_motor", "w_motor", "tau_sensor")
TERMS: dict[str, dict[str, float]] = {
    "base": {},
    "cogging, order 6": {"motor_bldc.cogging.n": 6, "motor_bldc.cogging.A": 5e-3},
    "torque ripple, order 13": {"motor_bldc.torque_ripple.n": 13, "motor_bldc.torque_ripple.A": 3e-4},
    "hysteresis of the reading": {"torque_sensor.hysteresis.tau_H": 0.3, "torque_sensor.hysteresis.H": 0.02},
}
ROUNDS = 5


def runs(system: System, experiment: dict[str, object]) -> dict[str, tuple[Result, float, int]]:
    """Scheme -> result, median ms of CPU, steps."""
    found = {}
    with Simulation(system) as simulation:
        for scheme in ("adaptive", "monolithic"):
            spent = []
            for _ in range(ROUNDS):
                begun = process_time()
                result = simulation.run(Experiment(**experiment, scheme=scheme))  # type: ignore[arg-type]
                spent.append(1e3 * (process_time() - begun))
            found[scheme] = result, median(spent), simulation.counters["steps"]
    return found


def against_reference(shared: Path) -> None:
    print("| scenario, 20 s | scheme | ms | steps | i [A] | w [rad/s] | tau_s [N.m] |\n|---|---|--:|--:|--:|--:|--:|")
    for scenario in SCENARIOS:
        table = pq.read_table(shared / "reference" / f"{scenario}.parquet")
        right = {name.split(" [")[0]: table[name].to_numpy() for name in table.column_names}
        system = load_system("joint_no_load" if scenario == "no_load" else "joint")
        inputs = Inputs(right["time"], {name: right[name] for name in system.inputs})
        for scheme, (result, ms, steps) in runs(system, {"inputs": inputs, "stop_time": 20.0}).items():
            errors = [f"{rms(result.signals[c] - right[c]):.1e}" if c in result.signals else "" for c in CHANNELS]
            print(f"| {scenario} | {scheme} | {ms:.0f} | {steps} | {' | '.join(errors)} |", flush=True)


def terms() -> None:
    campaign = load_campaign(Path(__file__).parents[1] / "proof/open/case14/campaign.toml", roles=("train",))
    print("\n| term, 16 s | recording | adaptive [ms] | monolithic [ms] | i, difference [A] |\n|---|---|--:|--:|--:|")
    for title, parameters in TERMS.items():
        for recording in campaign.train:
            system, t = campaign.systems()[recording.setup], recording.time - recording.time[0]
            there = {
                name: x for name, x in parameters.items() if name.split(".")[0] in [c.name for c in system.components]
            }
            run = {"inputs": Inputs(t, dict(recording.inputs)), "stop_time": float(t[-1]), "parameters": there}
            (one, slow, _), (other, fast, _) = runs(system, run).values()
            difference = rms(np.asarray(one.signals["i_motor"] - other.signals["i_motor"]))
            print(f"| {title} | {recording.name} | {slow:.0f} | {fast:.0f} | {difference:.1e} |", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.monolithic", description=__doc__)
    parser.add_argument("shared", nargs="?", type=Path, default=Path(__file__).parents[2] / "shared")
    against_reference(parser.parse_args().shared)
    terms()
    return 0


if __name__ == "__main__":
    sys.exit(main())
