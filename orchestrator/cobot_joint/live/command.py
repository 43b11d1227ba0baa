"""`cobot-joint open`."""

from __future__ import annotations

import webbrowser
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from cobot_joint.screen import Screen

console = Screen()


def open_(
    results: Annotated[
        Path | None, typer.Argument(metavar="[RESULTS]", help="What diagnose wrote; without it, the bench itself.")
    ] = None,
    campaign: Annotated[
        Path | None, typer.Option(help="The campaign, where it is no longer where diagnose found it.")
    ] = None,
    system: Annotated[str, typer.Option(help="Without results: a system by name, or an .ssd or .ssp file.")] = "joint",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
) -> None:
    """A page in the browser that simulates while its sliders move; Ctrl-C ends it.

    Of results: recorded, calibrated and repaired overlaid, a slider per term and parameter. Without results: the bench
    itself, voltage, brake and hand by slider. It needs the extra [live].
    """
    from cobot_joint.live.page import dash

    dash()  # before anything takes time
    from cobot_joint.live.server import Server

    with ExitStack() as stack:
        if results is None:
            from cobot_joint.live.bench import LiveBench
            from cobot_joint.live.bench_page import BenchPage
            from cobot_joint.system import load_system

            app = BenchPage(stack.enter_context(LiveBench(load_system(system)))).app
        else:
            from cobot_joint.diagnosis.data.campaign import load_campaign
            from cobot_joint.live.results_page import ResultsPage
            from cobot_joint.live.what_if import WhatIf, campaign_of

            loaded = load_campaign(campaign_of(results, campaign))
            app = ResultsPage(stack.enter_context(WhatIf(results, loaded))).app
        server = Server(app, port)
        console.print(server.address, soft_wrap=True)
        if browser:
            webbrowser.open(server.address)
        server.serve()
