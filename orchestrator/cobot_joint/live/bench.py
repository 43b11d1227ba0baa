"""The bench while it runs: inputs are where the sliders were, and the run is simulated up to now."""

from __future__ import annotations

import threading
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.results.result import Result
from cobot_joint.system.model import Inputs, System

LONGEST = 60.0  # s of a run
RISE = 0.05  # s, in which an input follows its slider: a step would be none that the bench can do
OUTPUT = 5e-3  # s between recorded rows


class LiveBench:
    """A system, loaded once, and how its inputs went since the run began. A context manager.

    A run is simulated from its beginning each time: 20 s of the bench take less than 0.1 s, and no state is kept that
    could go astray.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self._simulation = Simulation(system)
        self._turn = threading.Lock()
        self.restart()

    def __enter__(self) -> LiveBench:
        return self

    def __exit__(self, *_: object) -> None:
        self._simulation.close()

    def restart(self) -> None:
        """From standstill, everything off."""
        with self._turn:
            self._time = [0.0]
            self._inputs: dict[str, list[float]] = {name: [0.0] for name in self.system.inputs}

    @property
    def now(self) -> float:
        """s since the run began, up to which inputs are known."""
        return self._time[-1]

    def advance(self, until: float, values: Mapping[str, float]) -> Result | None:
        """The run up to then, with the sliders (input -> value) there since the last call; None: it is no later, or
        the run is over. SimulationError: a unit fails.
        """
        with self._turn:
            until = round(min(until, LONGEST) / OUTPUT) * OUTPUT
            last = self._time[-1]
            if until <= last:
                return None
            if until - last > 2 * RISE:
                self._add(last + RISE, values)
            self._add(until, values)
            inputs: dict[str, NDArray[np.float64]] = {name: np.array(x) for name, x in self._inputs.items()}
            return self._simulation.run(
                Experiment(Inputs(np.array(self._time), inputs), stop_time=until, output_step=OUTPUT)
            )

    def _add(self, time: float, values: Mapping[str, float]) -> None:
        self._time.append(time)
        for name, history in self._inputs.items():
            history.append(float(values.get(name, history[-1])))
