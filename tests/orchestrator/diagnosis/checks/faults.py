"""Which faulty channels are noticed before anything is fitted, and what is named where they are not, as tables.

    python -m tests.orchestrator.diagnosis.checks.faults             # noticed
    python -m tests.orchestrator.diagnosis.checks.faults --diagnose  # named; an hour

Runs of the bench, simulated with noise (noticed: two of proof/open/case01; named: those of case04, in which nothing is
missing), have one fault in one channel at a time.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.checks.beside_nominal import beside_nominal
from cobot_joint.diagnosis.checks.suspicions import suspicions
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion
from cobot_joint.diagnosis.engine import identify
from cobot_joint.diagnosis.findings import Finding
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.simulator import Simulator

Vector = NDArray[np.float64]
Fault = Callable[[Vector, Recording], Vector]
OPEN = Path(__file__).parents[4] / "proof/open"
CASE, HEALTHY = OPEN / "case01", OPEN / "case04"
CHANNELS = ("i_motor", "w_motor", "tau_sensor", "v_command", "i_brake")
N = 112.66666666666667  # planetary_gear.ratio.N


def hold(x: Vector, r: Recording) -> Vector:
    """30 % of the samples are the one before."""
    again = np.random.default_rng(3).random(len(x)) < 0.3
    return x[np.maximum.accumulate(np.where(again, 0, np.arange(len(x))))]


def freeze(x: Vector, r: Recording) -> Vector:
    """One value over the fourth quarter."""
    k = 3 * len(x) // 4
    return np.where(np.arange(len(x)) < k, x, x[k])


FAULTS: dict[str, Fault] = {
    "none": lambda x, r: x,
    "sign": lambda x, r: -x,
    "factor 1000": lambda x, r: 1e3 * x,
    "factor 1/1000": lambda x, r: x / 1e3,
    "factor 10": lambda x, r: 10 * x,
    "factor 60/2 pi (rpm)": lambda x, r: x * 30 / np.pi,
    "gear ratio": lambda x, r: x / N,
    "gain 2": lambda x, r: 2 * x,
    "gain 1.1": lambda x, r: 1.1 * x,
    "offset, a tenth of the range": lambda x, r: x + 0.1 * np.nanmax(np.abs(x)),
    "late by 5 ms": lambda x, r: np.interp(r.time - 5e-3, r.time, x),
    "clock 0.5 % fast": lambda x, r: np.interp(1.005 * r.time, r.time, x),
    "clipped at 60 %": lambda x, r: np.clip(x, -0.6 * np.abs(x).max(), 0.6 * np.abs(x).max()),
    "frozen for a quarter": freeze,
    "30 % of samples held": hold,
    "one sample of 1e6": lambda x, r: np.where(np.arange(len(x)) == 77, 1e6, x),
    "zero": lambda x, r: np.zeros_like(x),
    "another channel's column": lambda x, r: next(y for y in r.outputs.values() if y is not x),
}


def faulty(r: Recording, name: str, fault: Fault) -> Recording:
    """With the fault in that channel, where the run has it."""
    kind = "inputs" if name in r.inputs else "outputs"
    series = dict(getattr(r, kind))
    return replace(r, **{kind: series | {name: fault(series[name], r)}}) if name in series else r


def look(runs: list[Recording], simulate: Simulator) -> list[Suspicion]:
    """What is said before anything is fitted."""
    return suspicions(runs) + beside_nominal(runs, simulate, {"planetary_gear.ratio.N": N})


def cell(found: list[Suspicion], name: str) -> str:
    own = [s for s in found if name in s.channel.split(", ")]
    stops = [s for s in found if s.wrong]
    if stops:
        return "**" + ", ".join(sorted({s.kind if s in own else f"{s.kind} of {s.channel}" for s in stops})) + "**"
    return ", ".join(sorted({s.kind if s in own else f"{s.kind} of {s.channel}" for s in found})) or "-"


UNNOTICED = ("gain 2", "gain 1.1", "offset, a tenth of the range")  # in channels that move
LOGS = ("acquisition", "torque_sensor")  # what a fault of a channel may rightly be called after: what measures


def is_physics(finding: Finding) -> bool:
    """Whether it names something of the machine, rather than of what measures it, and is a claim."""
    return finding.confidence >= 0.5 and finding.component not in LOGS


def said(finding: Finding) -> str:
    words = f"{finding.term} {100 * finding.confidence:.0f} %"
    return f"**{words}**" if is_physics(finding) else words


def name_them() -> None:
    """A table of what is named in the channels that nothing was noticed in; bold: physics that is not there."""
    campaign = load_campaign(HEALTHY, roles=("train",))
    print("| fault | channel | named |\n|---|---|---|")
    with Simulator(campaign.systems()) as simulate:
        quiet = [
            (words, name)
            for words in UNNOTICED
            for name in CHANNELS
            if not look([faulty(r, name, FAULTS[words]) for r in campaign.train], simulate)
        ]
    for words, name in quiet:
        recordings = [faulty(r, name, FAULTS[words]) for r in campaign.train]
        with FmuPlant(campaign.systems()) as plant:
            found = identify(replace(campaign, recordings=recordings), plant)
        print(f"| {words} | {name} | {', '.join(map(said, found.findings)) or found.verdict} |", flush=True)


def notice() -> None:
    """The table of what is noticed."""
    campaign = load_campaign(CASE, roles=("train",))
    print(f"| fault | {' | '.join(CHANNELS)} |\n|---|{'---|' * len(CHANNELS)}")
    with Simulator(campaign.systems()) as simulate:
        for words, fault in FAULTS.items():
            row = [cell(look([faulty(r, n, fault) for r in campaign.train[1:]], simulate), n) for n in CHANNELS]
            print(f"| {words} | {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    name_them() if sys.argv[1:] == ["--diagnose"] else notice()
