"""The page of the benchmarks: what `python -m benchmarks` measured, from the files that are kept of it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from cobot_joint.diagnosis.store import read_object
from figures import svg

GROUPS = ("averaged", "peers", "own-cost", "cost", "isolation", "simscape", "runs", "hour")
PEER = re.compile(r"(\w+): same FMUs, (.+?), 0\.2 ms, its time / ours")
KEY = '<span class="after">●</span> ours <span class="before">○</span> others <span class="band">■</span> one C loop'
Json = Mapping[str, Any]


def page(root: Path) -> str:
    """Markdown."""
    folder = root / "benchmarks" / "measured"
    measured = {group: found for group in GROUPS if (found := read_object(folder / f"{group}.json")[0])}
    rows = [row for found in measured.values() for row in found["rows"]]
    drawn = [faster([row for row in rows if PEER.fullmatch(row["title"])]), cost(points(folder))]
    return "\n".join(
        [
            "---\nhide: [toc]\n---\n",
            "# The benchmarks in figures\n",
            f"Measured by `python -m benchmarks` {machines(list(measured.values()))}. [What counts, and how to run "
            "it](../../benchmarks/README.md).\n",
            cards(rows),
            f'<div class="results">{"".join(drawn)}</div>\n',
            table(rows),
        ]
    )


def points(folder: Path) -> list[Json]:
    """Runs of ours, of every peer and of the loop, with their errors."""
    return list(json.loads((folder / "error_against_cost.json").read_text(encoding="utf-8")))


def machines(measured: Sequence[Json]) -> str:
    """When, and on what."""
    days = sorted({found["date"][:10] for found in measured})
    kinds = sorted({f"{found['machine']['cores']} cores, {found['machine']['cpu']}" for found in measured})
    return f"on {' and '.join(days)}, {' and '.join(kinds)}"


def cards(rows: Sequence[Json]) -> str:
    """How many rows are met, and those that have a figure of one machine."""
    met = sum(row["met"] is True for row in rows)
    missed = sum(row["met"] is False for row in rows)
    shown = [("reached", str(met), f"of {met + missed} rows")]
    shown += [(row["title"], figure(row), f"reach {row['reach']}") for row in rows if not is_peer(row) and row["value"]]
    cells = (
        f"<div><dt>{escape(label)}</dt><dd><b>{value}</b><small>{escape(note)}</small></dd></div>"
        for label, value, note in shown
    )
    return f'<dl class="cards">{"".join(cells)}</dl>\n'


def is_peer(row: Json) -> bool:
    """Whether it is in one of the pictures."""
    return bool(PEER.fullmatch(row["title"])) or row["title"].startswith("error against cost")


def figure(row: Json) -> str:
    """As `python -m benchmarks` prints it."""
    return "-" if row["value"] is None else f"{row['value']:.3g} {row['unit']}"


def faster(rows: Sequence[Json]) -> str:
    """What other masters take for the same run, over what ours takes."""
    masters = []
    for row in sorted((row for row in rows if row["value"]), key=lambda row: row["value"]):
        found = PEER.fullmatch(row["title"])
        assert found
        masters.append(svg.Row(f"{found[1]}, {found[2]}", "#rows", (row["value"],), row["met"] is False))
    axis = svg.around("time of the same run / ours [1]", [1.0, *(row.values[0] for row in masters)])
    words = "The joint in steps of 0.2 ms, the same FMUs in the same scheme; a dot per master."
    return svg.dots("faster", "Other masters' time over ours", axis, masters, words)


def cost(measured: Sequence[Json]) -> str:
    """rms error of the motor's speed over seconds, a line per contestant and scheme."""
    lines: dict[tuple[str, str], list[tuple[float, float, str]]] = {}
    for p in measured:
        said = f"{p['who']}, {p['scheme']}, {1e3 * p['step']:g} ms: {p['seconds']:.3g} s, {p['error']:.3g} rad/s"
        lines.setdefault((p["who"], p["scheme"]), []).append((p["seconds"], p["error"], said))
    kinds = {"ours": "after", "monolithic loop": "band"}
    series = [svg.Series(kinds.get(who, "before"), tuple(sorted(found))) for (who, _), found in lines.items()]
    x = svg.around("time of a run [s]", [p["seconds"] for p in measured])
    y = svg.around("rms error of the motor's speed [rad/s]", [p["error"] for p in measured])
    words = f"{len(measured)} runs of the joint, below and to the left is better."
    return svg.curves("cost", "Error against cost", x, y, series, words, KEY)


def table(rows: Sequence[Json]) -> str:
    """Every row."""
    head = "".join(f'<th scope="col">{title}</th>' for title in ("row", "measured", "reach", "reached"))
    said = {True: "yes", False: "missed", None: "not run"}
    body = "\n".join(
        f"<tr><td>{escape(row['title'])}<small>{escape(row['note'])}</small></td>"
        + "".join(f"<td>{escape(cell)}</td>" for cell in (figure(row), row["reach"], said[row["met"]]))
        + "</tr>"
        for row in rows
    )
    return (
        f'## Rows {{ #rows }}\n\n<table class="counts"><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>\n'
    )
