"""Scoreboards side by side, as Markdown: `python proof/compare.py diagnose=results/open refit=results/open-refit`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

COUNTS = ("cases", "answered", "named_single")  # the same for all, or told by another


def cell(value: Any) -> str:
    """'k of n (interval)' of a rate, a number as it is, '-' where there is none."""
    if isinstance(value, dict):
        return "{k} of {n} ({:.2f} to {:.2f})".format(*value["ci95"], **value) if value["n"] else "-"
    return "-" if value is None else f"{value:g}"


def main(folders: dict[str, Path]) -> None:
    """See the module."""
    read = {name: json.loads((folder / "scoreboard.json").read_text()) for name, folder in folders.items()}
    scores = {name: score["summary"] | {"seconds_median": score["seconds_median"]} for name, score in read.items()}
    print("| | " + " | ".join(scores) + " |\n|---|" + "---|" * len(scores))
    for measure in dict.fromkeys(name for score in scores.values() for name in score if name not in COUNTS):
        print(f"| {measure.replace('_', ' ')} | " + " | ".join(cell(s[measure]) for s in scores.values()) + " |")


if __name__ == "__main__":
    main({name: Path(folder) for name, folder in (argument.split("=", 1) for argument in sys.argv[1:])})
