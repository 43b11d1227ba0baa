"""Which faulty channels are noticed before anything is fitted, and what is named where they are not, as tables.

    python -m tests.orchestrator.diagnosis.checks.faults                                   # noticed
    python -m tests.orchestrator.diagnosis.checks.faults --diagnose ["gain 2" "late by 5 ms: w_motor"]  # named; hours
    python -m tests.orchestrator.diagnosis.checks.faults --healthy SETDIR...  # what channels of sound logs would take

Runs of the bench, simulated with noise (noticed: two of proof/open/case01; named: those of case04, in which nothing is
missing), have one fault in one channel at a time.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.checks.beside_nominal import beside_nominal
from cobot_joint.diagnosis.checks.suspicions import suspicions
from cobot_joint.diagnosis.data.campaign import Campaign, load_campaign
from cobot_joint.diagnosis.data.clock import without_wild
from cobot_joint.diagnosis.data.recording import LeftOut, Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion, without_faults
from cobot_joint.diagnosis.engine import identify
from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.estimation.problem import one_blas_thread
from cobot_joint.diagnosis.findings import Diagnosis, Finding
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.diagnosis.report.words import misread
from cobot_joint.diagnosis.selection.misreading import suspects
from cobot_joint.diagnosis.store import Store

Vector = NDArray[np.float64]
Fault = Callable[[Vector, Recording, float], Vector]  # of a channel in one run; its largest value in all of them
OPEN = Path(__file__).parents[4] / "proof/open"
CASE, HEALTHY = OPEN / "case01", OPEN / "case04"
CHANNELS = ("i_motor", "w_motor", "tau_sensor", "v_command", "i_brake")
N = 112.66666666666667  # planetary_gear.ratio.N


def hold(x: Vector, r: Recording, reach: float) -> Vector:
    """30 % of the samples are the one before."""
    again = np.random.default_rng(3).random(len(x)) < 0.3
    return x[np.maximum.accumulate(np.where(again, 0, np.arange(len(x))))]


def freeze(x: Vector, r: Recording, reach: float) -> Vector:
    """One value over the fourth quarter."""
    k = 3 * len(x) // 4
    return np.where(np.arange(len(x)) < k, x, x[k])


FAULTS: dict[str, Fault] = {
    "none": lambda x, r, reach: x,
    "sign": lambda x, r, reach: -x,
    "factor 1000": lambda x, r, reach: 1e3 * x,
    "factor 1/1000": lambda x, r, reach: x / 1e3,
    "factor 10": lambda x, r, reach: 10 * x,
    "factor 60/2 pi (rpm)": lambda x, r, reach: x * 30 / np.pi,
    "gear ratio": lambda x, r, reach: x / N,
    "gain 2": lambda x, r, reach: 2 * x,
    "gain 1.1": lambda x, r, reach: 1.1 * x,
    "offset, a tenth of the range": lambda x, r, reach: x + 0.1 * reach,
    "late by 5 ms": lambda x, r, reach: np.interp(r.time - 5e-3, r.time, x),
    "clock 0.5 % fast": lambda x, r, reach: np.interp(1.005 * r.time, r.time, x),
    "clipped at 60 %": lambda x, r, reach: np.clip(x, -0.6 * np.abs(x).max(), 0.6 * np.abs(x).max()),
    "frozen for a quarter": freeze,
    "30 % of samples held": hold,
    "one sample of 1e6": lambda x, r, reach: np.where(np.arange(len(x)) == 77, 1e6, x),
    "zero": lambda x, r, reach: np.zeros_like(x),
    "another channel's column": lambda x, r, reach: next(y for y in r.outputs.values() if y is not x),
}


def faulty(recordings: list[Recording], name: str, fault: Fault) -> list[Recording]:
    """With the fault in that channel, in the runs that have it."""
    reach = max(np.nanmax(np.abs(series[name])) for r in recordings if name in (series := r.inputs | r.outputs))

    def one(r: Recording) -> Recording:
        kind = "inputs" if name in r.inputs else "outputs"
        series = dict(getattr(r, kind))
        if name not in series:
            return r
        x, count, said = without_wild(fault(series[name], r, reach))  # as when it is read
        x = np.interp(r.time, r.time[np.isfinite(x)], x[np.isfinite(x)]) if name in r.inputs else x
        wild = [LeftOut(name, "outlier", count, said)] if count else []
        return replace(r, **{kind: series | {name: x}}, left_out=wild)

    return without_faults(list(map(one, recordings)))


def look(runs: list[Recording], simulate: Simulator) -> list[Suspicion]:
    """What is said before anything is fitted."""
    return suspicions(runs) + beside_nominal(runs, simulate, {"planetary_gear.ratio.N": N})


def cell(found: list[Suspicion], name: str) -> str:
    own = [s for s in found if name in s.channel.split(", ")]
    stops = [s for s in found if s.wrong]
    if stops:
        return "**" + ", ".join(sorted({s.kind if s in own else f"{s.kind} of {s.channel}" for s in stops})) + "**"
    return ", ".join(sorted({s.kind if s in own else f"{s.kind} of {s.channel}" for s in found})) or "-"


LOGS = ("acquisition", "torque_sensor")  # what a fault of a channel may rightly be called after: what measures


def is_physics(finding: Finding) -> bool:
    """Whether it names something of the machine, rather than of what measures it, and is a claim."""
    return finding.confidence >= 0.5 and finding.component not in LOGS


def said(found: Diagnosis) -> str:
    """What a diagnosis names."""
    if found.misreading:
        return f"{found.misreading.channel}: {misread(found.misreading.to_json())}"
    words = [(f, f"{f.term} {100 * f.confidence:.0f} %") for f in found.findings]
    return ", ".join(f"**{text}**" if is_physics(f) else text for f, text in words) or found.verdict


def name_them(faults: Sequence[str]) -> None:
    """A table of what is named where a fault is not refused; bold: physics that is not there. "FAULT: CHANNEL" does one
    channel."""
    campaign = load_campaign(HEALTHY, roles=("train",))
    print("| fault | channel | before anything is fitted | named | s |\n|---|---|---|---|---|")
    for asked in faults or [words for words in FAULTS if words != "none"]:
        words, _, only = asked.partition(": ")
        for name in [only] if only else CHANNELS:
            if line := named(campaign, words, name):
                print(line, flush=True)


def named(campaign: Campaign, words: str, name: str) -> str:
    """One row; "": it is refused."""
    recordings = faulty(campaign.train, name, FAULTS[words])
    with Simulator(campaign.systems()) as simulate:
        seen = look(recordings, simulate)
    if any(s.wrong for s in seen):
        return ""
    begun = time.monotonic()
    with FmuPlant(campaign.systems()) as plant:
        found = identify(replace(campaign, recordings=recordings), plant)
    return f"| {words} | {name} | {cell(seen, name)} | {said(found)} | {time.monotonic() - begun:.0f} |"


def suspected(sets: Sequence[str]) -> None:
    """Of what is above noise in each campaign, the share that the gain and offset of the most suspicious channel are
    predicted to take. Where the campaigns' channels are sound, all of it is chance or physics."""
    print("| campaign | channel | share |\n|---|---|---|")
    for path in sorted(p for folder in sets for p in Path(folder).glob("case*/campaign.toml")):
        campaign = load_campaign(path, roles=("train",))
        with FmuPlant(campaign.systems()) as plant, one_blas_thread():
            problem, calibrated = calibrate(campaign, plant, lambda words: None, Store(None))
            if not problem.unexplained(calibrated.residual):
                continue
            worst = suspects(problem, calibrated)[0]
        share = worst.predicted / (calibrated.chi2 - problem.samples)
        print(f"| {path.parent.parent.name}/{path.parent.name} | {worst.reading.channel} | {share:.3f} |", flush=True)


def notice() -> None:
    """The table of what is noticed."""
    campaign = load_campaign(CASE, roles=("train",))
    print(f"| fault | {' | '.join(CHANNELS)} |\n|---|{'---|' * len(CHANNELS)}")
    with Simulator(campaign.systems()) as simulate:
        for words, fault in FAULTS.items():
            row = [cell(look(faulty(campaign.train[1:], n, fault), simulate), n) for n in CHANNELS]
            print(f"| {words} | {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    tables = {"--diagnose": name_them, "--healthy": suspected}
    tables[sys.argv[1]](sys.argv[2:]) if sys.argv[1:] else notice()
