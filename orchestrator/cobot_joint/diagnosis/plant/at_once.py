"""One call per recording, on every core."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from cobot_joint.cosim import SimulationError
from cobot_joint.interrupts import end_with

T = TypeVar("T")
AT_ONCE = 2


def at_once(function: Callable[..., T], *items: Iterable[Any]) -> list[T]:
    """As `list(map(function, *items))`, two at a time. Units' own code and BLAS let other threads run meanwhile."""
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return list(pool.map(function, *items))


def in_processes(function: Callable[..., T], *items: Iterable[Any]) -> list[T]:
    """The same in processes of their own, for what is Python for the most part; all of it has to be picklable.

    SimulationError: a process died.
    """
    import joblib  # here: most commands do without, and it takes as long to import as a short run
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    lifeline = {"initializer": end_with, "initargs": (os.getpid(),)}
    calls = (joblib.delayed(function)(*each) for each in zip(*items, strict=True))
    try:
        return list(joblib.Parallel(n_jobs=AT_ONCE, batch_size=1, **lifeline)(calls))
    except TerminatedWorkerError as error:
        raise SimulationError("a process that simulated died: a unit crashed, or memory ran out") from error
