"""Pictures as data, and as one HTML file each that zooms, opens offline and needs no other file."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

# Okabe and Ito's palette, which colour-blind people can tell apart
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
# what a curve is, wherever it is drawn: on white and on black
COLOUR = {"recorded": "#808080", "nominal": COLOURS[3], "calibrated": COLOURS[1], "repaired": COLOURS[0]}
PANEL, MARGIN = 260, 120  # px
QUANTITY = {
    "V": "voltage", "A": "current", "N.m": "torque", "N": "force", "rad": "angle", "rad/s": "speed", "m": "position",
    "m/s": "speed", "K": "temperature", "W": "power", "1": "",
}  # fmt: skip
FLAT = 0.1  # of the largest in a panel: less is a flat line there, and gets a panel with its like
SAME, MOSTLY = 0.02, 0.8  # of a panel's height, for so much of the time: one curve hides another


@dataclass(frozen=True)
class Curve:
    """One line, or markers, in a panel. label: the same has the same colour in all panels; none: not in the legend."""

    label: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    style: Literal["line", "dashed", "markers"] = "line"
    colour: str = ""  # where it is not the next of the palette


@dataclass(frozen=True)
class Panel:
    """Curves over a shared x axis."""

    y_label: str
    curves: Sequence[Curve]


@dataclass(frozen=True)
class Picture:
    """Panels above one another, to become `stem`.html and `stem`.png; `what`: a caption for lists of files."""

    stem: Path
    what: str
    title: str
    x_label: str
    panels: Sequence[Panel]
    x_log: bool = False

    @property
    def colours(self) -> dict[str, str]:
        """label -> colour; what a curve is goes before its place in the palette"""
        labels = dict.fromkeys(c.label for p in self.panels for c in p.curves if not c.colour and c.label not in COLOUR)
        return COLOUR | {label: COLOURS[n % len(COLOURS)] for n, label in enumerate(labels)}

    @property
    def files(self) -> dict[Path, str]:
        """path -> what it shows"""
        forms = {".html": "to zoom", ".png": "picture"}
        return {self.stem.with_suffix(suffix): f"{self.what}, {form}" for suffix, form in forms.items()}


def over_time(
    time: NDArray[np.float64], signals: Mapping[str, NDArray[np.float64]], units: Mapping[str, str | None]
) -> list[Panel]:
    """Panels by unit; what would be flat there has one of its own. `signals`: name -> float64[n] at `time`: s."""
    by_unit: dict[str, list[str]] = {}
    for name in signals:
        by_unit.setdefault(units.get(name) or "1", []).append(name)
    panels = []
    for unit, names in by_unit.items():
        for group in _of_a_size(names, signals):
            curves: list[Curve] = []
            for name in group:
                hides = any(_coincide(signals[name], c.y) for c in curves if c.style == "line")
                curves.append(Curve(name, time, signals[name], "dashed" if hides else "line"))
            panels.append(Panel(f"{QUANTITY.get(unit, '')} [{unit}]".strip(), curves))
    return panels


def _of_a_size(names: Sequence[str], signals: Mapping[str, NDArray[np.float64]]) -> list[list[str]]:
    """Groups of names, largest first, in which none is flat; what is zero throughout stays with the largest."""
    largest = {name: float(np.nanmax(np.abs(signals[name]), initial=0.0)) for name in names}
    groups: list[list[str]] = []
    for name in sorted((n for n in names if largest[n] > 0), key=lambda n: -largest[n]):
        if not groups or largest[name] < FLAT * largest[groups[-1][0]]:
            groups.append([])
        groups[-1].append(name)
    zero = [name for name in names if not largest[name] > 0]
    groups = [[*groups[0], *zero], *groups[1:]] if groups else [zero]
    return [[name for name in names if name in group] for group in groups]


def _coincide(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether one curve would hide the other."""
    there = np.isfinite(one) & np.isfinite(other)  # gaps hide nothing
    if not there.any():
        return False
    height = max(np.ptp(one[there]), np.ptp(other[there]))
    return bool(np.mean(np.abs(one - other)[there] <= SAME * height) > MOSTLY)


def write_html(picture: Picture) -> Path:
    """For plotly.js, which is written into the file; its figure is plain JSON, so that Python's side is not needed."""
    path = picture.stem.with_suffix(".html")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure = json.dumps(_figure(picture)).replace("</", "<\\/")
    path.write_text(
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(picture.title)}</title>'
        f'<script>{_plotly_js()}</script></head><body><div id="figure"></div>'
        f'<script>Plotly.newPlot("figure", {figure});</script></body></html>\n',
        encoding="utf-8",
    )
    return path


@cache
def _plotly_js() -> str:
    spec = find_spec("plotly")  # not imported: that takes longer than many a run
    assert spec is not None
    assert spec.submodule_search_locations
    return (Path(spec.submodule_search_locations[0]) / "package_data" / "plotly.min.js").read_text(encoding="utf-8")


def _figure(picture: Picture) -> dict[str, Any]:
    """https://plotly.com/javascript/reference: one x axis, a y axis per panel."""
    data: list[dict[str, Any]] = []
    colours, told = picture.colours, {""}
    for n, panel in enumerate(picture.panels):
        for curve in panel.curves:
            legend = {"legendgroup": curve.label, "showlegend": curve.label not in told}
            axes = {"xaxis": "x", "yaxis": f"y{_nth(n)}"}
            data.append(_trace(curve, curve.colour or colours[curve.label]) | axes | legend)
            told.add(curve.label)
    layout = {
        "title": {"text": picture.title},
        "xaxis": {"title": {"text": picture.x_label}, "type": "log" if picture.x_log else "linear"},
        "grid": {"rows": len(picture.panels), "columns": 1, "pattern": "coupled", "ygap": 0.08},
        "height": MARGIN + PANEL * len(picture.panels),
        **{f"yaxis{_nth(n)}": {"title": {"text": panel.y_label}} for n, panel in enumerate(picture.panels)},
    }
    return {"data": data, "layout": layout, "config": {"responsive": True}}


def _nth(n: int) -> str:
    return "" if n == 0 else str(n + 1)


def _trace(curve: Curve, colour: str) -> dict[str, Any]:
    trace: dict[str, Any] = {"name": curve.label, "x": samples(curve.x), "y": samples(curve.y)}
    if curve.style == "markers":
        return trace | {"type": "scatter", "mode": "markers", "marker": {"color": colour}}
    dash = "dash" if curve.style == "dashed" else "solid"
    return trace | {"type": "scatter", "mode": "lines", "line": {"color": colour, "dash": dash, "width": 1.5}}


def samples(x: NDArray[np.float64]) -> dict[str, str]:
    """float64[n] as plotly.js's typed array."""
    return {"dtype": "f8", "bdata": base64.b64encode(np.ascontiguousarray(x, dtype="<f8").tobytes()).decode()}
