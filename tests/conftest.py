"""Fixtures for every test."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]

# Tests run beside each other, and threads of linear algebra spin while they wait for a core.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

# Where the checkout has been built (build/fmus), its own package is tested, else the installed one. Processes that
# tests start find the same package, and the checkout's benchmarks and proof.
sys.path.insert(0 if (ROOT / "build" / "fmus").is_dir() else len(sys.path), str(ROOT / "orchestrator"))
import cobot_joint  # noqa: E402

PATH = (str(Path(cobot_joint.__file__).parents[1]), str(ROOT), os.environ.get("PYTHONPATH"))
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, PATH))
sys.path.append(str(ROOT))


def pytest_report_header() -> str:
    """Which of both is tested."""
    return f"cobot_joint: {Path(cobot_joint.__file__).parent}"


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shared() -> Path:
    """../shared: reference solutions and recordings, too large for the repository. Skips where they are absent."""
    path = ROOT.parent / "shared"
    if not (path / "reference").is_dir():
        pytest.skip("reference solutions and recordings (../shared) are not on this machine")
    return path


@pytest.fixture(scope="session")
def fmu() -> Callable[[str], Path]:
    """fmu("motor_bldc"): the path of a built unit. A unit that is not built fails the test, it does not skip it."""
    from cobot_joint.units import find_fmu

    return lambda name: find_fmu(f"{name}.fmu")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """The machine's browser, as Playwright drives it. Skips where either is absent."""
    pytest.importorskip("axe_playwright_python", reason="the extra [dev] is not installed")
    from playwright.sync_api import sync_playwright

    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        pytest.skip("Chromium is not installed")
    with sync_playwright() as driver:
        yield driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
