"""Pictures of where the difference lies: replayed parts, units that can be told apart, operating conditions, time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from cobot_joint.diagnosis.localization.change_points import WINDOW
from cobot_joint.diagnosis.repair.compare import Comparison
from cobot_joint.diagnosis.report.pictures import Picture, as_html
from cobot_joint.results.figures import COLOUR

FINE, OFF, EVEN = COLOUR["repaired"], COLOUR["calibrated"], "rgba(128,128,128,0.35)"
LEAST = 1e-3  # chi-square per sample above noise that is still drawn
MOST = 6  # variables


def located_pictures(
    located: Mapping[str, Any], compared: Sequence[Comparison], noise: Mapping[str, float]
) -> dict[str, list[Picture]]:
    """By the keys of `located["words"]`. located: as diagnosis.json has it; noise: 1 sigma per channel."""
    pictures: dict[str, list[Picture]] = {key: [] for key in located.get("words", {})}
    if located["components"]["parts"]:
        pictures["components"].append(parts_picture(located["components"]["parts"]))
    if located["isolability"]:
        pictures["isolability"].append(isolability_picture(located["isolability"]))
    if located["regimes"]:
        pictures["regimes"].append(conditions_picture(located["regimes"]))
        pictures["time"] += [
            time_picture(c, located["change_points"], noise) for c in compared if c.recording.role == "train"
        ]
    return pictures


def _above(c: Mapping[str, Any]) -> float | None:
    """Of a part's channel, chi-square per sample above noise; None: the part diverges."""
    return None if None in (c["refitted"], c["healthy"]) else c["refitted"] - c["healthy"]


def parts_picture(parts: Sequence[Mapping[str, Any]]) -> Picture:
    """How far each part's channels are off when it is driven by recordings."""
    rows = [
        (f"{', '.join(p['units'])}<br>{_drive(p)}: <b>{name}</b>", _above(c), c["off"])
        for p in reversed(parts)
        for name, c in reversed(p["channels"].items())
    ]
    figure = go.Figure()
    for off, colour, name in ((True, OFF, "off"), (False, FINE, "within noise")):
        chosen = [row for row in rows if row[2] == off]
        figure.add_bar(
            y=[row[0] for row in chosen],
            x=[max(row[1] or 0.0, LEAST) for row in chosen],
            orientation="h",
            marker_color=colour,
            name=name,
        )
    figure.update_yaxes(categoryorder="array", categoryarray=[row[0] for row in rows], automargin=True)
    figure.update_xaxes(type="log", title_text="chi-square per sample above noise [1]")
    figure.update_layout(height=120 + 42 * len(rows))
    words = (
        "Each part of the system alone, driven by what was recorded at its ports and re-fitted inside its tolerances."
    )
    return Picture("Part by part", words, as_html(figure))


def _drive(part: Mapping[str, Any]) -> str:
    return f"{part['setup']}, driven by {', '.join(part['driven_by'])}" if part["driven_by"] else part["setup"]


def isolability_picture(isolability: Mapping[str, Any]) -> Picture:
    """Which units could explain a difference in which."""
    units = isolability["detectable"]
    confused = [[float(o == u or o in isolability["confused"][u]) for o in units] for u in units]
    scale = [(0.0, EVEN), (1.0, OFF)]
    figure = go.Figure(
        go.Heatmap(x=units, y=units, z=confused, zmin=0, zmax=1, colorscale=scale, showscale=False, xgap=2, ygap=2)
    )
    figure.update_yaxes(autorange="reversed", title_text="a difference in", automargin=True)
    figure.update_xaxes(title_text="looks like one in", automargin=True)
    figure.update_layout(height=130 + 38 * len(units))
    words = "Orange: cannot be told apart by these channels, whatever the experiment. Grey: can be, at best."
    return Picture("What the channels can tell apart", words, as_html(figure))


def conditions_picture(regimes: Mapping[str, Sequence[Mapping[str, Any]]]) -> Picture:
    """Per variable and level the share of what is above noise, beside the share of the samples."""
    chosen = list(regimes.items())[:MOST]
    figure = make_subplots(
        rows=-(-len(chosen) // 3), cols=3, subplot_titles=[name for name, _ in chosen], vertical_spacing=0.25
    )
    for k, (_, levels) in enumerate(chosen):
        for key, colour, name in (("share", OFF, "of what is above noise"), ("time", EVEN, "of the data")):
            figure.add_bar(
                x=[r["level"] for r in levels], y=[100 * r[key] for r in levels], marker_color=colour, name=name,
                legendgroup=name, showlegend=k == 0, row=k // 3 + 1, col=k % 3 + 1,
            )  # fmt: skip
    figure.update_yaxes(rangemode="tozero")
    figure.update_yaxes(title_text="share [%]", col=1)
    figure.update_layout(barmode="group", height=110 + 210 * -(-len(chosen) // 3))
    words = "Where the two bars of a level differ, the difference depends on that variable; what matters most is first."
    return Picture("By operating condition", words, as_html(figure))


def time_picture(c: Comparison, changes: Sequence[Mapping[str, Any]], noise: Mapping[str, float]) -> Picture:
    """Chi-square per sample over time, and where it changes."""
    channels = [name for name in c.recording.outputs if noise.get(name)]
    figure = make_subplots(rows=len(channels), shared_xaxes=True, vertical_spacing=0.06)
    windows = len(c.recording.time) // WINDOW
    time = c.recording.time[: windows * WINDOW].reshape(windows, WINDOW).mean(axis=1)
    for row, channel in enumerate(channels, 1):
        squares = (c.residual("calibrated", channel)[: windows * WINDOW] / noise[channel]) ** 2
        known = np.isfinite(squares).reshape(windows, WINDOW)
        chi2 = np.nan_to_num(squares).reshape(windows, WINDOW).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
        line = {"color": OFF, "width": 1, "shape": "hvh"}
        figure.add_scatter(
            x=time, y=np.where(known.any(axis=1), chi2, np.nan), line=line, showlegend=False, row=row, col=1
        )
        for change in changes:
            if (change["recording"], change["channel"]) == (c.recording.name, channel):
                dash = "dot" if change["driven"] else "solid"
                figure.add_vline(
                    x=change["time"], line={"color": COLOUR["recorded"], "width": 1, "dash": dash}, row=row, col=1
                )
        figure.update_yaxes(type="log", title_text=f"{channel}<br>chi-square [1]", row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(channels), col=1)
    figure.update_layout(height=100 + 110 * len(channels))
    words = (
        "Squared error of the calibrated system over the noise's variance, 1 is noise. "
        "Lines: it changes there; dotted: an input changes there as well."
    )
    return Picture(f"When: {c.recording.name}", words, as_html(figure))
