"""The documentation as a site: it builds without a warning, and its links lead somewhere."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from lxml import etree, html

import cobot_joint
from cobot_joint.units import find_fmu, load_unit
from tests.browser import VIEWS, fits, found_by_axe

ROOT = Path(__file__).parents[1]
FIGURES = ("docs/figures/proof", "docs/figures/reliability", "docs/figures/benchmarks")
UNITS = sorted(table.parent.name for table in ROOT.glob("fmus/*/model.def"))


def annotated(unit: str) -> list[dict[str, str]]:
    """What a unit says of its parts and terms, the parts first."""
    description = etree.parse(load_unit(find_fmu(f"{unit}.fmu")).directory / "modelDescription.xml")
    return [dict(e.attrib) for kind in ("Part", "Term") for e in description.iter(kind)]


pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not (importlib.util.find_spec("material") and importlib.util.find_spec("mkdocstrings")):
        pytest.skip("the extra [docs] is not installed")
    site = tmp_path_factory.mktemp("docs") / "site"
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(site)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return site


def test_the_site_builds_strictly_and_its_links_lead_to_files_that_are_there(site: Path) -> None:
    pages = [page for page in site.rglob("index.html") if "assets" not in page.parts]
    links = [(page, link) for page in pages for link in re.findall(r'(?:href|src)="([^"]+)"', page.read_text("utf-8"))]
    inside = [(page, link.partition("#")[0]) for page, link in links if not re.match(r"[a-z]+:|#", link)]
    lost = {link for page, link in inside if not (page.parent / unquote(link)).exists()}
    assert len(pages) > 30
    assert not lost


def test_nothing_on_the_site_is_loaded_from_elsewhere(site: Path) -> None:
    loads = re.compile(r"""<(?:script|img|link)\b[^>]*?(?:src|href)=["']?(?:https?:)?//[^>]+>""")
    pages = [page.read_text("utf-8") for page in site.rglob("*.html")]
    assert [tag for page in pages for tag in loads.findall(page) if 'rel="canonical"' not in tag] == []


@pytest.mark.parametrize("unit", UNITS)
def test_a_unit_has_a_page_with_its_equations_typeset(site: Path, unit: str) -> None:
    page = html.parse(site / "docs/units" / unit / "index.html", html.HTMLParser(encoding="utf-8"))
    equations = {term["name"]: term["equation"] for term in annotated(unit)}
    shown = {h.get("id"): h.getnext() for h in page.iterfind(".//h3") if h.get("id") in equations}
    assert list(shown) == [*equations]
    written = {name for name, equation in equations.items() if "=" in equation}
    assert {name for name in written if shown[name].find(".//math") is None} == set()


def test_the_pages_of_equations_are_typeset_and_lead_to_the_units(site: Path) -> None:
    assert (site / "docs/bench/index.html").read_text("utf-8").count("<math>") > 20
    thesis = (site / "docs/equations/index.html").read_text("utf-8")
    assert '<a href="../units/motor_bldc/#winding">' in thesis


def test_the_python_interface_has_a_page_with_every_public_name(site: Path) -> None:
    page = html.parse(site / "docs/api/index.html")
    ids = {heading.get("id") for heading in page.iterfind(".//h3")}
    assert {name for name in cobot_joint.__all__ if not name.startswith("_")} <= {
        i.rpartition(".")[2] for i in ids if i
    }
    assert "a shipped one by name" in page.find(".//main").text_content()


@pytest.mark.parametrize("name", FIGURES)
def test_a_page_of_figures_leads_to_places_that_are_there(site: Path, name: str) -> None:
    page = html.parse(site / name / "index.html", html.HTMLParser(encoding="utf-8"))
    ids = [found.get("id") for found in page.iterfind(".//*[@id]")]
    inside = {link.get("href")[1:] for link in page.iterfind(".//main//a[@href]") if link.get("href").startswith("#")}
    assert len(set(ids)) == len(ids)
    assert inside <= set(ids)


@pytest.fixture(scope="module")
def served(site: Path) -> Iterator[str]:
    """The site's address."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()


@pytest.mark.parametrize(("size", "scheme"), VIEWS)
@pytest.mark.parametrize("name", [*FIGURES, "docs/units/motor_bldc"])
def test_a_page_fits_a_phone_and_axe_finds_nothing_in_what_the_hook_wrote(
    chromium: Any, served: str, name: str, size: dict[str, int], scheme: str
) -> None:
    page = chromium.new_context(viewport=size, color_scheme=scheme).new_page()
    page.goto(f"{served}/{name}/")
    page.evaluate("for (const part of document.querySelectorAll('details')) part.open = true")
    page.wait_for_timeout(500)
    # all but the theme's own frame around it
    page.evaluate("document.body.replaceChildren(document.querySelector('main'))")
    assert found_by_axe(page) == []
    assert fits(page)
