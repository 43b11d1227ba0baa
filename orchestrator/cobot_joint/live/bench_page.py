"""The page of the bench itself: voltage, brake and hand by slider while it runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.report.overlays import envelope
from cobot_joint.live import page
from cobot_joint.live.bench import LONGEST, LiveBench
from cobot_joint.results.figures import COLOURS
from cobot_joint.results.result import Result

EVERY = 250  # ms between pictures
SHOWN = ("i_motor", "w_motor", "tau_sensor", "w_brake")  # outputs of the bench; of another system the first four
REACH = {"V": 24.0, "A": 1.0, "N.m": 5.0}  # of a slider, by its input's unit; from 0, of a voltage from minus that
LAST = 20.0  # s that are shown
BINS = 400


class BenchPage:
    """Layout and callbacks. `app` is the Dash application. UserError: Dash is not installed."""

    def __init__(self, bench: LiveBench) -> None:
        self.bench, self.begun = bench, time.monotonic()
        self.inputs = list(bench.system.inputs.values())
        outputs = list(bench.system.outputs)
        self.shown = [name for name in SHOWN if name in outputs] or outputs[:4]
        self._height = 60 + 150 * len(self.shown)
        self.app = page.application(f"{bench.system.name}, live")
        self.app.layout = self.layout
        d = page.dash()
        self.app.callback(
            d.Output("figure", "figure"), d.Output("said", "children"), d.Input("clock", "n_intervals"),
            d.State({"slider": "input", "n": d.ALL}, "value"),
        )(self.tick)  # fmt: skip
        self.app.callback(
            d.Output({"slider": "input", "n": d.ALL}, "value"), d.Input("again", "n_clicks"), prevent_initial_call=True
        )(self.again)

    def layout(self) -> Any:
        """The page; opening it begins a run."""
        self.again(None)
        d = page.dash()
        controls: list[Any] = [d.html.Button("Begin again", id="again")]
        for n, connector in enumerate(self.inputs):
            unit = connector.unit or "1"
            reach = REACH.get(unit, 1.0)
            low = -reach if unit == "V" else 0.0
            label = f"{connector.name}: {connector.description}" if connector.description else connector.name
            controls.append(page.slider("input", n, label, unit, low, reach, 0.0))
        shown = [
            d.html.Div(id="said", className="said", role="status"),
            d.dcc.Graph(
                id="figure", config={"displayModeBar": False, "responsive": True}, style={"height": f"{self._height}px"}
            ),
            d.dcc.Interval(id="clock", interval=EVERY),
        ]
        return page.two_columns(f"{self.bench.system.name}, running", controls, shown)

    def tick(self, _intervals: int | None, values: Sequence[float]) -> tuple[Any, Any]:
        """The run up to now."""
        no_update = page.dash().no_update
        given = dict(zip([c.name for c in self.inputs], values, strict=True))
        try:
            result = self.bench.advance(time.monotonic() - self.begun, given)
        except SimulationError as error:
            return no_update, f"The run ends here: {error}. Begin again."
        if result is None:
            return no_update, f"{LONGEST:.0f} s are over. Begin again." if self.bench.now >= LONGEST else no_update
        last = ", ".join(f"{n} {result[n][-1]:.3g} {result.units.get(n) or ''}" for n in self.shown)
        return self.figure(result), f"{self.bench.now:.1f} s: {last}"

    def again(self, _clicks: int | None) -> list[float]:
        """From standstill, everything off."""
        self.bench.restart()
        self.begun = time.monotonic()
        return [0.0] * len(self.inputs)

    def figure(self, result: Result) -> go.Figure:
        """The last seconds, a panel per output."""
        figure = make_subplots(rows=len(self.shown), shared_xaxes=True, vertical_spacing=0.03)
        recent = result.time >= result.time[-1] - LAST
        for row, name in enumerate(self.shown, 1):
            t, y = envelope(result.time[recent], np.asarray(result[name])[recent], BINS)
            figure.add_scatter(x=t, y=y, mode="lines", line={"color": COLOURS[0], "width": 1.5}, row=row, col=1)
            figure.update_yaxes(title_text=f"{name}<br>[{result.units.get(name) or '1'}]", row=row, col=1)
        start = max(float(result.time[-1]) - LAST, 0.0)
        figure.update_xaxes(range=[start, start + LAST])
        figure.update_xaxes(title_text="time [s]", row=len(self.shown))
        figure.update_layout(
            template="simple_white", height=self._height, showlegend=False, uirevision="live",
            margin={"l": 70, "r": 10, "t": 10, "b": 40},
        )  # fmt: skip
        return figure
