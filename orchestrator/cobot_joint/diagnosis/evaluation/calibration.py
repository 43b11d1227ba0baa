"""How often the diagnosis is wrong: whole diagnoses of campaigns with known answers, counted.

    python -m cobot_joint.diagnosis.evaluation.calibration CAMPAIGN.toml [--campaigns 500] [--seconds 2] [--seed 0]
                       [--jobs 2] [--sizes 5 1000] [--effects 0.5 0.4 0.1] [--out calibration.jsonl]

The campaign lends its set-ups, inputs, channels and tolerances; every draw (synthetic.py) has parameters, terms, sizes,
onsets and noise of its own. One line of OUT per campaign; those that are there are not drawn again. Printed: Markdown
tables of false alarms against noise colour and of detection against size, and the confidences held against the counts.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from scipy.optimize import minimize

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.engine import identify
from cobot_joint.diagnosis.evaluation.score import rate
from cobot_joint.diagnosis.evaluation.synthetic import COLOURS, SIZES, Concealer, Drawn
from cobot_joint.diagnosis.findings import Diagnosis
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.selection.confidence import COUNTED, INTERCEPT, features

EFFECTS = (0.5, 0.4, 0.1)  # share of campaigns that conceal nothing, one, two: a false alarm is the worst of errors
EDGES = (0.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0, np.inf)  # of sizes, for the table
RIDGE = 0.3  # of the confidence's fit: few wrong findings leave its coefficients loose

Row = dict[str, Any]


@dataclass(frozen=True)
class Draws:
    """What is drawn, by number: the same numbers, the same campaigns."""

    pattern: Path
    seconds: float = 2.0
    seed: int = 0
    sizes: tuple[float, float] = SIZES
    effects: tuple[float, ...] = EFFECTS


def count(draws: Draws, out: Path, campaigns: int, jobs: int) -> list[Row]:
    """Draw and diagnose what is not yet in `out`; every row of it."""
    rows = read(out)
    missing = sorted(set(range(campaigns)) - {row["k"] for row in rows})
    out.parent.mkdir(parents=True, exist_ok=True)
    chunks = [missing[n : n + 4] for n in range(0, len(missing), 4)]  # a worker loads the units once per chunk
    work = (delayed(diagnosed)(draws, ks) for ks in chunks)
    for found in Parallel(n_jobs=jobs, return_as="generator_unordered")(work):
        with out.open("a") as file:
            file.writelines(json.dumps(row) + "\n" for row in found)
        rows += found
    return [row for row in rows if row["k"] < campaigns]


def read(path: Path) -> list[Row]:
    """Rows that an earlier call counted."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []


def diagnosed(draws: Draws, ks: Sequence[int]) -> list[Row]:
    """The campaigns number `ks` drawn, diagnosed and judged, one row each."""
    campaign = load_campaign(draws.pattern, roles=("train",))
    with FmuPlant(campaign.systems()) as plant:
        concealer = Concealer(campaign, plant, draws.seconds, draws.sizes)
        rows = []
        for k in ks:
            rng = np.random.default_rng((draws.seed, k))
            drawn = concealer.draw(rng, int(rng.choice(len(draws.effects), p=draws.effects)))
            begun = time.process_time()
            found = identify(drawn.campaign, plant)
            row = judge(drawn, found)
            rows.append({"k": k, **row, "seconds": round(time.process_time() - begun, 1)})
        return rows


def judge(drawn: Drawn, diagnosis: Diagnosis) -> Row:
    """What was concealed, what was said, and which of it is true: terms of one name are one answer (score.py)."""
    names = [c.active.term.name.split(".")[1] for c in drawn.effects]
    places = [c.active.term.component for c in drawn.effects]
    said = [{f.term.split(".")[1], *(t.split(".")[1] for t in f.equivalent)} for f in diagnosis.findings]
    named = [any(name in s for s in said) for name in names]
    effects = [
        {**c.to_json(), "component": place, "named": hit}
        for c, place, hit in zip(drawn.effects, places, named, strict=True)
    ]
    findings = []
    for f, s in zip(diagnosis.findings, said, strict=True):
        abstained = "unlisted" in s and any(f.component == p and not hit for p, hit in zip(places, named, strict=True))
        x = features(f.gain, diagnosis.structure["repaired"], "unlisted" in s)
        true = bool(s & set(names)) or abstained
        findings.append({"term": f.term, "gain": f.gain, "features": x, "confidence": f.confidence, "true": true})
    intervals = [
        (value, e.ci95) for name, value in drawn.base.items() if (e := diagnosis.repaired.get(name)) and e.ci95
    ]
    return {
        "colour": drawn.colour,
        "effects": effects,
        "findings": findings,
        "inside": [bool(low <= value <= high) for value, (low, high) in intervals],
        "verdict": diagnosis.verdict,
        "structure": diagnosis.structure,
    }


