"""The system as a chain of its units, drawn as SVG in a row or upright, with marks where something is missing."""

from __future__ import annotations

import base64
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any, Literal

from cobot_joint.system.model import Component, System

WIDTH, HEIGHT, GAP = 150, 104, 36  # px of a unit in a row
TALL, LOW, WIDE = 58, 20, 360  # px of a unit, of the gap below it, and across, upright
PER_LINE, LINE = 21, 15  # letters and px of a label


@dataclass(frozen=True)
class Place:
    """A unit of the chain. icon: PNG as base64, or nothing. channels: read there. link: to the next unit."""

    name: str
    icon: str = ""
    channels: tuple[str, ...] = ()
    link: Literal["shaft", "wire", ""] = ""


def chain_of(system: System, channels: Collection[str]) -> list[Place]:
    """Units in the system's order, which is that of the flow from drive to load."""
    source = {w.sink: w.source_component for w in system.connections if w.sink_component is None}
    following = [*system.components[1:], None]
    return [
        Place(
            c.name,
            _icon(c.unit.directory / "model.png"),
            tuple(name for name in channels if source.get(name) == c.name),
            _link(system, c, after) if after else "",
        )
        for c, after in zip(system.components, following, strict=True)
    ]


def _link(system: System, one: Component, other: Component) -> Literal["shaft", "wire", ""]:
    """A shaft where an angle of a shaft end goes from one to the other."""
    wires = [w for w in system.connections if {w.source_component, w.sink_component} == {one.name, other.name}]
    angles = {(c.name, flange.phi) for c in (one, other) for flange in c.unit.flanges}
    shaft = any((w.source_component, w.source) in angles for w in wires)
    return "shaft" if shaft else "wire" if wires else ""


def _icon(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode() if path.is_file() else ""


def marked(
    places: Sequence[Place], found: Mapping[str, Sequence[str]], possible: Collection[str], upright: bool
) -> dict[str, Any]:
    """What `chain.svg.jinja` draws. found: unit -> labels of what it lacks. possible: units that it may be as well."""
    boxes: list[dict[str, Any]] = []
    for n, place in enumerate(places):
        labels = list(found.get(place.name, ()))
        kind = "found" if labels else "possible" if place.name in possible else "fine"
        below = [line for label in labels for line in wrap(label, 2 * PER_LINE if upright else PER_LINE)]
        reads = f"recorded: {', '.join(place.channels)}" if place.channels and not labels else ""
        below = below or (
            ["possible as well" if found else "it may lie here"]
            if kind == "possible"
            else wrap(reads, PER_LINE * (2 if upright else 1))
        )
        at = (1, n * (TALL + LOW) + 1) if upright else (n * (WIDTH + GAP) + 1, 1)
        boxes.append({"name": place.name, "icon": place.icon, "kind": kind, "below": below, "x": at[0], "y": at[1]})
    if upright:
        size = WIDE, max(len(places) * (TALL + LOW) - LOW, 0) + 2
    else:
        size = (
            max(len(places) * (WIDTH + GAP) - GAP, 0) + 2,
            HEIGHT + 8 + LINE * max((len(b["below"]) for b in boxes), default=0),
        )
    links = [{"box": box, "kind": place.link} for box, place in zip(boxes, places, strict=True) if place.link]
    return {"boxes": boxes, "links": links, "upright": upright, "width": size[0], "height": size[1]}
