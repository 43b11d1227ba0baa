"""How often a name given beside a background is right: drawn machines with backgrounds, diagnosed and counted.

    python -m cobot_joint.diagnosis.evaluation.background_count CAMPAIGN.toml [--machines 100] [--seconds 8] [--seed 0]
                       [--effects 0.4 0.4 0.2] [--unlisted 0.2] [--misstated 0.2] [--jobs 2] [--out backgrounds.jsonl]

The campaign lends its set-ups, inputs, channels and tolerances; every draw (backgrounds.py) has parameters, a
background, terms, sizes and noise of its own. One line of OUT per machine; those that are there are not drawn again.
Printed: Markdown tables of what was named, by size over the background, and of the confidences against the counts.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.engine import identify
from cobot_joint.diagnosis.evaluation.backgrounds import MISSTATED, UNLISTED, FieldConcealer, FieldDrawn
from cobot_joint.diagnosis.evaluation.score import OUT_OF_TOLERANCE, rate
from cobot_joint.diagnosis.evaluation.synthetic import Concealer
from cobot_joint.diagnosis.findings import Diagnosis
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.errors import UserError

EFFECTS = (0.4, 0.4, 0.2)  # share of machines that conceal nothing, one, two
EDGES = (0.0, 3.0, 6.0, 12.0, np.inf)  # of effects over the background
SURE = (0.0, 0.5, 0.8, 0.9, 1.01)

Row = dict[str, Any]


@dataclass(frozen=True)
class Draws:
    """What is drawn, by number: the same numbers, the same machines."""

    pattern: Path
    seconds: float = 8.0
    seed: int = 0
    effects: tuple[float, ...] = EFFECTS
    unlisted: float = UNLISTED
    misstated: float = MISSTATED

    def to_json(self) -> Row:
        """As every row has it."""
        shares = {"effects": list(self.effects), "unlisted": self.unlisted, "misstated": self.misstated}
        return {"pattern": self.pattern.parent.name, "seconds": self.seconds, "seed": self.seed, **shares}


def count(draws: Draws, out: Path, machines: int, jobs: int) -> list[Row]:
    """Draw and diagnose what is not yet in `out`; every row of it. UserError: it has rows of other draws."""
    rows = [json.loads(line) for line in out.read_text().splitlines()] if out.is_file() else []
    if others := [row["k"] for row in rows if row.get("draws") != draws.to_json()]:
        raise UserError(f"{out}: machine {others[0]} was drawn otherwise than asked for; give another --out")
    missing = sorted(set(range(machines)) - {row["k"] for row in rows})
    out.parent.mkdir(parents=True, exist_ok=True)
    work = (delayed(counted)(draws, k) for k in missing)
    for row in Parallel(n_jobs=jobs, return_as="generator_unordered")(work):
        with out.open("a") as file:
            file.write(json.dumps(row) + "\n")
        rows.append(row)
    return [row for row in rows if row["k"] < machines]


def counted(draws: Draws, k: int) -> Row:
    """The machine number k drawn, diagnosed and judged."""
    campaign = load_campaign(draws.pattern, roles=("train",))
    rng = np.random.default_rng((draws.seed, k))
    with FmuPlant(campaign.systems()) as plant:
        concealer = FieldConcealer(Concealer(campaign, plant, draws.seconds), draws.unlisted, draws.misstated)
        machine = concealer.draw(rng, int(rng.choice(len(draws.effects), p=draws.effects)))
        begun, at = time.process_time(), time.monotonic()
        found = identify(machine.drawn.campaign, plant)
    row = judge(machine, found)
    took = {"cpu": round(time.process_time() - begun, 1), "seconds": round(time.monotonic() - at, 1)}
    return {"k": k, "draws": draws.to_json(), "background": machine.background, **row, **took}


def judge(machine: FieldDrawn, found: Diagnosis) -> Row:
    """What was concealed, what was said, and which of it is true, terms of one name being indistinguishable.

    What is on no list is named by `component.unlisted`, and not where that is only said beside a listed term."""
    concealed = _concealed(machine)
    said = [{_name(t) for t in (f.term, *f.equivalent) if t == f.term or _on(t) == _on(f.term)} for f in found.findings]
    accepted = {name for names, _ in concealed for name in names}
    return {
        "effects": [{**told, "named": any(names & s for s in said)} for names, told in concealed],
        "findings": [
            {"term": f.term, "equivalent": f.equivalent, "evidence": f.gain, "confidence": f.confidence,
             "true": bool(s & accepted), "confidence_from": f.ground}
            for f, s in zip(found.findings, said, strict=True)
        ],
        "verdict": found.verdict,
        "left": found.structure,
    }  # fmt: skip


def _concealed(machine: FieldDrawn) -> list[tuple[set[str], Row]]:
    """Per effect, names that are accepted for it, and what it is. over: its size over the background's."""
    samples = sum(int(np.isfinite(y).sum()) for r in machine.drawn.campaign.recordings for y in r.outputs.values())
    background = machine.background * float(np.sqrt(samples))
    listed = [(c.active.term.name, c.active.onset, c.size) for c in machine.drawn.effects]
    listed += [(m.name, None, m.size) for m in machine.misstated]
    found: list[tuple[set[str], Row]] = [
        (_same(_name(term)), {"term": term, "onset": onset, "over": size / background}) for term, onset, size in listed
    ]
    names = [[f"{component}.unlisted" for component in u.components] for u in machine.unlisted]
    return found + [
        (set(own), {"term": own[0], "onset": None, "over": u.size / background})
        for own, u in zip(names, machine.unlisted, strict=True)
    ]


