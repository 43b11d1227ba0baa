"""A frequency response as a plant: amplitudes over frequency, each from a simulated time series, as it was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.campaign_file import FrequencyExperiment
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import Courses, Parameter, Port, Signals, SimulationError, TermCandidate
from cobot_joint.system.model import System

CHANNEL = "ln amplitude"
ROWS = 400  # recorded per period, about
TICK = 5e-4  # s, of which rows are multiples
PERIODS = 4.0  # settling times: longer periods are left out of the ranking
Vector = NDArray[np.float64]


class FrequencyPlant:
    """A system seen through amplitudes: one recording per frequency, which is its only time. A context manager."""

    def __init__(self, system: System, experiment: FrequencyExperiment, omega: Vector) -> None:
        self.plant = FmuPlant({"default": system})
        self.parameters: Mapping[str, Parameter] = self.plant.parameters
        self.terms: Sequence[TermCandidate] = self.plant.terms
        self.ports: Sequence[Port] = ()
        self.inputs: Sequence[Port] = ()
        self.runs = {float(w): _run(experiment, float(w)) for w in omega}
        self.settle, self.output = experiment.settle, experiment.output

    def __enter__(self) -> FrequencyPlant:
        return self

    def __exit__(self, *error: Any) -> None:
        self.plant.__exit__(*error)

    def has(self, name: str, recording: Recording) -> bool:
        """See Plant.has."""
        return self.plant.has(name, next(iter(self.runs.values())))

    def simulate(
        self,
        values: Mapping[str, float],
        recording: Recording,
        *,
        onsets: Mapping[str, float] | None = None,
        added: Mapping[str, Vector] | None = None,
        signals: Sequence[str] = (),
        courses: Courses | None = None,
    ) -> Signals:
        """{CHANNEL: (1,)}, ln of half the swing at the recording's frequency. SimulationError: it fails, or rests."""
        omega = float(recording.time[0])
        run = self.runs[omega]
        w = self.plant.simulate(values, run)[self.output]
        swing = np.ptp(w[run.time >= self.settle - 1e-9]) / 2
        if not swing > 0:
            raise SimulationError(f"{self.output}: no amplitude at {omega:g} rad/s")
        return {CHANNEL: np.array([np.log(swing)])}


def by_frequency(table: Recording) -> list[Recording]:
    """One recording per row of a table (n,), so that frequencies are simulated beside each other."""
    logs = table.outputs[CHANNEL]
    return [
        replace(table, name=f"{w:g} rad/s", time=table.time[k : k + 1], outputs={CHANNEL: logs[k : k + 1]})
        for k, w in enumerate(table.time)
    ]


def quick(recordings: Sequence[Recording], settle: float) -> list[Recording]:
    """The frequencies whose period is no longer than a few settling times: a ranking needs no more."""
    few = [r for r in recordings if r.time[0] >= 2 * np.pi / (PERIODS * settle)]
    return few if len(few) >= len(recordings) // 2 else list(recordings)


def _run(experiment: FrequencyExperiment, omega: float) -> Recording:
    """From rest through `settle` and one whole period, on whole steps of TICK."""
    period = 2 * np.pi / omega
    step = TICK * max(1, round(period / ROWS / TICK))
    time: Vector = np.arange(int(np.ceil((experiment.settle + period) / step)) + 1, dtype=np.float64) * step
    inputs = {experiment.input: experiment.amplitude * np.sin(omega * time)}
    nothing = {experiment.output: np.full(len(time), np.nan)}
    return Recording(f"{omega:g} rad/s", "train", "default", time, inputs, nothing, {})
