"""A system beside a recording: the same inputs, at the recording's time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from orchestrator.cosim import SCHEMES, Scheme, Simulation
from orchestrator.diagnosis.recording import Recording
from orchestrator.errors import UserError, among
from orchestrator.system.model import Inputs, System, Value

# Reversals of a healthy campaign with its true parameters, whose noise is 4.01 mA; rms of recording - simulation of the
# current: 4.64 mA with steps of 0.5 ms, 4.03 mA with 0.2 ms, 4.01 mA with 0.1 ms and with adaptive steps, which take
# 2.5 times as long: impacts in the gearhead's gap.
FINE = replace(SCHEMES["gauss_seidel_extrapolated"], step=1e-4)


def coupling(system: System) -> Scheme | None:
    """How a diagnosis steps a system: finely, unless the system says how it wants to be coupled."""
    return None if system.default_experiment.scheme else FINE


class Simulator:
    """Systems by set-up with one set of parameters, loaded once. A context manager; call it with a recording.

    values: `component.variable` -> value over the systems' own; those of components that a set-up lacks are passed
    over. onsets: of these, which hold only from a time on, s.
    """

    def __init__(
        self,
        systems: Mapping[str, System],
        values: Mapping[str, Value] | None = None,
        onsets: Mapping[str, float] | None = None,
    ) -> None:
        self.systems = dict(systems)
        self.values = dict(values or {})
        self.onsets = dict(onsets or {})
        self._loaded: dict[str, Simulation] = {}

    def __enter__(self) -> Simulator:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _value: BaseException | None, _trace: TracebackType | None
    ) -> None:
        for simulation in self._loaded.values():
            simulation.close()
        self._loaded.clear()

    def __call__(self, recording: Recording) -> Mapping[str, NDArray[np.float64]]:
        """Outputs at the recording's time. UserError: a connector or parameter is wrong.

        SimulationError: a unit fails.
        """
        system = self.systems[recording.setup]
        if recording.setup not in self._loaded:
            self._loaded[recording.setup] = Simulation(system)
        there = {n: v for n, v in self.values.items() if any(n.startswith(f"{c.name}.") for c in system.components)}
        start = {n: v for n, v in there.items() if n not in self.onsets}
        start |= {_variable(system, name): value for name, value in recording.initial.items()}
        result = self._loaded[recording.setup].run(
            Inputs(recording.time, recording.inputs),
            float(recording.time[-1]),
            start_time=float(recording.time[0]),
            scheme=coupling(system),
            output_step=recording.step,
            parameters=start,
            parameter_events=sorted((t, {n: there[n]}) for n, t in self.onsets.items() if n in there),
            record=list(recording.outputs),
        )
        return {name: result.signals[name] for name in recording.outputs}


def _variable(system: System, name: str) -> str:
    """`component.variable` behind an output of the system; a name that has a component already stays."""
    for wire in system.connections:
        if wire.sink_component is None and wire.sink == name and wire.source_component is not None:
            return f"{wire.source_component}.{wire.source}"
    if "." not in name:
        raise UserError(f"initial {name!r}: {system.name} has no such output, it has {among(system.outputs)}")
    return name
