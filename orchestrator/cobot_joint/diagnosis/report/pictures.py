"""The report's pictures (plotly): the fit before and after, where the difference lies in time, and a closer look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
import plotly.offline
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from cobot_joint.diagnosis.data.conditioning import ChannelQuality
from cobot_joint.diagnosis.repair.compare import Comparison, strongest_window

VARIANTS = ("nominal", "calibrated", "repaired")
COLOUR = {"recorded": "#555555", "nominal": "#b0b0b0", "calibrated": "#d1651a", "repaired": "#1f6fb2"}
BINS = 500  # per curve: least and greatest of each bin, so that no spike is lost
ZOOM = 2.0  # s
AVERAGED = 25  # samples, odd


@dataclass(frozen=True)
class Picture:
    """A figure as HTML, without the script it needs (`script()`)."""

    title: str
    words: str
    html: str


def script() -> str:
    """plotly.js, once per report."""
    return plotly.offline.get_plotlyjs()


def all_pictures(
    compared: Sequence[Comparison],
    d: Mapping[str, Any],
    quality: Mapping[str, ChannelQuality],
    units: Mapping[str, str],
) -> list[Picture]:
    """In reading order."""
    noise = {name: c["noise"] for name, c in d["channels"].items()}
    pictures = [before_and_after(d)]
    if not compared:
        return pictures
    first = _evidence(compared, d, noise)
    pictures.append(closer_look(first, noise, units))
    pictures += [residuals(c, quality, units) for c in [first, *(c for c in compared if c is not first)]]
    pictures += [shape_picture(f) for f in d["findings"] if _has_table(f)]
    return pictures + [load_picture(f) for f in d["findings"] if f.get("load_history")]


def before_and_after(d: Mapping[str, Any]) -> Picture:
    """Error over noise per channel and variant, on training and held-out runs."""
    roles = [role for role in ("train", "holdout") if any(role in c for c in d["channels"].values())]
    figure = make_subplots(
        cols=len(roles),
        shared_yaxes=True,
        subplot_titles=[{"train": "training runs", "holdout": "held-out runs"}[r] for r in roles],
    )
    for column, role in enumerate(roles, 1):
        for variant in VARIANTS:
            names = [name for name, c in d["channels"].items() if role in c]
            figure.add_bar(
                x=names,
                y=(above := [d["channels"][n][role][variant] / (d["channels"][n]["noise"] or np.nan) for n in names]),
                text=[f"{x:.3g}" for x in above],
                textposition="outside",
                cliponaxis=False,
                name=variant,
                marker_color=COLOUR[variant],
                showlegend=column == 1,
                row=1,
                col=column,
            )
        line = {"dash": "dot", "color": "#333333"}
        figure.add_scatter(x=names, y=[1.0] * len(names), mode="lines", line=line, showlegend=False, row=1, col=column)
    figure.update_yaxes(type="log", range=_decades(d), dtick=1)
    figure.update_yaxes(title_text="error / noise (rms)", row=1, col=1)
    figure.update_layout(barmode="group", height=330)
    return Picture(
        "Before and after",
        "Root mean square of recording − simulation, in units of the logger's noise; 1 (dotted) is as good as it gets.",
        as_html(figure),
    )


def _decades(d: Mapping[str, Any]) -> tuple[float, float]:
    """Range of the logarithmic axis: the noise, and the greatest error with its label."""
    channels = [c for c in d["channels"].values() if c["noise"]]
    roles = [(c["noise"], c[role]) for c in channels for role in ("train", "holdout") if role in c]
    worst = max((figures[variant] / noise for noise, figures in roles for variant in VARIANTS), default=1.0)
    return float(np.log10(0.7)), float(np.log10(max(worst, 1.0)) * 1.08 + 0.1)


def residuals(c: Comparison, quality: Mapping[str, ChannelQuality], units: Mapping[str, str]) -> Picture:
    """recording - simulation over time, calibrated and repaired, averaged so that structure rises above noise."""
    channels = list(c.recording.outputs)
    figure = make_subplots(rows=len(channels), shared_xaxes=True, vertical_spacing=0.05)
    for row, channel in enumerate(channels, 1):
        for variant in ("calibrated", "repaired"):
            t, x = envelope(c.recording.time, moving_average(c.residual(variant, channel)))
            figure.add_scatter(
                x=t, y=x, name=variant, legendgroup=variant, showlegend=row == 1,
                line={"color": COLOUR[variant], "width": 1}, row=row, col=1,
            )  # fmt: skip
        q = quality[channel]
        _band(figure, 2 * q.noise * float(np.sqrt((1 + q.colour) / (1 - q.colour) / AVERAGED)), row)
        figure.update_yaxes(title_text=f"{channel}<br>{units.get(channel, '')}", row=row, col=1)
    figure.update_xaxes(title_text="time / s", row=len(channels), col=1)
    figure.update_layout(height=110 + 130 * len(channels))
    role = "held out" if c.recording.role == "holdout" else "training"
    words = f"Recording − simulation, averaged over {AVERAGED} samples; the grey band is ±2 sigma of such an average."
    return Picture(f"What remains: {c.recording.name} ({role})", words, as_html(figure))


def closer_look(c: Comparison, noise: Mapping[str, float], units: Mapping[str, str]) -> Picture:
    """What the calibrated system misses, and what the repair adds, where that matters most."""
    channels = list(c.recording.outputs)
    best = max(channels, key=lambda n: _gain(c, n, noise[n]))
    start, stop = strongest_window(c, best, ZOOM)
    inside = (c.recording.time >= start) & (c.recording.time <= stop)
    t = c.recording.time[inside]
    figure = make_subplots(rows=len(channels), shared_xaxes=True, vertical_spacing=0.05)
    for row, channel in enumerate(channels, 1):
        missed = c.residual("calibrated", channel)[inside]
        added = c.simulated["repaired"][channel][inside] - c.simulated["calibrated"][channel][inside]
        figure.add_scatter(
            x=t, y=missed, name="recorded − calibrated", legendgroup="missed", showlegend=row == 1, mode="markers",
            marker={"color": COLOUR["calibrated"], "size": 3, "opacity": 0.5}, row=row, col=1,
        )  # fmt: skip
        figure.add_scatter(
            x=t, y=added, name="repaired − calibrated", legendgroup="added", showlegend=row == 1,
            line={"color": COLOUR["repaired"], "width": 2}, row=row, col=1,
        )  # fmt: skip
        _band(figure, 2 * noise[channel], row)
        figure.update_yaxes(title_text=f"{channel}<br>{units.get(channel, '')}", row=row, col=1)
    figure.update_xaxes(title_text="time / s", row=len(channels), col=1)
    figure.update_layout(height=110 + 150 * len(channels))
    words = (
        f"{c.recording.name}, {start:.2f} to {stop:.2f} s, where the repair gains most, in {best}: dots are what the "
        "calibrated system misses, the line is what the repair adds, the grey band is ±2 sigma of the noise."
    )
    return Picture("A closer look", words, as_html(figure))


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


def _band(figure: go.Figure, half: float, row: int) -> None:
    figure.add_hrect(y0=-half, y1=half, fillcolor="#000000", opacity=0.12, line_width=0, row=row, col=1)


def shape_picture(f: Mapping[str, Any]) -> Picture:
    """An unlisted effect's table: what has to be added at the port, over the signal on which it depends."""
    shape = f["shape"]
    signal = next(name for name in shape["table"] if name != "value")
    curve = go.Scatter(x=shape["table"][signal], y=shape["table"]["value"], mode="lines+markers", showlegend=False)
    figure = go.Figure(curve.update(line_color=COLOUR["repaired"]))
    figure.update_layout(height=300, xaxis_title=signal, yaxis_title=f"{shape['port']} / {shape['unit']}")
    words = f"What has to be added at {shape['port']}, over {signal}."
    return Picture(f"The shape of {f['term']}", words, as_html(figure))


