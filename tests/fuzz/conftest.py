"""How long is looked: a few seconds in every test run, as long as COBOT_JOINT_FUZZ says in one of its own.

    COBOT_JOINT_FUZZ=1000 pytest tests/fuzz -m "long or not long"

takes a thousand times the examples of the short form, others each time; what fails is kept in .hypothesis and tried
first.
"""

from __future__ import annotations

import os
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, settings

from cobot_joint.errors import UserError

TIMES = int(os.environ.get("COBOT_JOINT_FUZZ", "1"))
settings.register_profile(
    "fuzz",
    max_examples=40 * TIMES,
    derandomize=TIMES == 1,  # the short form gives the same answer twice
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
settings.load_profile("fuzz")


@pytest.fixture(scope="session")
def refusal() -> Callable[..., str]:
    """refusal(read, path): what UserError said, nothing where the call went through. Any other error fails the test."""

    def call(function: Callable[..., object], *arguments: object) -> str:
        try:
            function(*arguments)
        except UserError as error:
            return str(error)
        return ""

    return call


@pytest.fixture(scope="session")
def times() -> int:
    """How many times the examples of the short form."""
    return TIMES