def tables(rows: Sequence[Row]) -> str:
    """Markdown."""
    lines = ["| colour | healthy campaigns | with a claim | 95 % |", "|---|---|---|---|"]
    healthy = [r for r in rows if not r["effects"]]
    for colour in COLOURS:
        lines.append(_rate(f"{colour}", [bool(r["findings"]) for r in healthy if r["colour"] == colour]))
    lines.append(_rate("all", [bool(r["findings"]) for r in healthy]))
    lines += ["", "| size | effects | named | 95 % |", "|---|---|---|---|"]
    effects = [e for r in rows for e in r["effects"]]
    for low, high in pairwise(EDGES):
        there = [e["named"] for e in effects if low <= e["chi_after_refit"] < high]
        lines.append(_rate(f"{low:g} to {high:g}" if np.isfinite(high) else f"above {low:g}", there))
    lines += ["", "| term, size above 40 | effects | named | 95 % |", "|---|---|---|---|"]
    large = [e for e in effects if e["chi_after_refit"] >= 40]
    for name in sorted({e["name"].split(".")[1] for e in large}):
        lines.append(_rate(name, [e["named"] for e in large if e["name"].split(".")[1] == name]))
    findings = [f for r in rows for f in r["findings"]]
    lines += ["", "| confidence given | findings | true | 95 % |", "|---|---|---|---|"]
    for (low, high), *_ in COUNTED:
        given = [f["true"] for f in findings if low <= f["confidence"] < high]
        lines.append(_rate(f"{low:g} to {min(high, 1):g}", given))
    lines += ["", "| 95 % intervals of base parameters | number | with the true value | 95 % |", "|---|---|---|---|"]
    is_right = [all(e["named"] for e in r["effects"]) and all(f["true"] for f in r["findings"]) for r in rows]
    for words, wanted in (("beside what was answered right", True), ("beside what was not", False)):
        inside = [x for r, right in zip(rows, is_right, strict=True) if right == wanted for x in r.get("inside", [])]
        lines.append(_rate(words, inside))
    squares = [(f["confidence"] - f["true"]) ** 2 for f in findings]
    lines += [
        "",
        f"{len(rows)} campaigns, {sum(is_right)} right; Brier score of the confidences {np.mean(squares):.4f}",
    ]
    return "\n".join(lines)


def _rate(words: str, outcomes: Iterable[bool]) -> str:
    outcomes = list(outcomes)
    found = rate(sum(outcomes), len(outcomes))
    interval = "{:.3f} to {:.3f}".format(*found["ci95"]) if found["ci95"] else ""
    return f"| {words} | {len(outcomes)} | {sum(outcomes)} | {interval} |"


def fitted_confidence(rows: Sequence[Row]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Coefficients of confidence.py by penalised maximum likelihood: intercept, then one per feature."""
    findings = [f for r in rows for f in r["findings"]]
    x = np.array([[1.0, *f["features"]] for f in findings])
    y = np.array([f["true"] for f in findings], dtype=float)

    def loss(b: Any) -> float:
        return float(np.sum(np.logaddexp(0, x @ b) - y * (x @ b)) + RIDGE * np.sum(b[1:] ** 2))

    return np.asarray(minimize(loss, np.array([INTERCEPT, *np.zeros(x.shape[1] - 1)])).x)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--campaigns", type=int, default=500)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--sizes", type=float, nargs=2, default=SIZES, metavar=("LEAST", "MOST"))
    parser.add_argument(
        "--effects", type=float, nargs="+", default=EFFECTS, metavar="SHARE", help="none, one, two, ..."
    )
    parser.add_argument("--out", type=Path, default=Path("build/calibration.jsonl"))
    given = parser.parse_args()
    draws = Draws(given.campaign, given.seconds, given.seed, tuple(given.sizes), tuple(given.effects))
    rows = count(draws, given.out, given.campaigns, given.jobs)
    print(tables(rows))
    print("\nconfidence.py, fitted:", ", ".join(f"{b:.2f}" for b in fitted_confidence(rows)))


if __name__ == "__main__":
    main()
