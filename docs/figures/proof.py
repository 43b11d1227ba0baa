"""The page of the proof: every set's figures and pictures, from the answers that lie in `proof`.

What is right and what is not says the same function as in `cobot-joint prove`.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from cobot_joint.diagnosis.evaluation.prove import cases_of, scored, seconds_median
from cobot_joint.diagnosis.evaluation.score import rate
from cobot_joint.diagnosis.selection.confidence import COUNTED
from cobot_joint.diagnosis.store import read_object
from figures import svg

SETS = {
    "sealed": "Sealed: answered before the truths were published",
    "field_sealed": "Sealed machines with a background",
    "real": "Machines that nobody here built",
    "open": "Open: what the diagnosis was developed against",
}
CONFIDENCE = svg.Axis("confidence stated", 0.0, 1.0)


@dataclass(frozen=True)
class Case:
    """What is kept of one case."""

    set: str
    name: str
    answer: Mapping[str, Any]
    channels: Mapping[str, Mapping[str, float]]  # rms errors and noise, on held-out runs where there are figures
    held_out: bool
    row: Mapping[str, Any] | None  # of the scoreboard

    @property
    def anchor(self) -> str:
        """Of its row in the table."""
        return f"{self.set}-{self.name}"

    @property
    def wrong(self) -> bool:
        """Whether the truth is known and the answer is another."""
        return self.row is not None and not self.row["right"]

    def over_noise(self, variant: str) -> float:
        """rms error in units of the noise, over all channels."""
        squares = [(c[variant] / c["noise"]) ** 2 for c in self.channels.values()]
        return math.sqrt(sum(squares) / len(squares))


def page(root: Path) -> str:
    """Markdown."""
    parts = [
        "---\nhide: [toc]\n---\n",
        "# The proof in figures\n",
        "Counted and drawn from the answers that are kept in the project, when this site is built. "
        "How they came about: [concealed campaigns](../proof/concealed.md). Before: nominal parameters re-fitted; "
        "after: the repaired system. × marks a wrong answer; a case's name leads to its row or its page.\n",
    ]
    for name, title in SETS.items():
        parts += [f"## {title} {{ #{name} }}\n", of_set(root / "proof" / name)]
    return "\n".join(parts)


def of_set(folder: Path) -> str:
    """Cards, pictures and table of a set."""
    cases, score = read(folder)
    if not cases:
        return (
            f"{len(cases_of(folder))} campaigns. No answers are kept here: their truths were known all along. "
            f"`cobot-joint prove proof/{folder.name} --out results/{folder.name}` answers and scores them.\n"
        )
    parts = (introduction(folder, cases, score), cards(folder, cases, score), pictures(cases, score), table(cases))
    return "\n\n".join(parts) + "\n"


def read(folder: Path) -> tuple[list[Case], dict[str, Any] | None]:
    """Cases with an answer, and the scoreboard where the truths are published."""
    answers = {
        case: answer for case in cases_of(folder) if (answer := read_object(folder / case / "diagnosis.json")[0])
    }
    score = scored(folder, folder) if answers else None
    rows = {row["case"]: row for row in score["rows"]} if score else {}
    cases = []
    for name, answer in answers.items():
        verify, _ = read_object(folder / name / "verify.json")
        channels = {c: _errors(answer, verify, c) for c in answer["channels"]}
        cases.append(Case(folder.name, name, answer, channels, verify is not None, rows.get(name)))
    return cases, score


def _errors(answer: Mapping[str, Any], verify: Mapping[str, Any] | None, channel: str) -> dict[str, float]:
    trained = answer["channels"][channel]
    figures = verify["channels"][channel] if verify else trained["train"]
    return {"noise": trained["noise"], "before": figures["calibrated"], "after": figures["repaired"]}


def introduction(folder: Path, cases: Sequence[Case], score: Mapping[str, Any] | None) -> str:
    """How many, fixed at which commit, and what is not known of them."""
    words = [f"{len(cases_of(folder))} campaigns, {len(cases)} answers."]
    frozen, _ = read_object(folder / "frozen.json")
    if frozen:
        words.append(f"The answers are those of commit `{frozen['commit'][:7]}`.")
    if not score and frozen:
        words.append("The truths are not published yet: what is right is not known.")
    elif not score:
        words.append("Nobody knows the truth; what counts is the error on runs that were held out.")
    return " ".join(words)


def cards(folder: Path, cases: Sequence[Case], score: Mapping[str, Any] | None) -> str:
    """The set's figures."""
    shown = [*(_judged(score["summary"]) if score else _answered(cases))]
    median = seconds_median([case.name for case in cases], folder)
    if median:
        shown.append(("seconds per case, median", svg.number(median), ""))
    cells = (f"<div><dt>{label}</dt><dd><b>{value}</b><small>{note}</small></dd></div>" for label, value, note in shown)
    return f'<dl class="cards">{"".join(cells)}</dl>'


