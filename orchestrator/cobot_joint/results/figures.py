"""Pictures of runs: each once as HTML to zoom into and once as PNG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import plotly.graph_objects as go
from matplotlib.figure import Figure
from numpy.typing import NDArray
from plotly.subplots import make_subplots


@dataclass(frozen=True)
class Curve:
    """One line, or markers, in a panel."""

    label: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    style: Literal["line", "dashed", "markers", "bars"] = "line"


@dataclass(frozen=True)
class Panel:
    """Curves over a shared x axis."""

    y_label: str
    curves: Sequence[Curve]


def draw(
    stem: Path, what: str, title: str, x_label: str, panels: Sequence[Panel], x_log: bool = False
) -> dict[Path, str]:
    """`stem`.html and `stem`.png; path -> what it shows. plotly.min.js is written beside them: HTML opens offline."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    _interactive(title, x_label, panels, x_log).write_html(stem.with_suffix(".html"), include_plotlyjs="directory")
    _still(title, x_label, panels, x_log).savefig(stem.with_suffix(".png"), dpi=110)
    return {stem.with_suffix(suffix): f"{what}, {form}" for suffix, form in ((".html", "to zoom"), (".png", "picture"))}


def time_figures(
    stem: Path,
    title: str,
    time: NDArray[np.float64],
    signals: Mapping[str, NDArray[np.float64]],
    units: Mapping[str, str | None],
) -> dict[Path, str]:
    """Signals over time, one panel per unit. `signals`: name -> float64[n] at `time`: float64[n]"""
    by_unit: dict[str, list[Curve]] = {}
    for name, samples in signals.items():
        by_unit.setdefault(units.get(name) or "1", []).append(Curve(name, time, samples))
    panels = [Panel(f"[{unit}]", curves) for unit, curves in by_unit.items()]
    return draw(stem, "signals over time", title, "time [s]", panels)


def _interactive(title: str, x_label: str, panels: Sequence[Panel], x_log: bool) -> go.Figure:
    figure = make_subplots(rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, panel in enumerate(panels, start=1):
        for curve in panel.curves:
            if curve.style == "bars":
                trace = go.Bar(x=curve.x, y=curve.y, name=curve.label)
            elif curve.style == "markers":
                trace = go.Scatter(x=curve.x, y=curve.y, name=curve.label, mode="markers")
            else:
                line = {"dash": "dash"} if curve.style == "dashed" else {}
                trace = go.Scatter(x=curve.x, y=curve.y, name=curve.label, mode="lines", line=line)
            figure.add_trace(trace, row=row, col=1)
        figure.update_yaxes(title_text=panel.y_label, row=row, col=1)
    if x_log:
        figure.update_xaxes(type="log")
    figure.update_xaxes(title_text=x_label, row=len(panels), col=1)
    return figure.update_layout(title=title, template="plotly_white", height=120 + 260 * len(panels))


def _still(title: str, x_label: str, panels: Sequence[Panel], x_log: bool) -> Figure:
    figure = Figure(figsize=(10, 1 + 2.4 * len(panels)), layout="constrained")
    figure.suptitle(title)
    axes = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
    for axis, panel in zip(axes, panels, strict=True):
        for curve in panel.curves:
            if curve.style in ("markers", "bars"):
                axis.plot(curve.x, curve.y, "o" if curve.style == "markers" else "s", ms=4, label=curve.label)
            else:
                axis.plot(curve.x, curve.y, "--" if curve.style == "dashed" else "-", lw=1.2, label=curve.label)
        axis.set_ylabel(panel.y_label)
        axis.grid(alpha=0.3)
        axis.legend(fontsize="small", loc="best", ncols=1 + len(panel.curves) // 4)
        if x_log:
            axis.set_xscale("log")
    axes[-1].set_xlabel(x_label)
    return figure
