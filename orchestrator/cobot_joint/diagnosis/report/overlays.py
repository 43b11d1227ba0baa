"""Recorded over simulated: every channel of a recording, what is left of it below, and the stretch that tells most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from cobot_joint.diagnosis.data.conditioning import ChannelQuality
from cobot_joint.diagnosis.repair.compare import Comparison, strongest_window
from cobot_joint.diagnosis.report.headline import SEEN
from cobot_joint.diagnosis.report.pictures import Picture, as_html
from cobot_joint.results.figures import COLOUR

BINS = 500  # per curve: least and greatest of each bin, so that no spike is lost
ZOOM = 2.0  # s
AVERAGED = 25  # samples, odd
LINE = {"recorded": (3.0, "solid"), "nominal": (1.2, "dot"), "calibrated": (1.4, "dash"), "repaired": (1.4, "solid")}
SIGNAL, LEFT = 140, 90  # px of a channel's two panels
LEVELS, MOST = 30, 5  # of a signal; signals
ROLES = {"holdout": "held out", "train": "training"}
Array = NDArray[np.float64]


def held_out_first(compared: Sequence[Comparison], noise: Mapping[str, float]) -> Comparison | None:
    """The recording that shows best what a repair does: a held-out one where there is one. None: none is there."""
    candidates = [c for c in compared if c.recording.role == "holdout"] or list(compared)
    return max(candidates, key=lambda c: max(gain(c, n, noise[n]) for n in c.recording.outputs), default=None)


def before_after(c: Comparison, noise: Mapping[str, float], units: Mapping[str, str], repaired: bool) -> Picture:
    """Where the repair gains most: the channel in which, and the seconds. repaired: there is something to show."""
    channel = max(c.recording.outputs, key=lambda n: gain(c, n, noise[n]))
    shown = ("recorded", "calibrated", "repaired") if repaired else ("recorded", "calibrated")
    window = None if c.recording.scatter else strongest_window(c, channel, ZOOM)
    figure = overlay(c, [channel], noise, units, window, shown)
    figure.update_layout(height=360)
    said = "Held-out run, which nothing was fitted to" if c.recording.role == "holdout" else "Training run"
    stretch = "" if window is None else f", {window[0]:.1f} to {window[1]:.1f} s"
    words = f"{said}: {c.recording.name}{stretch}, where the difference is largest."
    return Picture("Before and after" if repaired else "Recorded and simulated", words, as_html(figure))


def whole(c: Comparison, quality: Mapping[str, ChannelQuality], units: Mapping[str, str]) -> Picture:
    """All channels over all of a recording."""
    noise = {name: quality[name].noise for name in c.recording.outputs}
    averages = {
        name: 2 * float(np.sqrt((1 + q.colour) / (1 - q.colour) / AVERAGED))
        for name, q in quality.items()
        if name in noise
    }
    averages = {} if c.recording.scatter else averages
    figure = overlay(c, list(c.recording.outputs), noise, units, band=averages)
    figure.update_layout(height=90 + (SIGNAL + LEFT) * len(noise))
    words = f"Set-up {c.recording.setup}." + (
        "" if c.recording.scatter else f" What is left: averages of {AVERAGED} samples."
    )
    return Picture(f"{c.recording.name} ({ROLES[c.recording.role]})", words, as_html(figure))


def over_signals(compared: Sequence[Comparison], noise: Mapping[str, float], units: Mapping[str, str]) -> Picture:
    """What is left of the channel that a repair improves most, over everything that was recorded: friction shows over
    speed, a gain over torque, an offset over nothing.
    """
    total = {n: sum(gain(c, n, x) for c in compared if n in c.recording.outputs) for n, x in noise.items()}
    channel = max(total, key=lambda n: total[n])
    runs = [c for c in compared if channel in c.recording.outputs and not c.recording.scatter]
    names = dict.fromkeys(n for c in runs for n in (*c.recording.inputs, *c.recording.outputs))
    moving = [n for n in names if any(_moves(_recorded(c, n)) for c in runs)][:MOST]
    figure = make_subplots(cols=max(len(moving), 1), shared_yaxes=True, horizontal_spacing=0.02)
    for column, name in enumerate(moving, 1):
        x = np.concatenate([_recorded(c, name) for c in runs])
        for source in ("calibrated", "repaired"):
            middle, mean = binned(x, np.concatenate([c.residual(source, channel) for c in runs]))
            figure.add_scatter(
                x=middle, y=mean, name=source, legendgroup=source, showlegend=column == 1, mode="lines+markers",
                line={"color": COLOUR[source], "width": 1.2}, marker={"size": 4}, row=1, col=column,
            )  # fmt: skip
        unit = next((c.recording.units[name] for c in runs if name in c.recording.units), "1")
        figure.update_xaxes(title_text=f"{name} [{unit}]", row=1, col=column)
    figure.update_yaxes(title_text=f"left of {channel}<br>[{units.get(channel) or '1'}]", row=1, col=1)
    figure.update_layout(height=300)
    words = f"Mean of what is left of {channel} in all runs, by {LEVELS} levels of each recorded signal."
    return Picture("Over what it depends", words, as_html(figure))


def _moves(x: Array) -> bool:
    known = x[np.isfinite(x)]
    return bool(len(known)) and float(np.ptp(known)) > 0


def _recorded(c: Comparison, name: str) -> Array:
    """An input or output, NaN where that run has none: (n,)"""
    both = {**c.recording.inputs, **c.recording.outputs}
    return both.get(name, np.full(len(c.recording.time), np.nan))


def binned(x: Array, y: Array) -> tuple[Array, Array]:
    """Means of x and y over LEVELS levels of x with as many samples each; less where x repeats."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if not len(x):
        return x, y
    edges = np.unique(np.quantile(x, np.linspace(0, 1, LEVELS + 1)))
    level = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    count = np.bincount(level)
    there = count > 0
    return np.bincount(level, x)[there] / count[there], np.bincount(level, y)[there] / count[there]


