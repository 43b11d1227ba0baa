"""This project's master as a contestant: a whole `Simulation.run`, initialisation, recording and energy included."""

from typing import Any

import numpy as np

from benchmarks.bench import DURATION
from benchmarks.measure import stopwatch
from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.results.result import Result
from cobot_joint.system import Inputs

NOTHING = Inputs(np.zeros(1))


class Ours:
    """One configuration of a loaded system, run again and again; `options` are fields of its `Experiment`."""

    result: Result  # of the last run

    def __init__(self, simulation: Simulation, inputs: Inputs, duration: float = DURATION, **options: Any) -> None:
        self._simulation, self._experiment = simulation, Experiment(inputs, duration, **options)

    def __call__(self) -> float:
        """Seconds of one run."""
        with stopwatch() as seconds:
            self.result = self._simulation.run(self._experiment)
        return seconds[0]
