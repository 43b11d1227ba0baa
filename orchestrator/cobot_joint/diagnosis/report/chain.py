"""The system as a chain of its units, drawn as SVG in a row or upright, with marks where something is missing."""

from __future__ import annotations

import base64
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any

from cobot_joint.system.model import System

WIDTH, HEIGHT, GAP = 150, 104, 36  # px of a unit in a row
TALL, LOW, WIDE = 58, 20, 360  # px of a unit, of the gap below it, and across, upright
PER_LINE, LINE = 21, 15  # letters and px of a label


@dataclass(frozen=True)
class Place:
    """A unit of the chain. icon: PNG as base64, or nothing. channels: read there. shaft: one leads to the next unit."""

    name: str
    icon: str = ""
    channels: tuple[str, ...] = ()
    shaft: bool = False


def chain_of(system: System, channels: Collection[str]) -> list[Place]:
    """Units in the system's order, which is that of the flow from drive to load."""
    names = [c.name for c in system.components]
    source = {w.sink: w.source_component for w in system.connections if w.sink_component is None}
    flanged = {
        frozenset((w.source_component, w.sink_component)) for w in system.connections if w.source in _angles(system, w)
    }
    return [
        Place(
            c.name,
            _icon(c.unit.directory / "model.png"),
            tuple(name for name in channels if source.get(name) == c.name),
            frozenset((c.name, after)) in flanged,
        )
        for c, after in zip(system.components, [*names[1:], None], strict=True)
    ]


def _angles(system: System, wire: Any) -> set[str]:
    """Of a wire's source, the variables that are angles of shaft ends."""
    if wire.source_component is None:
        return set()
    return {flange.phi for flange in system.component(wire.source_component).unit.flanges}


def _icon(path: Any) -> str:
    return base64.b64encode(path.read_bytes()).decode() if path.is_file() else ""


def marked(
    places: Sequence[Place], found: Mapping[str, Sequence[str]], possible: Collection[str], upright: bool
) -> dict[str, Any]:
    """What `chain.svg.jinja` draws. found: unit -> labels of what it lacks. possible: units that it may be as well."""
    boxes = []
    for n, place in enumerate(places):
        labels = list(found.get(place.name, ()))
        kind = "found" if labels else "possible" if place.name in possible else "fine"
        below = [line for label in labels for line in wrap(label, 2 * PER_LINE if upright else PER_LINE)]
        reads = f"recorded: {', '.join(place.channels)}" if place.channels and not labels else ""
        below = below or (["possible as well"] if kind == "possible" else wrap(reads, PER_LINE * (2 if upright else 1)))
        at = (1, n * (TALL + LOW) + 1) if upright else (n * (WIDTH + GAP) + 1, 1)
        boxes.append({"name": place.name, "icon": place.icon, "kind": kind, "below": below, "x": at[0], "y": at[1]})
    if upright:
        size = WIDE, max(len(places) * (TALL + LOW) - LOW, 0) + 2
    else:
        size = (
            max(len(places) * (WIDTH + GAP) - GAP, 0) + 2,
            HEIGHT + 8 + LINE * max((len(b["below"]) for b in boxes), default=0),
        )
    links = [
        {"box": box, "shaft": place.shaft} for box, place in zip(boxes[:-1], places[:-1], strict=True)
    ]
    return {"boxes": boxes, "links": links, "upright": upright, "width": size[0], "height": size[1]}