def _same(name: str) -> set[str]:
    """Names of the same physics: a gap that is too wide is a backlash, and either may be concealed."""
    pairs = [{term, *map(_name, parameters)} for term, parameters in OUT_OF_TOLERANCE.items()]
    return {name}.union(*(pair for pair in pairs if name in pair))


def _on(term: str) -> bool:
    """Whether it is on the list."""
    return not term.endswith(".unlisted")


def _name(term: str) -> str:
    """Without its unit, but for what is on no list."""
    return term if term.endswith(".unlisted") else term.split(".", 1)[1]


def tables(rows: Sequence[Row]) -> str:
    """Markdown."""
    healthy = [bool(r["findings"]) for r in rows if not r["effects"]]
    sure = [any(f["confidence"] >= 0.5 for f in r["findings"]) for r in rows if not r["effects"]]
    lines = ["| machines that conceal nothing | count | with | 95 % |", "|---|---|---|---|"]
    lines += [_rate("any finding", healthy), _rate("one at 0.5 or more", sure)]
    lines += ["", "| effect over background | effects | named | 95 % |", "|---|---|---|---|"]
    effects = [e for r in rows for e in r["effects"]]
    for low, high in pairwise(EDGES):
        words = f"{low:g} to {high:g}" if np.isfinite(high) else f"above {low:g}"
        lines.append(_rate(words, [e["named"] for e in effects if low <= e["over"] < high]))
    findings = [f for r in rows for f in r["findings"]]
    lines += ["", "| confidence given | findings | true | 95 % |", "|---|---|---|---|"]
    for low, high in pairwise(SURE):
        words = f"{low:g} to {min(high, 1):g}"
        lines.append(_rate(words, [f["true"] for f in findings if low <= f["confidence"] < high]))
    squares = [(f["confidence"] - f["true"]) ** 2 for f in findings] + [1.0 for e in effects if not e["named"]]
    brier = f"{np.mean(squares):.3f}" if squares else "-"
    return "\n".join([*lines, "", f"{len(rows)} machines; Brier score, effects that were missed among it, {brier}"])


def _rate(words: str, outcomes: Sequence[bool]) -> str:
    found = rate(sum(outcomes), len(outcomes))
    interval = "{:.3f} to {:.3f}".format(*found["ci95"]) if found["ci95"] else ""
    return f"| {words} | {len(outcomes)} | {sum(outcomes)} | {interval} |"


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--machines", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--effects", type=float, nargs="+", default=EFFECTS, help="shares of none, one, two")
    parser.add_argument("--unlisted", type=float, default=UNLISTED, help="share of the effects that are on no list")
    parser.add_argument("--misstated", type=float, default=MISSTATED, help="share of the others: wrong data sheets")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/backgrounds.jsonl"))
    given = parser.parse_args()
    shares = tuple(given.effects), given.unlisted, given.misstated
    draws = Draws(given.campaign, given.seconds, given.seed, *shares)
    try:
        print(tables(count(draws, given.out, given.machines, given.jobs)))
    except UserError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
