"""Other co-simulation masters behind one small interface: the same FMUs, wires, step and recorded outputs in each.

A peer is a module with `SCHEMES`, those of `JACOBI` and `GAUSS_SEIDEL` that it can do, and
`run(wiring, folder) -> Run`; `worker.py` serves its runs in a process of its own, `client.py` asks for them.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

PEERS = [
    "fmpy_loop",
    "libcosim",
    "ecos",
    "cofmupy_loop",
    "maestro",
    "fmi4j",
    "fmucontainer",
    "fmuloader_loop",
    "fmi_rs",
]


JACOBI = "Jacobi"  # inputs of all units at the start of the step, held over it
GAUSS_SEIDEL = "Gauss-Seidel"  # in stepping order, later units see what earlier ones have just given


class Absent(Exception):
    """This peer, or what it needs, is not installed; the message says what is missing."""


@dataclass(frozen=True)
class Wiring:
    """What every master is given. Reals only; whatever is not wired keeps its start value.

    `units`: name -> path of the FMU, in stepping order; `connections`: (source unit, output, sink unit, input);
    `outputs`: column -> (unit, output), recorded at every communication point; `step`, `stop`: s.
    """

    units: dict[str, str]
    connections: list[tuple[str, str, str, str]]
    outputs: dict[str, tuple[str, str]]
    step: float
    stop: float
    scheme: str = JACOBI

    @property
    def steps(self) -> int:
        """Communication steps of the run."""
        return round(self.stop / self.step)


@dataclass(frozen=True)
class Run:
    """`seconds`: from first step to last (`measure.stopwatch`), outputs recorded, without loading and initialising; nan
    where that is not told apart. `columns`: (steps,) each, at the end of every step; empty where a master keeps them to
    itself."""

    seconds: float
    columns: dict[str, NDArray[np.float64]] = field(default_factory=dict)
