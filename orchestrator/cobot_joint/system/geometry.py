"""Where editors draw a system's components and connectors: components in a row, inputs at their left, outputs right."""

from __future__ import annotations

from collections.abc import Sequence

from cobot_joint.system.model import Connector

WIDTH, GAP, PER_CONNECTOR, MARGIN = 40.0, 30.0, 6.0, 20.0  # SSP has no unit of length
Box = dict[str, str]


def element_box(place: int, ports: Sequence[Connector]) -> Box:
    """Corners of the component that is `place` from the left."""
    left = MARGIN + place * (WIDTH + GAP)
    return _box(left, MARGIN, left + WIDTH, MARGIN + _height(ports))


def system_box(parts: Sequence[Sequence[Connector]]) -> Box:
    """Corners of the area around components with these connectors."""
    width = 2 * MARGIN + len(parts) * WIDTH + (len(parts) - 1) * GAP
    return _box(0.0, 0.0, width, 2 * MARGIN + max(map(_height, parts), default=0.0))


def connector_point(connector: Connector, ports: Sequence[Connector]) -> Box:
    """Place among `ports`, those of the same element: from 0 to 1 over its width and height."""
    alike = [p.name for p in ports if p.causality == connector.causality]
    y = (alike.index(connector.name) + 1) / (len(alike) + 1)
    return {"x": "0" if connector.causality == "input" else "1", "y": f"{y:.4g}"}


def _height(ports: Sequence[Connector]) -> float:
    sides = [sum(p.causality == causality for p in ports) for causality in ("input", "output")]
    return PER_CONNECTOR * (max(sides) + 1)


def _box(*corners: float) -> Box:
    return {name: f"{value:g}" for name, value in zip(("x1", "y1", "x2", "y2"), corners, strict=True)}
