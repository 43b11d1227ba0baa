"""The benchmarks are not installed: tests find them in the checkout, behind whatever is installed."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2]))


@pytest.fixture(autouse=True)
def compiler() -> None:
    """The monolithic loops are C. Skips where there is no compiler."""
    if shutil.which("cc") is None and shutil.which("gcc") is None:
        pytest.skip("no C compiler on this machine: the monolithic loops cannot be built")