def _judged(summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """From a scoreboard of either kind: a machine's with a background counts without intervals."""
    right = summary["right"] if isinstance(summary["right"], dict) else rate(summary["right"], summary["cases"])
    shown = [("right", *_of(right))]
    if "false_claims" in summary:
        shown.append(("false claims", *_of(summary["false_claims"])))
        removed = summary["excess_error_removed_median"]
        shown.append(
            ("error above noise removed, median", "-" if removed is None else f"{100 * removed:.2f} %", "held-out runs")
        )
    else:
        shown.append(("false claims", str(summary["false"]), ""))
        shown.append(("better on held-out runs", *_of(rate(summary["better"], summary["verified"]))))
    brier = summary["brier"]
    return [*shown, ("Brier score", "-" if brier is None else f"{brier:.3f}", "0 is perfect, 0.25 a coin")]


def _of(counts: Mapping[str, Any]) -> tuple[str, str]:
    if not counts["n"]:
        return "-", ""
    low, high = counts["ci95"]
    return f"{counts['k']} of {counts['n']}", f"95 %: {100 * low:.0f} to {100 * high:.0f} %"


def _answered(cases: Sequence[Case]) -> list[tuple[str, str, str]]:
    verdicts = Counter(case.answer["verdict"] for case in cases)
    return [(f"verdict: {verdict.replace('_', ' ')}", str(n), "") for verdict, n in verdicts.most_common()]


def pictures(cases: Sequence[Case], score: Mapping[str, Any] | None) -> str:
    """Errors, confidences and seconds."""
    name = cases[0].set
    drawn = [errors(cases)]
    timed = [svg.Row(c.name, link(c), (c.answer["seconds"],), c.wrong) for c in cases if c.answer.get("seconds")]
    if timed:
        axis = svg.from_zero("time of the diagnosis [s]", [row.values[0] for row in timed])
        drawn.append(svg.bars(f"{name}-seconds", "Seconds per case", axis, timed, "A bar per case."))
    if score and all("conf" in row for row in score["rows"]):
        drawn.append(outcomes(name, "Confidence against outcome", score["rows"]))
    else:
        rows = [svg.Row(c.name, link(c), tuple(f["confidence"] for f in c.answer["findings"]), c.wrong) for c in cases]
        words = "A dot per finding of each case."
        drawn.append(svg.dots(f"{name}-confidence", "Confidence of every finding", CONFIDENCE, rows, words))
    return f'<div class="results">{"".join(drawn)}</div>'


def errors(cases: Sequence[Case]) -> str:
    """Before and after: over the noise, or, where channels are not a bench's three, as a share of what was before."""
    name = cases[0].set
    verified = [case for case in cases if case.held_out]
    runs = "held-out runs" if verified else "the runs that were fitted"
    if name == "real":
        rows = [
            svg.Row(f"{case.name}: {channel}", link(case), (100.0, 100 * e["after"] / e["before"]))
            for case in verified
            for channel, e in case.channels.items()
        ]
        axis = svg.Axis("rms error [% of before]", 0.0, max(100.0, *(row.values[1] for row in rows)))
        return svg.pairs(f"{name}-error", f"Error on {runs}", axis, rows, "A row per channel that was held out.")
    shown = verified or cases
    rows = [svg.Row(c.name, link(c), (c.over_noise("before"), c.over_noise("after")), c.wrong) for c in shown]
    axis = svg.around("rms error / noise [1]", [value for row in rows for value in row.values])
    return svg.pairs(
        f"{name}-error", f"Error on {runs}", axis, rows, "A row per case; 1 (dashed) is as good as it gets."
    )


def outcomes(name: str, title: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Confidences against what was true, in the classes that the counts have."""
    conf = [(c, true) for row in rows for c, true in row["conf"]]
    found = []
    for (low, high), *_ in COUNTED:
        there = [true for c, true in conf if low <= c < high]
        found.append(svg.Share(low, min(high, 1.0), len(there), sum(there)))
    return svg.shares(f"{name}-confidence", title, found, f"{len(conf)} findings.")


def link(case: Case) -> str:
    """A machine's own page, or the row of a concealed case."""
    if case.set == "real":
        return f"../../proof/{re.sub(r'_[0-9]+$', 's', case.name) if case.name.startswith('screw') else case.name}/"
    return f"#{case.anchor}"


def table(cases: Sequence[Case]) -> str:
    """Every figure that is drawn, and what was concealed and said."""
    known = any(case.row for case in cases)
    head = [
        "case",
        *(["concealed"] if known else []),
        "verdict",
        "said",
        "before",
        "after",
        "seconds",
        *(["right"] if known else []),
    ]
    unit = "error in units of the noise" if cases[0].set != "real" else "rms error, in the channel's unit"
    runs = "held-out runs" if any(case.held_out for case in cases) else "runs that were fitted"
    rows = "\n".join(_table_row(case, known) for case in cases)
    return (
        f"<details><summary>Table: every case ({unit}, {runs})</summary>\n<table><thead><tr>"
        + "".join(f"<th>{cell}</th>" for cell in head)
        + f"</tr></thead><tbody>\n{rows}\n</tbody></table></details>"
    )


def _table_row(case: Case, known: bool) -> str:
    said = ", ".join(f"{f['term']} ({100 * f['confidence']:.0f} %)" for f in case.answer["findings"]) or "-"
    name = f'<a href="{link(case)}">{case.name}</a>'
    cells = [
        name,
        case.answer["verdict"].replace("_", " "),
        escape(said),
        _figures(case, "before"),
        _figures(case, "after"),
    ]
    cells.append(svg.number(case.answer["seconds"]) if case.answer.get("seconds") else "-")
    if known:
        concealed = ", ".join(effect["name"] for effect in case.row["effects"]) if case.row else ""
        cells.insert(1, escape(concealed) or "nothing")
        cells.append('<span class="wrong">× no</span>' if case.wrong else "yes")
    return f'<tr id="{case.anchor}">' + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def _figures(case: Case, variant: str) -> str:
    if case.set != "real":
        return svg.number(case.over_noise(variant))
    if not case.held_out:
        return "-"
    return ", ".join(f"{name} {svg.number(errors[variant])}" for name, errors in case.channels.items())
