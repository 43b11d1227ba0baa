"""What was answered, a line per case, as Markdown: `python proof/answers.py proof/sealed`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any


def line(case: str, answer: dict[str, Any]) -> str:
    """case, verdict, findings (could also be) with confidence and onset, slow structure above noise before and after"""
    said = []
    for f in answer["findings"]:
        also = f" (or {', '.join(f['equivalent'])})" if f["equivalent"] else ""
        since = "" if f["onset"] is None else f", from {f['onset']:.2f} s"
        said.append(f"{f['term']}{also}, {100 * f['confidence']:.0f} %{since}")
    above = answer["structure"]  # nothing where the recorded motion decided
    before, after = (f"{above[which]:.0f}" if above else "-" for which in ("calibrated", "repaired"))
    return f"| {case} | {answer['verdict']} | {'; '.join(said) or '-'} | {before} | {after} |"


def main(folder: Path) -> None:
    """See the module."""
    print("| case | verdict | findings | above noise, re-fitted | repaired |\n|---|---|---|---|---|")
    for path in sorted(folder.glob("*/diagnosis.json")):
        print(line(path.parent.name, json.loads(path.read_text())))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
