"""Fixtures for every test."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# The checkout comes last, so that an installed package goes first; processes that tests start find the same one.
sys.path.append(str(ROOT))
import orchestrator  # noqa: E402

PATH = (str(Path(orchestrator.__file__).parents[1]), str(ROOT), os.environ.get("PYTHONPATH"))
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, PATH))


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
    from orchestrator.units import find_fmu

    return lambda name: find_fmu(f"{name}.fmu")
