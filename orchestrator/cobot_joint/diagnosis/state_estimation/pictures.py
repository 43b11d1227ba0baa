"""The discrepancy as an engineer would plot it: over time, over what it depends on, and its orders."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from cobot_joint.diagnosis.state_estimation.discrepancy import Curve, PortDiscrepancy
from cobot_joint.results.figures import COLOURS

LINE, BAND = COLOURS[0], "rgba(0, 114, 178, 0.2)"
POINTS = 2000  # of a curve over time


def picture(found: Sequence[PortDiscrepancy]) -> go.Figure:
    """A row per port: over time with its 95 % band, over the most telling variable, and the order spectrum."""
    titles = []
    for d in found:
        low, high = d.ci95
        titles += [f"{d.port}: rms {d.rms:.3g} ({low:.3g} to {high:.3g}) {d.unit}", _best(d).signal,
                   d.spectra[0].signal if d.spectra else ""]  # fmt: skip
    figure = make_subplots(rows=len(found), cols=3, column_widths=[0.5, 0.25, 0.25], subplot_titles=titles)
    for row, d in enumerate(found, 1):
        thin = slice(None, None, max(1, len(d.time) // POINTS))
        _banded(figure, row, 1, d.time[thin], d.d[thin], 1.96 * d.sigma[thin])
        curve = _best(d)
        _banded(figure, row, 2, curve.middle, curve.mean, 1.96 * curve.sigma)
        figure.update_yaxes(title_text=d.unit, row=row, col=1)
        if d.spectra:
            spectrum = d.spectra[0]
            figure.add_scatter(x=spectrum.orders, y=spectrum.amplitude, line={"color": LINE}, row=row, col=3)
            peaks = spectrum.peaks
            figure.add_scatter(
                x=[p.order for p in peaks], y=[p.amplitude for p in peaks], mode="markers", row=row, col=3,
                error_y={"array": [1.96 * p.sigma for p in peaks]}, marker={"color": LINE},
            )  # fmt: skip
    figure.update_layout(height=300 * len(found), showlegend=False, template="plotly_white")
    figure.update_xaxes(title_text="s", row=len(found), col=1)
    figure.update_xaxes(title_text="periods per turn", row=len(found), col=3)
    return figure


def _best(d: PortDiscrepancy) -> Curve:
    """The variable that tells most, time aside where there is another."""
    return next((c for c in d.curves if c.variable != "time"), d.curves[0])


def _banded(figure: go.Figure, row: int, column: int, x: object, y: object, half: object) -> None:
    low, high = y - half, y + half  # type: ignore[operator]
    figure.add_scatter(x=x, y=high, line={"width": 0}, hoverinfo="skip", row=row, col=column)
    figure.add_scatter(
        x=x, y=low, line={"width": 0}, fill="tonexty", fillcolor=BAND, hoverinfo="skip", row=row, col=column
    )
    figure.add_scatter(x=x, y=y, line={"color": LINE}, row=row, col=column)
