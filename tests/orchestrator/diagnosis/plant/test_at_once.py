"""Work that is spread over threads and processes comes back in its order, or says what went wrong."""

from __future__ import annotations

import os

import pytest

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.plant.at_once import at_once, in_processes


def _square(x: int) -> tuple[int, int]:
    return x * x, os.getpid()


def _die(x: int) -> int:
    os._exit(x)


def test_results_come_in_the_order_of_what_was_asked() -> None:
    assert [x for x, _ in at_once(_square, range(9))] == [x * x for x in range(9)]
    found = in_processes(_square, range(9))
    assert [x for x, _ in found] == [x * x for x in range(9)]
    assert os.getpid() not in {process for _, process in found}
    assert in_processes(_square, []) == []


def test_a_process_that_dies_is_a_simulation_that_failed() -> None:
    with pytest.raises(SimulationError, match="a process that simulated died"):
        in_processes(_die, [3, 3])
