"""Where the sliders stand, kept: as a system for other simulators, or as a campaign that starts from there."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cobot_joint.diagnosis.repair.repair import repair
from cobot_joint.files import relative, results_folder, write_atomically
from cobot_joint.live.what_if import WhatIf

FOLDER = "live"  # in that of the results


def save_system(results: WhatIf, moved: Mapping[str, float]) -> list[Path]:
    """SSP files, with their FMUs beside them."""
    d = copy.deepcopy(results.diagnosis)
    for name, value in results.valued(moved).items():
        d["repaired"][name] = d["repaired"].get(name, {}) | {"value": value}
    for finding in d["findings"]:
        share, shape = moved.get(finding["term"], 1.0), finding.get("shape")
        for feature in (shape or {}).get("features", ()):
            feature["coefficient"]["value"] *= share
        if shape and shape.get("table"):
            shape["table"]["value"] = [share * y for y in shape["table"]["value"]]
    return list(repair(d, results.nominal, results_folder(results.folder / FOLDER)).values())


def save_campaign(results: WhatIf, moved: Mapping[str, float]) -> tuple[Path, list[str]]:
    """campaign.toml with the values as this machine's nominal ones, and what it cannot hold: forms without a name,
    loads from outside, and onsets.
    """
    given = tomllib.loads(results.campaign.path.read_text(encoding="utf-8"))
    out = results_folder(results.folder / FOLDER)
    values = {name: e["value"] for name, e in results.diagnosis["repaired"].items()}
    values |= results.valued(moved)
    given["parameters"] = given.get("parameters", {}) | values
    given["title"] = f"{given.get('title', results.campaign.title)}, from the live page"
    beside = results.campaign.path.parent
    for recording in given.get("recording", ()):
        files = recording["file"]
        several = [relative(beside / file, out) for file in ([files] if isinstance(files, str) else files)]
        recording["file"] = several[0] if isinstance(files, str) else several
    if (system := given.get("system")) and (beside / str(system)).is_file():
        given["system"] = relative(beside / system, out)
    path = out / "campaign.toml"
    text = toml(given)
    write_atomically(path, lambda file: file.write_text(text, encoding="utf-8"))
    left = [f["term"] for f in results.diagnosis["findings"] if f.get("shape") or f.get("load_history")]
    left += [f"{f['term']}'s onset" for f in results.diagnosis["findings"] if f.get("onset") is not None]
    return path, left


def toml(content: Mapping[str, Any]) -> str:
    """A campaign's tables: plain values first, then tables, then lists of tables; what is deeper stands in line."""
    plain = {k: v for k, v in content.items() if not _is_table(v) and not _are_tables(v)}
    lines = [f"{_key(k)} = {_value(v)}" for k, v in plain.items()]
    for name, table in content.items():
        if _is_table(table):
            lines += ["", f"[{_key(name)}]", *(f"{_key(k)} = {_value(v)}" for k, v in table.items())]
        for row in table if _are_tables(table) else ():
            lines += ["", f"[[{_key(name)}]]", *(f"{_key(k)} = {_value(v)}" for k, v in row.items())]
    return "\n".join(lines) + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


def _are_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, Mapping) for v in value)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
