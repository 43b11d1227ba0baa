"""Measuring on a machine that others use too: contestants take turns, medians are compared, one table is printed."""

import gc
import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Row:
    """One line of the table: a figure measured here, and what it ought to be.

    `value` None: not measured, and `note` says why. `details`: the medians and spreads behind the figure.
    """

    title: str
    value: float | None
    unit: str
    reach: str
    met: bool | None
    note: str = ""
    details: dict[str, Any] = field(default_factory=dict)

    def json(self) -> dict[str, Any]:
        return asdict(self)


def at_most(title: str, value: float, limit: float, unit: str, note: str = "", **details: Any) -> Row:
    """A row that is met up to `limit`."""
    return Row(title, value, unit, f"<= {limit:g} {unit}", value <= limit, note, details)


def at_least(title: str, value: float, limit: float, unit: str, note: str = "", **details: Any) -> Row:
    """A row that is met from `limit` on."""
    return Row(title, value, unit, f">= {limit:g} {unit}", value >= limit, note, details)


def missing(title: str, reach: str, why: str) -> Row:
    """A row that was not measured."""
    return Row(title, None, "", reach, None, why)


def alternate(contestants: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, list[float]]:
    """Runs every contestant once per round, in turn, after one round that does not count.

    A contestant returns the seconds it took; so does this, per contestant and round.
    """
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for count in range(rounds + 1):
        for name, contestant in contestants.items():
            seconds = contestant()
            if count:
                times[name].append(seconds)
    return times


def median(times: list[float]) -> float:
    return statistics.median(times)


def ratio(times: Mapping[str, list[float]], of: str, to: str) -> float:
    """Median over the rounds of `of` through `to`: pairs see the same machine."""
    return statistics.median(a / b for a, b in zip(times[of], times[to], strict=True))


def summary(times: Mapping[str, list[float]]) -> dict[str, dict[str, float]]:
    """Per contestant: median, least and largest, s."""
    return {name: {"median": median(t), "min": min(t), "max": max(t)} for name, t in times.items()}


@contextmanager
def stopwatch() -> Iterator[list[float]]:
    """Seconds of its block, as the only element of the list it gives; no garbage collection meanwhile.

    The lesser of wall time and the process's CPU time: waiting for what others run on the machine does not count, and
    several threads at work do not count twice. On an idle machine it is the wall time.
    """
    seconds: list[float] = []
    gc.collect()
    gc.disable()
    start, used = time.perf_counter(), time.process_time()
    try:
        yield seconds
    finally:
        seconds.append(min(time.perf_counter() - start, time.process_time() - used))
        gc.enable()


def timed(function: Callable[[], object]) -> float:
    """Seconds of one call."""
    with stopwatch() as seconds:
        function()
    return seconds[0]


def rms(difference: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(difference**2)))