def overlay(
    c: Comparison,
    channels: Sequence[str],
    noise: Mapping[str, float],
    units: Mapping[str, str],
    window: tuple[float, float] | None = None,
    shown: Sequence[str] = tuple(COLOUR),
    band: Mapping[str, float] | None = None,
) -> go.Figure:
    """Per channel recorded and simulated, and the residual over noise. band: half widths; given: residuals averaged."""
    table = bool(c.recording.scatter)
    inside = _inside(c, window)
    x = np.flatnonzero(inside).astype(float) if table else c.recording.time[inside]
    x = np.arange(1.0, len(x) + 1) if table else x
    figure = make_subplots(
        rows=2 * len(channels), shared_xaxes=True, vertical_spacing=0.12 / (2 * len(channels)),
        row_heights=[SIGNAL, LEFT] * len(channels),
    )  # fmt: skip
    for n, channel in enumerate(channels):
        row = 2 * n + 1
        unit = units.get(channel) or "1"
        known = noise[channel] > SEEN * float(np.nanmax(np.abs(c.recording.outputs[channel]), initial=0.0))
        scale = noise[channel] if known else 1.0
        for source in shown:
            y = c.recording.outputs[channel] if source == "recorded" else c.simulated[source][channel]
            _curve(figure, row, source, x, y[inside], points=table and source == "recorded", legend=n == 0)
            if source != "recorded":
                left = c.residual(source, channel) / scale
                left = moving_average(left) if band else left
                _curve(figure, row + 1, source, x, left[inside], points=table, legend=False)
        half = (band or {}).get(channel, 2.0)
        if known:
            figure.add_hrect(y0=-half, y1=half, fillcolor="#808080", opacity=0.25, line_width=0, row=row + 1, col=1)
        figure.update_yaxes(title_text=f"{channel}<br>[{unit}]", row=row, col=1)
        figure.update_yaxes(title_text="left [σ]" if known else f"left [{unit}]", row=row + 1, col=1)
    figure.update_xaxes(title_text="row of the table" if table else "time [s]", row=2 * len(channels), col=1)
    return figure


def _curve(figure: go.Figure, row: int, source: str, x: Array, y: Array, *, points: bool, legend: bool) -> None:
    width, dash = LINE[source] if row % 2 else (1.0, "solid")
    t, v = (x, y) if points else envelope(x, y)
    figure.add_scatter(
        x=t, y=v, name=source, legendgroup=source, showlegend=legend, mode="markers" if points else "lines",
        line={"color": COLOUR[source], "width": width, "dash": dash}, marker={"color": COLOUR[source], "size": 5},
        visible="legendonly" if source == "nominal" else True, row=row, col=1,
    )  # fmt: skip


def _inside(c: Comparison, window: tuple[float, float] | None) -> NDArray[np.bool_]:
    """Samples to draw: of a table its rows, of a run those of the window."""
    if c.recording.scatter:
        return np.any([np.isfinite(y) for y in c.recording.outputs.values()], axis=0)
    start, stop = window or (-np.inf, np.inf)
    return (c.recording.time >= start) & (c.recording.time <= stop)


def gain(c: Comparison, channel: str, noise: float) -> float:
    """Squared error, over noise, that the repair removes; without one, that there is."""
    if not noise or not np.isfinite(c.recording.outputs[channel]).any():
        return 0.0
    before = np.nanmean(c.residual("calibrated", channel) ** 2)
    after = np.nanmean(c.residual("repaired", channel) ** 2) if "repaired" in c.simulated.keys() - c.failed else 0.0
    return float((before - after) / noise**2)


def moving_average(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Over AVERAGED samples, centred; NaN where one of them was not recorded."""
    if len(x) < AVERAGED:
        return x
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(x))])
    lost = np.concatenate([[0], np.cumsum(~np.isfinite(x))])
    mean = (total[AVERAGED:] - total[:-AVERAGED]) / AVERAGED
    mean[lost[AVERAGED:] > lost[:-AVERAGED]] = np.nan
    half = AVERAGED // 2
    return np.concatenate([np.full(half, np.nan), mean, np.full(len(x) - len(mean) - half, np.nan)])


def envelope(
    t: NDArray[np.float64], x: NDArray[np.float64], bins: int = BINS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """At most 2*bins points through the least and the greatest of each bin."""
    if len(x) <= 2 * bins:
        return t, x
    size = -(-len(x) // bins)
    blocks = np.full((-(-len(x) // size), size), np.nan)
    blocks.ravel()[: len(x)] = x
    known = np.isfinite(blocks)
    ends = np.where(known, blocks, np.inf).argmin(axis=1), np.where(known, blocks, -np.inf).argmax(axis=1)
    index = np.unique(np.arange(len(blocks)) * size + np.array(ends))  # a block of gaps gives its first: still a gap
    return t[index], x[index]
