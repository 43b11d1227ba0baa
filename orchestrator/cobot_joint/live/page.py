"""What both pages share: their look, and sliders."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from cobot_joint.results.result import library

STEPS = 200  # of a slider at least
INDEX = """<!DOCTYPE html>
<html lang="en"><head>{%metas%}<title>{%title%}</title>{%css%}<style>
body { font: 14px/1.4 system-ui, sans-serif; margin: 0; color: #1c1c1c; }
header { padding: .5rem 1rem; border-bottom: 1px solid #d9d9d9; }
h1 { font-size: 1rem; margin: 0; }
h2 { font-size: .95rem; margin: .8rem 0 .2rem; }
.page { display: grid; grid-template-columns: 22rem minmax(0, 1fr); }
.controls { padding: .4rem 1rem; max-height: calc(100vh - 3rem); overflow-y: auto; box-sizing: border-box; }
.slider { margin: .35rem 0; }
.slider label { display: block; font-size: .85rem; overflow-wrap: anywhere; }
.unit { color: #5c5c5c; }
button { font: inherit; padding: .35rem .7rem; margin: .3rem .3rem .3rem 0; cursor: pointer; }
.said { overflow-wrap: anywhere; min-height: 1.4em; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .15rem .6rem; border-bottom: 1px solid #d9d9d9; }
th:first-child, td:first-child { text-align: left; }
.shown { padding: .4rem; overflow-x: auto; }
.dash-graph { min-width: 40rem; }
.slider input { min-width: 5.5rem; }
@media (max-width: 700px) {
  .page { grid-template-columns: minmax(0, 1fr); }
  .controls { max-height: none; }
  .shown { order: -1; }
}
</style></head><body>{%app_entry%}<script>
// what the library leaves undone: a slider's knob and number are named by its label; what nobody sees takes no focus
const NAMELESS = ".slider :is(input, [role=slider]):not([aria-label])";
const UNSEEN = "input[aria-hidden=true][tabindex='0']";
const name = (part) => part.setAttribute("aria-label", part.closest(".slider").querySelector("label").textContent);
new MutationObserver(() => {
  document.querySelectorAll(NAMELESS).forEach(name);
  document.querySelectorAll(UNSEEN).forEach((part) => { part.tabIndex = -1; });
}).observe(document.body, { childList: true, subtree: true });
</script><footer>{%config%}{%scripts%}{%renderer%}</footer></body></html>"""


def dash() -> Any:
    """The library Dash. UserError: it is not installed, and how it is."""
    return library("dash", "open", "live")


def application(title: str) -> Any:
    """A Dash application that loads everything from its own server."""
    phone = [{"name": "viewport", "content": "width=device-width, initial-scale=1"}]
    app = dash().Dash(
        "cobot_joint", title=title, update_title=None, serve_locally=True, assets_folder="", meta_tags=phone
    )
    app.index_string = INDEX
    return app


def slider(kind: str, number: int, label: str, unit: str, low: float, high: float, at: float) -> Any:
    """A slider with its label; its id is {"slider": kind, "n": number}."""
    d = dash()
    step = 10.0 ** math.floor(math.log10((high - low) / STEPS))
    head = [label, " ", d.html.Span("" if unit in ("", "1") else f"[{unit}]", className="unit")]
    control = d.dcc.Slider(
        shown(low), shown(high), step, value=shown(at), id={"slider": kind, "n": number}, marks=None, updatemode="drag"
    )
    return d.html.Div([d.html.Label(head), control], className="slider")


def shown(x: float) -> float:
    """With four digits, as a slider has it: what a person can read and type."""
    return float(f"{x:.4g}")


def two_columns(title: str, controls: Sequence[Any], shown: Sequence[Any]) -> Any:
    """The page: what can be moved at the left, what comes of it at the right; on a phone that is first."""
    html = dash().html
    columns = [html.Div(list(controls), className="controls"), html.Div(list(shown), className="shown", tabIndex="0")]
    return html.Div([html.Header(html.H1(title)), html.Main(columns, className="page")])
