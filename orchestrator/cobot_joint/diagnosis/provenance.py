"""Where a diagnosis comes from: the program, and every file that was read."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cobot_joint.diagnosis.data.campaign import files_of
from cobot_joint.results.files import versions
from cobot_joint.system.model import Component, System
from cobot_joint.version import __version__

DIGITS = 12  # of a SHA-256, hexadecimal: enough to tell one's own files apart, and short enough to read


def provenance(
    path: Path,
    title: str,
    systems: Mapping[str, System],
    *,
    parameters: Mapping[str, Any] | None = None,
    baseline: str | None = None,
) -> dict[str, str]:
    """Names, versions and SHA-256 as text: nothing of the machine, and no date, so that the same answer has the same.

    path: campaign.toml, whose recordings are read again. parameters: as the campaign gives them.
    """
    libraries = versions() | {"scipy": version("scipy")}
    del libraries["cobot-joint"]
    files = [s.path for s in systems.values() if s.path]
    facts = {
        "tool": f"cobot-joint {__version__}" + (f", baseline {baseline}" if baseline else ""),
        "versions": ", ".join(f"{name} {number}" for name, number in libraries.items()),
        "campaign": f"{title}: {_hashed([path], path.parent)}",
        "recordings": _hashed(files_of(path), path.parent),
        "system": _hashed(dict.fromkeys(files), path.parent),
        "units": ", ".join(f"{c.name} {c.unit.description.guid}" for c in components(systems)),
    }
    if parameters:
        facts["parameters"] = ", ".join(f"{name} = {value}" for name, value in parameters.items())
    return facts


def components(systems: Mapping[str, System]) -> list[Component]:
    """Of all set-ups, each once."""
    return list({c.name: c for system in systems.values() for c in system.components}.values())


def _hashed(files: Iterable[Path], folder: Path) -> str:
    """`name (SHA-256, its first digits)`; a name is the path in the folder, of a file elsewhere the last part."""
    said = []
    for file in files:
        with file.open("rb") as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
        name = file.relative_to(folder).as_posix() if file.is_relative_to(folder) else file.name
        said.append(f"{name} (SHA-256 {digest[:DIGITS]})")
    return ", ".join(said)
