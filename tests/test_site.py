"""The documentation as a site: it builds without a warning, and its links lead somewhere."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.long
def test_the_site_builds_strictly_and_its_links_lead_to_files_that_are_there(tmp_path: Path) -> None:
    if not importlib.util.find_spec("material"):
        pytest.skip("the extra [docs] is not installed")
    site = tmp_path / "site"
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(site)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    pages = [page for page in site.rglob("index.html") if "assets" not in page.parts]
    links = [(page, link) for page in pages for link in re.findall(r'(?:href|src)="([^"]+)"', page.read_text("utf-8"))]
    inside = [(page, link.partition("#")[0]) for page, link in links if not re.match(r"[a-z]+:|#", link)]
    lost = {link for page, link in inside if not (page.parent / unquote(link)).exists()}
    assert len(pages) > 30
    assert not lost
