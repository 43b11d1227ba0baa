"""The report's pictures (plotly): errors before and after, an unlisted effect's shape, loads from outside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
import plotly.graph_objects as go
import plotly.offline
from plotly.subplots import make_subplots

from cobot_joint.results.diagnosed import VARIANTS
from cobot_joint.results.figures import COLOUR, COLOURS, Panel

HEIGHT = 330  # px


@dataclass(frozen=True)
class Picture:
    """A figure as HTML, without the script it needs (`script()`)."""

    title: str
    words: str
    html: str


def script() -> str:
    """plotly.js, once per report."""
    return plotly.offline.get_plotlyjs()


def of_findings(findings: Sequence[Mapping[str, Any]]) -> list[Picture]:
    """Tables of what no list names, and courses of external loads."""
    tables = [shape_picture(f) for f in findings if isinstance((f.get("shape") or {}).get("table"), Mapping)]
    return tables + [load_picture(f) for f in findings if f.get("load_history")]


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
                y=(above := [_over_noise(d["channels"][n], role, variant) for n in names]),
                text=[f"{x:.3g}" for x in above],
                textposition="outside",
                cliponaxis=False,
                name=variant,
                marker_color=COLOUR[variant],
                showlegend=column == 1,
                row=1,
                col=column,
            )
        line = {"dash": "dot", "color": COLOUR["recorded"]}
        figure.add_scatter(x=names, y=[1.0] * len(names), mode="lines", line=line, showlegend=False, row=1, col=column)
    figure.update_yaxes(type="log", range=_decades(d), dtick=1)
    figure.update_yaxes(title_text="rms error / noise [1]", row=1, col=1)
    figure.update_layout(barmode="group", height=HEIGHT)
    return Picture(
        "Error over noise",
        "Root mean square of recording − simulation, in units of the logger's noise; 1 (dotted) is as good as it gets.",
        as_html(figure),
    )


def _over_noise(channel: Mapping[str, Any], role: str, variant: str) -> float:
    """NaN where either is not known."""
    error = channel[role].get(variant)
    return error / channel["noise"] if error is not None and channel["noise"] else float("nan")


def _decades(d: Mapping[str, Any]) -> tuple[float, float]:
    """Range of the logarithmic axis: the noise, and the greatest error with its label."""
    roles = [(c, role) for c in d["channels"].values() for role in ("train", "holdout") if role in c]
    worst = np.nanmax([1.0, *(_over_noise(c, role, variant) for c, role in roles for variant in VARIANTS)])
    return float(np.log10(0.7)), float(np.log10(worst) * 1.08 + 0.1)


def of_panels(panels: Sequence[Panel], x_label: str, title: str, words: str) -> Picture:
    """Curves over a logarithmic axis; one that has a name of COLOUR has its colour."""
    figure = make_subplots(rows=len(panels), shared_xaxes=True, vertical_spacing=0.06)
    others = cycle(COLOURS)
    for row, panel in enumerate(panels, 1):
        for curve in panel.curves:
            mode = "markers" if curve.style == "markers" else "lines+markers"
            figure.add_scatter(
                x=curve.x, y=curve.y, name=curve.label, legendgroup=curve.label, mode=mode, row=row, col=1,
                marker={"color": COLOUR.get(curve.label) or next(others), "size": 5 if mode == "markers" else 3},
                showlegend=not any(curve.label == c.label for p in panels[: row - 1] for c in p.curves),
            )  # fmt: skip
        figure.update_yaxes(title_text=panel.y_label.replace(" [", "<br>["), row=row, col=1)
    figure.update_xaxes(type="log")
    figure.update_xaxes(title_text=x_label, row=len(panels), col=1)
    figure.update_layout(height=130 + 130 * len(panels))
    return Picture(title, words, as_html(figure))


def shape_picture(f: Mapping[str, Any]) -> Picture:
    """An unlisted effect's table: what has to be added at the port, over the signal on which it depends."""
    shape = f["shape"]
    signal = next(name for name in shape["table"] if name != "value")
    curve = go.Scatter(x=shape["table"][signal], y=shape["table"]["value"], mode="lines+markers", showlegend=False)
    figure = go.Figure(curve.update(line_color=COLOUR["repaired"]))
    figure.update_layout(height=300, xaxis_title=signal, yaxis_title=f"{shape['port']} [{shape['unit']}]")
    words = f"What has to be added at {shape['port']}, over {signal}."
    return Picture(f"The shape of {f['term']}", words, as_html(figure))


def load_picture(f: Mapping[str, Any]) -> Picture:
    """What acted for a while, over the time of each recording."""
    history = f["load_history"]
    figure = go.Figure(
        [go.Scatter(x=[0, *c["t"]], y=[0, *c["value"]], name=name) for name, c in history["recordings"].items()]
    )
    figure.update_layout(
        colorway=COLOURS, height=300, xaxis_title="time [s]", yaxis_title=f"{history['port']} [{history['unit']}]"
    )
    words = f"What acted at {history['port']} while these recordings were made. It is in no repaired system."
    return Picture(f"Loads of {f['term']}", words, as_html(figure))


def as_html(figure: go.Figure) -> str:
    """A place for it and its content as JSON; the report's script draws it when it comes into view."""
    figure.update_layout(
        template="simple_white",
        margin={"l": 64, "r": 12, "t": 48, "b": 45},
        legend={"orientation": "h", "yref": "container", "y": 1, "yanchor": "top", "x": 0, "xanchor": "left"},
        font={"family": "system-ui, sans-serif", "size": 12},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
    )
    content = figure.to_json().replace("</", "<\\/")
    height = figure.layout.height or HEIGHT
    return f'<div class="plot" style="height:{height}px"></div><script type="application/json">{content}</script>'
