"""Report and live page in Chromium: axe finds nothing, the keyboard reaches everything, a phone shows all of it."""

from __future__ import annotations

import io
import os
import threading
from collections.abc import Iterator
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

pytest.importorskip("dash", reason="the extra [live] is not installed")

from cobot_joint.diagnosis.report.headline import TermText
from cobot_joint.diagnosis.report.report import write_report
from cobot_joint.live.bench import LiveBench
from cobot_joint.live.bench_page import BenchPage
from cobot_joint.live.results_page import ResultsPage
from cobot_joint.live.server import Server
from cobot_joint.live.what_if import WhatIf
from cobot_joint.system import load_system
from tests.browser import PHONE, VIEWS, WIDE, fits, found_by_axe
from tests.orchestrator.diagnosis.report.test_report import FINDING, UNLISTED, data
from tests.orchestrator.live.test_live import results  # noqa: F401, a fixture

pytestmark = pytest.mark.long

KEPT = Path(__file__).parent / "diagnosis" / "report" / "screens"  # renewed with COBOT_JOINT_KEEP_SCREENS=1
SCREENS = {
    "wide": (WIDE, "screen"),
    "tablet": ({"width": 820, "height": 1180}, "screen"),
    "phone": (PHONE, "screen"),
    "print": ({"width": 794, "height": 1123}, "print"),  # A4 at 96 dots per inch
}
CELL, VISIBLE, LIKE = 10, 40, 0.02  # px; grey levels of 255; share of cells: another font's letters stay below
STRIBECK = TermText("Stribeck friction", "tau = tau_S*exp(-(w/w_S)^2)*sgn(w, w_C)", "Dahl 1968; Karnopp 1985")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The address of a report with all of its parts."""
    given = replace(
        data("unlisted", [FINDING, UNLISTED]),
        system=load_system("joint"),
        created=date(2026, 3, 1),
        provenance={"tool": "cobot-joint"},
        tried=[("motor_bldc.cogging", 3.0)],
        terms={"planetary_gear.stribeck": STRIBECK},
    )
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, given)
    return path.as_uri()


@pytest.fixture(scope="module", params=["results", "bench"])
def live(request: pytest.FixtureRequest, results: WhatIf) -> Iterator[str]:  # noqa: F811
    """The address of a live page."""
    page = ResultsPage(results) if request.param == "results" else BenchPage(LiveBench(load_system("joint")))
    server = Server(page.app)
    thread = threading.Thread(target=server.serve, daemon=True)
    thread.start()
    yield server.address
    server.close()
    thread.join(timeout=10)


def opened(chromium: Any, address: str, size: dict[str, int] = WIDE, scheme: str = "light") -> tuple[Any, list[str]]:
    """A page, and what its console complains of."""
    page = chromium.new_context(viewport=size, color_scheme=scheme).new_page()
    complaints: list[str] = []
    page.on("console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(address)
    page.wait_for_selector(".plot svg, .js-plotly-plot svg")
    return page, complaints


def cells(picture: bytes) -> NDArray[np.float64]:
    """Mean grey levels of squares of CELL px: (rows, columns)"""
    image = Image.open(io.BytesIO(picture)).convert("L")
    return np.asarray(image.reduce(CELL), dtype=np.float64)


def unlike(a: bytes, b: bytes) -> float:
    """Share of cells that look different; 1: other sizes."""
    x, y = cells(a), cells(b)
    return float(np.mean(np.abs(x - y) > VISIBLE)) if x.shape == y.shape else 1.0


@pytest.mark.parametrize("name", SCREENS)
def test_the_first_screen_of_the_report_looks_as_it_was_kept(chromium: Any, report: str, name: str) -> None:
    size, medium = SCREENS[name]
    page, _ = opened(chromium, report, size)
    page.emulate_media(media=medium)
    if medium == "print":
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.wait_for_timeout(1500)
    seen = page.screenshot()
    kept = KEPT / f"{name}.png"
    if os.environ.get("COBOT_JOINT_KEEP_SCREENS"):
        kept.write_bytes(seen)
    assert unlike(seen, kept.read_bytes()) < LIKE
    page.evaluate("document.body.style.paddingTop = '60px'")  # what has moved is seen
    assert unlike(page.screenshot(), kept.read_bytes()) > LIKE


@pytest.mark.parametrize(("size", "scheme"), VIEWS)
def test_axe_finds_nothing_in_the_report_and_nothing_is_cut_off(
    chromium: Any, report: str, size: dict[str, int], scheme: str
) -> None:
    page, complaints = opened(chromium, report, size, scheme)
    page.evaluate("for (const part of document.querySelectorAll('details')) part.open = true")
    page.wait_for_timeout(500)
    assert page.locator(".plot:empty").count() == 0
    assert found_by_axe(page) == []
    assert fits(page)
    assert complaints == []


def test_the_keyboard_opens_every_folded_part_of_the_report(chromium: Any, report: str) -> None:
    page, _ = opened(chromium, report)
    folded = page.locator("details:not([open])").count()
    for _ in range(10 * folded):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.matches('details:not([open]) > summary')"):
            page.keyboard.press("Enter")
    assert folded >= 7
    assert page.locator("details:not([open])").count() == 0


def test_a_link_to_the_words_opens_them(chromium: Any, report: str) -> None:
    page, _ = opened(chromium, report)
    assert not page.locator("#words").is_visible()
    page.get_by_role("link", name="what the words mean").click()
    assert page.locator("#words").is_visible()


@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_axe_finds_nothing_in_a_live_page_and_nothing_is_cut_off(
    chromium: Any, live: str, size: dict[str, int]
) -> None:
    page, complaints = opened(chromium, live, size)
    assert found_by_axe(page) == []
    assert fits(page)
    assert complaints == []


def test_a_slider_is_found_by_its_label_and_moved_by_the_keyboard(chromium: Any, live: str) -> None:
    page, _ = opened(chromium, live)
    sliders = page.get_by_role("slider")
    assert sliders.count() >= 2
    labels = [label.text_content() for label in page.locator(".slider label").all()]
    assert [slider.get_attribute("aria-label") for slider in sliders.all()] == labels
    before = sliders.first.get_attribute("aria-valuenow")
    for _ in range(40):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.getAttribute('role') === 'slider'"):
            break
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(500)
    assert sliders.first.get_attribute("aria-valuenow") != before
