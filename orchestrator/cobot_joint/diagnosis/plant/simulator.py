"""A system beside a recording: the same inputs, at the recording's time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from types import TracebackType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import Experiment, Feedback, Simulation, SimulationError
from cobot_joint.cosim.instances import UnfitError
from cobot_joint.cosim.schemes import MONOLITHIC
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.plant import Courses
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import Inputs, System, Value
from cobot_joint.system.shafts import position_behind

Signals = Mapping[str, NDArray[np.float64]]

FASTEST = replace(MONOLITHIC, pace=2e4)  # 1/s; there units that step themselves take as long
COARSE = replace(FASTEST, tolerance=16 * FASTEST.tolerance)


def run_beside(
    simulation: Simulation,
    recording: Recording,
    values: Mapping[str, Value],
    *,
    courses: Courses | None = None,
    added: Signals | None = None,
    record: Sequence[str],
) -> dict[str, NDArray[np.float64]]:
    """`record` at the recording's time, each (n,). Units of ours as one system; where there are others, or the system
    says how it is coupled, they step themselves.

    values: `component.variable` -> value over the system's own. courses: those that change on the way, by the time
    since the recording's first sample. added: (n,) each, on top of what the recording has there. UserError: a name or
    value is wrong. SimulationError (of cosim): a unit fails.
    """
    time = recording.time - recording.time[0]  # what fades or warms up does so from the run's beginning
    events = [(t, {name: x}) for name, of_time in (courses or {}).items() for t, x in of_time]
    start = {**values} | {_variable(simulation.system, name): value for name, value in recording.initial.items()}
    inputs = summed(recording.inputs, added or {})
    experiment = Experiment(
        Inputs(time, inputs, frozenset(recording.held & inputs.keys())),
        float(time[-1]),
        output_step=recording.step,
        parameters=start,
        parameter_events=sorted(events, key=lambda event: event[0]),
        record=record,
    )
    places = {n: p for n in recording.differences if n in record and (p := position_behind(simulation.system, n))}
    experiment = replace(experiment, record=list(dict.fromkeys([*record, *(p for p, _ in places.values())])))
    result = None
    if simulation.is_one_system:
        with suppress(UnfitError):  # units step themselves then: faster, or the only way
            result = simulation.run(replace(experiment, scheme=COARSE if recording.coarse else FASTEST))
    result = result or simulation.run(experiment)
    if len(result.time) < len(time):
        raise SimulationError(f"{simulation.system.name} ends at {result.time[-1]:.6g} s of {time[-1]:.6g} s")
    found = {name: np.asarray(result.signals[name]) for name in record}
    for name, (place, times) in places.items():
        rate = differences(result.signals[place], recording.step, recording.differences[name])
        found[name] = np.where(np.isnan(rate), found[name], times * rate)
    return found


def differences(place: NDArray[np.float64], step: float, how: Literal["backward", "central"]) -> NDArray[np.float64]:
    """A speed as it is made of a position's samples, (n,); NaN before which there is none."""
    return np.gradient(place, step) if how == "central" else np.append(np.nan, np.diff(place) / step)


def setting_in(
    values: Mapping[str, Value], onsets: Mapping[str, float] | None
) -> tuple[dict[str, Value], dict[str, list[tuple[float, Value | Feedback]]]]:
    """(values that hold from the start, courses of those that hold from an onset on). onsets: s since a run began."""
    late = {name: t for name, t in (onsets or {}).items() if name in values}
    start = {name: value for name, value in values.items() if name not in late}
    return start, {name: [(t, values[name])] for name, t in late.items()}


def summed(inputs: Signals, added: Signals) -> dict[str, NDArray[np.float64]]:
    """Inputs and what enters beside them: a torque that was recorded may enter where one is looked for."""
    return {**inputs, **{name: x + inputs[name] if name in inputs else x for name, x in added.items()}}


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

    def __call__(self, recording: Recording) -> Signals:
        """Outputs at the recording's time. UserError: a connector or parameter is wrong.

        SimulationError: a unit fails.
        """
        system = self.systems[recording.setup]
        if recording.setup not in self._loaded:
            self._loaded[recording.setup] = Simulation(system)
        there = {n: v for n, v in self.values.items() if any(n.startswith(f"{c.name}.") for c in system.components)}
        simulation = self._loaded[recording.setup]
        start, courses = setting_in(there, self.onsets)
        return run_beside(simulation, recording, start, courses=courses, record=list(recording.outputs))


def _variable(system: System, name: str) -> str:
    """`component.variable` behind an output of the system; a name that has a component already stays."""
    for wire in system.connections:
        if wire.sink_component is None and wire.sink == name and wire.source_component is not None:
            return f"{wire.source_component}.{wire.source}"
    if "." not in name:
        raise UserError(f"initial {name!r}: {system.name} has no such output, it has {among(system.outputs)}")
    return name