def load_picture(f: Mapping[str, Any]) -> Picture:
    """What acted for a while, over the time of each recording."""
    history = f["load_history"]
    figure = go.Figure(
        [go.Scatter(x=[0, *c["t"]], y=[0, *c["value"]], name=name) for name, c in history["recordings"].items()]
    )
    figure.update_layout(height=300, xaxis_title="time / s", yaxis_title=f"{history['port']} / {history['unit']}")
    words = f"What acted at {history['port']} while these recordings were made. It is in no repaired system."
    return Picture(f"Loads of {f['term']}", words, as_html(figure))


def envelope(
    t: NDArray[np.float64], x: NDArray[np.float64], bins: int = BINS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """At most 2*bins points through the least and the greatest of each bin."""
    if len(x) <= 2 * bins:
        return t, x
    size = -(-len(x) // bins)
    index = []
    for start in range(0, len(x), size):
        part = x[start : start + size]
        if np.isfinite(part).any():
            index += sorted({start + int(np.nanargmin(part)), start + int(np.nanargmax(part))})
        else:
            index.append(start)  # a gap stays a gap
    return t[index], x[index]


def _evidence(compared: Sequence[Comparison], d: Mapping[str, Any], noise: Mapping[str, float]) -> Comparison:
    """The recording in which the strongest finding says it shows; else the one that the repair improves most."""
    named = [f["where"]["recording"] for f in d["findings"] if (f.get("where") or {}).get("recording")]
    for c in compared:
        if named and c.recording.name == named[0]:
            return c
    return max(compared, key=lambda c: max(_gain(c, n, noise[n]) for n in c.recording.outputs))


def _gain(c: Comparison, channel: str, noise: float) -> float:
    """Squared error, over noise, that the repair removes; without one, that there is."""
    before = np.nanmean(c.residual("calibrated", channel) ** 2)
    after = np.nanmean(c.residual("repaired", channel) ** 2) if "repaired" in c.simulated else 0.0
    return float((before - after) / noise**2) if noise else 0.0


def _has_table(f: Mapping[str, Any]) -> bool:
    return isinstance(f.get("shape"), Mapping) and isinstance(f["shape"].get("table"), Mapping)


def as_html(figure: go.Figure) -> str:
    """With the report's look, without the script."""
    figure.update_layout(
        template="simple_white",
        margin={"l": 70, "r": 15, "t": 48, "b": 45},
        legend={"orientation": "h", "yref": "container", "y": 1, "yanchor": "top", "x": 0, "xanchor": "left"},
        font={"family": "system-ui, sans-serif", "size": 12},
    )
    return str(
        figure.to_html(include_plotlyjs=False, full_html=False, config={"displaylogo": False, "responsive": True})
    )
