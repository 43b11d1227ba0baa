"""The page of results: recorded, calibrated and repaired overlaid, what is left below, a slider per value."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.report.headline import number, verdict_sentence
from cobot_joint.diagnosis.report.overlays import AVERAGED, LINE, envelope, moving_average
from cobot_joint.diagnosis.run import term_texts
from cobot_joint.live import page
from cobot_joint.live.save import save_campaign, save_system
from cobot_joint.live.what_if import Array, WhatIf
from cobot_joint.results.figures import COLOUR, samples

BINS = 250  # per curve: as many as a third of a screen shows
SIGNAL, LEFT = 130, 80  # px of a channel's two panels
HEADINGS = {"share": "Effects without a name", "term": "Terms", "rival": "Rivals, off", "parameter": "Parameters"}
Outputs = Mapping[str, Mapping[str, Array]]  # recording -> channel -> (n,)


class ResultsPage:
    """Layout and callbacks. `app` is the Dash application. UserError: Dash is not installed."""

    def __init__(self, results: WhatIf) -> None:
        self.results = results
        self.sliders = [s for kind in HEADINGS for s in results.sliders if s.kind == kind]
        self._turn, self._count, self._latest = threading.Lock(), threading.Lock(), 0
        self.app = page.application(results.campaign.title)
        self.app.layout = self.layout
        self._calls()

    def _calls(self) -> None:
        d = page.dash()
        moved, names = {"slider": "value", "n": d.ALL}, "recordings"
        shown = [d.Output(part, at, allow_duplicate=True) for part, at in (("figure", "figure"), ("rms", "children"))]
        shown.append(d.Output("said", "children", allow_duplicate=True))
        call, late = self.app.callback, "initial_duplicate"
        call(shown, d.Input(names, "value"), d.State(moved, "value"), prevent_initial_call=late)(self.draw)
        call(shown, d.Input(moved, "value"), d.State(names, "value"), prevent_initial_call=True)(self.move)
        call(d.Output(moved, "value"), d.Input("back", "n_clicks"), prevent_initial_call=True)(self.back)
        for button, save in (("save-system", self.save_system), ("save-campaign", self.save_campaign)):
            said = d.Output("saved", "children", allow_duplicate=True)
            call(said, d.Input(button, "n_clicks"), d.State(moved, "value"), prevent_initial_call=True)(save)

    def layout(self) -> Any:
        """The page as it is opened: nothing moved."""
        d, results = page.dash(), self.results
        controls: list[Any] = []
        for kind, heading in HEADINGS.items():
            here = [(n, s) for n, s in enumerate(self.sliders) if s.kind == kind]
            controls += [d.html.H2(heading)] if here else []
            controls += [page.slider("value", n, s.label, s.unit, s.low, s.high, s.found) for n, s in here]
        buttons = {
            "back": "Back to what was found",
            "save-system": "Save system (SSP)",
            "save-campaign": "Save campaign",
        }
        names = [r.name for r in results.campaign.recordings]
        height = {"height": f"{self._height(results.campaign.outputs)}px"}
        shown = [
            d.dcc.Dropdown(names, results.first_shown, multi=True, id="recordings", clearable=False),
            d.html.Div(id="rms"),
            d.html.Div(id="said", className="said", role="status"),
            d.dcc.Graph(id="figure", config={"displayModeBar": False, "responsive": True}, style=height),
        ]
        top = [d.html.Button(words, id=name) for name, words in buttons.items()]
        top.append(d.html.Div(id="saved", className="said", role="status"))
        title = verdict_sentence(results.diagnosis, term_texts(results.nominal))
        return page.two_columns(f"{results.campaign.title}: {title}", [*top, *controls], shown)

    def draw(self, names: Sequence[str], values: Sequence[float]) -> tuple[Any, Any, str]:
        """Figure, table of rms, and what went wrong."""
        no_update = page.dash().no_update
        try:
            simulated = self.results.simulate(self.moved(values), names)
        except SimulationError as error:
            return no_update, no_update, f"These values cannot be simulated: {error}"
        calibrated = {name: self.results.calibrated(name) for name in names}
        return self.figure(calibrated, simulated), self.table(calibrated, simulated), ""

    def move(self, values: Sequence[float], names: Sequence[str]) -> tuple[Any, Any, str]:
        """The same with only what sliders change; of several moves that wait, only the latest is simulated."""
        d = page.dash()
        with self._count:
            self._latest += 1
            mine = self._latest
        with self._turn:
            if mine != self._latest:
                return d.no_update, d.no_update, d.no_update
            try:
                simulated = self.results.simulate(self.moved(values), names)
            except SimulationError as error:
                return d.no_update, d.no_update, f"These values cannot be simulated: {error}"
        figure = d.Patch()
        for n, (_, source, time, y) in enumerate(self._curves({}, simulated)):
            if source == "repaired":
                t, v = envelope(time, y, BINS)
                figure["data"][n]["x"], figure["data"][n]["y"] = samples(t), samples(v)
        calibrated = {name: self.results.calibrated(name) for name in names}
        return figure, self.table(calibrated, simulated), ""

    def moved(self, values: Sequence[float]) -> dict[str, float]:
        """Slider -> value, of those that are not where they were found."""
        pairs = zip(self.sliders, values, strict=True)
        return {s.name: float(x) for s, x in pairs if x != page.shown(s.found)}

    def back(self, _clicks: int | None) -> list[float]:
        """Every slider where it was found."""
        return [page.shown(s.found) for s in self.sliders]

    def save_system(self, _clicks: int | None, values: Sequence[float]) -> str:
        """What was written."""
        files = save_system(self.results, self.moved(values))
        return f"Saved {', '.join(map(str, files))}"

    def save_campaign(self, _clicks: int | None, values: Sequence[float]) -> str:
        """What was written, and what it cannot hold."""
        path, without = save_campaign(self.results, self.moved(values))
        return f"Saved {path}" + (f", without {', '.join(without)}" if without else "")

    def figure(self, calibrated: Outputs, simulated: Outputs) -> go.Figure:
        """A column per recording, two panels per channel: signals, and what is left in units of noise."""
        results, names = self.results, list(simulated)
        channels = self._channels(names)
        figure = make_subplots(
            rows=2 * len(channels), cols=len(names), shared_xaxes="columns", column_titles=names,
            row_heights=[SIGNAL, LEFT] * len(channels), vertical_spacing=0.015, horizontal_spacing=0.05,
        )  # fmt: skip
        for at, source, time, y in self._curves(calibrated, simulated):
            t, v = envelope(time, y, BINS)
            width, dash = LINE[source] if at[0] % 2 else (1.0, "solid")
            figure.add_scatter(
                x=t, y=v, name=source, legendgroup=source, showlegend=at == (1, 1), mode="lines",
                line={"color": COLOUR[source], "width": width, "dash": dash}, row=at[0], col=at[1],
            )  # fmt: skip
        for n, channel in enumerate(channels):
            unit = next(r.units[channel] for r in results.campaign.recordings if channel in r.units)
            figure.update_yaxes(title_text=f"{channel}<br>[{unit}]", row=2 * n + 1, col=1)
            left = "σ" if channel in results.noise else unit
            figure.update_yaxes(title_text=f"left [{left}]", row=2 * n + 2, col=1)
        figure.update_xaxes(title_text="time [s]", row=2 * len(channels))
        figure.update_layout(
            template="simple_white", height=self._height(channels), uirevision=",".join(names),
            margin={"l": 60, "r": 10, "t": 50, "b": 40},
            legend={"orientation": "h", "yref": "container", "y": 1, "yanchor": "top"},
        )  # fmt: skip
        return figure

    def _curves(self, calibrated: Outputs, simulated: Outputs) -> Iterator[tuple[tuple[int, int], str, Array, Array]]:
        """(row, column), source, time, values of every curve, always in this order; of what is not given no values."""
        results = self.results
        channels = self._channels(list(simulated))
        for column, name in enumerate(simulated, 1):
            recording = results.recording(name)
            nothing = dict.fromkeys(recording.outputs, np.empty(0))
            for channel, recorded in recording.outputs.items():
                row = 2 * channels.index(channel) + 1
                yield (row, column), "recorded", recording.time, recorded
                noise = results.noise.get(channel, 1.0)
                for source, outputs in (("calibrated", calibrated.get(name, nothing)), ("repaired", simulated[name])):
                    y = outputs[channel]
                    yield (row, column), source, recording.time, y
                    left = moving_average((recorded - y) / noise) if len(y) else y
                    yield (row + 1, column), source, recording.time, left

    @staticmethod
    def _height(channels: Sequence[str]) -> int:
        return 90 + (SIGNAL + LEFT) * len(channels)

    def _channels(self, names: Sequence[str]) -> list[str]:
        return list(dict.fromkeys(c for n in names for c in self.results.recording(n).outputs))

    def table(self, calibrated: Outputs, simulated: Outputs) -> Any:
        """rms of recording - simulation over what is shown, per channel."""
        html, results = page.dash().html, self.results
        before, now = results.rms(calibrated), results.rms(simulated)
        head = html.Tr([html.Th(x) for x in ("rms of what is left", "noise", "calibrated", "now", "now / noise")])
        rows = []
        for channel, error in now.items():
            noise = results.noise.get(channel)
            cells = [
                channel,
                number(noise),
                number(before[channel]),
                number(error),
                number(error / noise if noise else None),
            ]
            rows.append(html.Tr([html.Td(x) for x in cells]))
        said = f"Below each channel what is left, over the noise, averaged over {AVERAGED} samples."
        return html.Div([html.Table([head, *rows]), html.Div(said, className="unit")])
