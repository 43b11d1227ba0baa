"""What every kept result of a diagnosis depends on: the program, the systems, the campaign's settings and its runs."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cobot_joint import paths
from cobot_joint.cosim import library
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.system.model import System
from cobot_joint.system.write import describe
from cobot_joint.units import find_fmu, load_unit
from cobot_joint.version import __version__

if TYPE_CHECKING:
    from cobot_joint.diagnosis.frequency.response import Response

# of a campaign: no settings, or taken by content below
ELSEWHERE = {"title", "path", "setups", "recordings", "notes", "suspicions"}


def of_campaign(campaign: Campaign, systems: Mapping[str, System]) -> dict[str, Any]:
    """Of a campaign of time series. Held-out runs are not among it: they are never fitted."""
    return {
        "program": program(),
        "systems": {setup: content(system) for setup, system in systems.items()},
        "settings": _fields(campaign, ELSEWHERE),
        "recordings": [_fields(recording, {"path", "notes"}) for recording in campaign.train],
    }


def of_response(response: Response) -> dict[str, Any]:
    """Of a campaign of a frequency response."""
    return {"program": program(), "system": content(response.system), **_fields(response, {"path", "system"})}


@cache
def program() -> dict[str, str]:
    """Versions, and SHA-256 of this package's sources, the native master and the unit that corrections are made of."""
    return {
        "version": __version__,
        "sources": sources(paths.PACKAGE),
        "native": hashlib.sha256(Path(library.load()._name).read_bytes()).hexdigest(),
        "correction": load_unit(find_fmu("correction.fmu")).directory.name,
        **{name: version(name) for name in ("numpy", "scipy")},
    }


def sources(package: Path) -> str:
    """SHA-256 of every Python file under a folder, with its name there."""
    found = hashlib.sha256()
    for file in sorted(package.rglob("*.py")):
        text = file.read_bytes()
        found.update(f"{file.relative_to(package).as_posix()} {len(text)}\n".encode() + text)
    return found.hexdigest()


def content(system: System) -> str:
    """SHA-256 of a system: wires and their factors, parameters, coupling, and its FMUs by the hash of their bytes."""
    fmus = {component.name: component.unit.directory.name for component in system.components}
    return hashlib.sha256(describe(system, fmus)).hexdigest()


def _fields(instance: Any, without: set[str]) -> dict[str, Any]:
    """By name, so that a field that is added counts from the day on which it is there."""
    return {f.name: getattr(instance, f.name) for f in fields(instance) if f.name not in without}
