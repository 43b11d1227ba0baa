"""Work that is spread over threads comes back in its order."""

from __future__ import annotations

import threading

from cobot_joint.diagnosis.plant.at_once import at_once


def test_results_come_in_the_order_of_what_was_asked() -> None:
    both = threading.Barrier(2, timeout=10)  # passed by two threads only

    def square(x: int) -> int:
        both.wait()
        return x * x

    assert at_once(square, range(10)) == [x * x for x in range(10)]
    assert at_once(square, []) == []
