"""A system from sample to sample: runs from given states."""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import Experiment, Scheme, Simulation, SimulationError
from cobot_joint.cosim.schemes import MONOLITHIC
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.simulator import summed
from cobot_joint.diagnosis.state_estimation.native.restart import LostError, Restarts, restarts
from cobot_joint.diagnosis.state_estimation.states import states_of, why_none
from cobot_joint.errors import UserError
from cobot_joint.system.model import Connection, Inputs, System, Value

Array = NDArray[np.float64]
PLACES = ("rad", "m")  # units of measure of an angle or a way
FAR = 1e3  # times what a free run reaches: no machine gets there, and no filter comes back


@dataclass(frozen=True)
class Layout:
    """Where what is recorded of a system stands in a table: the states first; channels: their columns."""

    columns: Mapping[str, int]
    channels: list[int]


@dataclass(frozen=True)
class Piece:
    """A run from given states. time: (n,), s; x: (n, states), inside their bounds; table: (n, recorded signals), as
    they were; inputs: name -> (n,)."""

    time: Array
    x: Array
    table: Array
    inputs: Mapping[str, Array]
    layout: Layout

    def __getitem__(self, rows: slice) -> Piece:
        """A stretch of it."""
        inputs = {name: u[rows] for name, u in self.inputs.items()}
        return Piece(self.time[rows], self.x[rows], self.table[rows], inputs, self.layout)

    @property
    def y(self) -> Array:
        """(n, channels)"""
        return self.table[:, self.layout.channels]

    @cached_property
    def signals(self) -> dict[str, Array]:
        """`component.variable` or channel -> (n,)"""
        return {name: self.table[:, column] for name, column in self.layout.columns.items()}


class SampledSystem:
    """One system with one set of values, loaded once. A context manager.

    values: `component.variable` -> value over the system's own. onsets: of these, s, from which they hold. channels:
    the system's outputs that are compared. UserError: a unit of the system allows no state to be set.
    """

    def __init__(
        self,
        system: System,
        channels: Sequence[str],
        values: Mapping[str, Value] | None = None,
        onsets: Mapping[str, float] | None = None,
    ) -> None:
        states = states_of(system)
        if states is None:
            raise UserError(f"{system.name}: {why_none(system)}, so that no run can begin at a given state")
        self.system, self.states = system, states
        self.channels = tuple(channels)
        self.values, self.onsets = dict(values or {}), dict(onsets or {})
        self.nominal = np.array([s.nominal for s in states])
        self.places = [
            j for j, s in enumerate(states) if system.component(s.component).unit.unit_of(s.variable) in PLACES
        ]
        self._bounds = np.array([s.lower for s in states]), np.array([s.upper for s in states])
        self.simulation = Simulation(system)
        self.scheme = self._chosen_scheme()
        self.in_use = threading.Lock()  # by one who asks its units for other values
        real = {c.name: {v.name for v in c.unit.variables.values() if v.type == "Real"} for c in system.components}
        into = [c for c in system.connections if c.sink_component and c.sink in real[c.sink_component]]
        self.taps = [_tap(system, channel) for channel in self.channels]
        # between components; from inputs of the system; outputs of components that a wire or a channel reads
        self.wires = _that_matter(system, [c for c in into if c.source_component], self.taps)
        self.driven = [c for c in into if c.source_component is None]
        sources = {(c.source_component, c.source) for c in (*self.wires, *self.taps)}
        self.sources = [(name, v) for name, v in sources if name is not None]
        record = [s.name for s in states] + [f"{c}.{v}" for c, v in self.sources] + list(self.channels)
        columns = {name: column for column, name in enumerate(dict.fromkeys(record))}
        self.layout = Layout(columns, [columns[channel] for channel in self.channels])

    def _chosen_scheme(self) -> Scheme | None:
        """As one system: no coupling between stiff units keeps its steps short. None: units step themselves, the only
        way where one of them is another's, or gives what follows from no state and no input."""
        if not self.simulation.is_one_system:
            return None
        try:
            for values in (self._before_onsets(), self.values):
                self.simulation.run(Experiment(Inputs(np.zeros(1)), 0.0, parameters=values, scheme=MONOLITHIC))
        except SimulationError:  # what fails for another reason than the scheme says so when it is run
            return None
        return MONOLITHIC

    def __enter__(self) -> SampledSystem:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _value: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.simulation.close()

    def start(self, initial: Mapping[str, float]) -> Array:
        """(states,): the system's start values, and over them what a recording says: `component.variable` or output."""
        given = {self._behind(name): value for name, value in initial.items()} | self.values
        found = []
        for s in self.states:
            component = self.system.component(s.component)
            own = component.parameters.get(s.variable, component.unit.variables[s.variable].start or 0.0)
            found.append(float(given.get(s.name, own)))
        return np.array(found)

    def run(self, x: Array, time: Array, inputs: Mapping[str, Array], held: Collection[str] = ()) -> Piece:
        """From the states x: (states,) at time[0] on, recorded at each time: (n,), regular; inputs: name -> (n,), held:
        those that hold each sample until the next.

        SimulationError: a unit fails.
        """
        signals = self.simulation.run(self._experiment(x, time, inputs, held)).signals
        table = np.column_stack([signals[name][: len(time)] for name in self.layout.columns])
        return self.piece(time, table, inputs)

    @contextmanager
    def along(
        self,
        time: Array,
        inputs: Mapping[str, Array],
        reached: Array,
        ports: Sequence[str] = (),
        held: Collection[str] = (),
    ) -> Iterator[Runs]:
        """Runs along a recording. time: (n,), regular; reached: (states,), absolute values that a free run reaches,
        FAR times which a run is lost; ports: further inputs, 0 unless said; held: see `run`."""
        limits = np.concatenate([FAR * reached, np.full(len(self.layout.columns) - len(reached), np.inf)])
        if not restarts(self.simulation):
            yield Runs(self, time, inputs, held, {}, limits)
            return
        both = {**{port: np.zeros(len(time)) for port in ports}, **inputs}
        experiment = self._experiment(self.start({}), time, both, held)
        with Restarts(self.simulation, experiment, [s.name for s in self.states], limits) as quick:
            yield Runs(self, time, inputs, held, {port: list(both).index(port) for port in ports}, limits, quick)

    def _experiment(self, x: Array, time: Array, inputs: Mapping[str, Array], held: Collection[str]) -> Experiment:
        step = float(time[-1] - time[0]) / (len(time) - 1)
        # an estimate may lie beyond what a unit lets a state start at: a brake's torque a little below 0
        states = {s.name: float(v) for s, v in zip(self.states, self.inside(x), strict=True)}
        return Experiment(
            Inputs(time, dict(inputs), frozenset(inputs.keys() & held)),
            float(time[-1]) + 0.1 * step,
            start_time=float(time[0]),
            output_step=step,
            parameters=self._before_onsets() | states,
            parameter_events=[(t, {name: self.values[name]}) for name, t in self.onsets.items()],
            record=list(self.layout.columns),
            scheme=self.scheme,
        )

    def inside(self, x: Array) -> Array:
        """States inside their bounds: (.., states)"""
        return x.clip(*self._bounds)

    def free(self, recording: Recording) -> Piece:
        """From a recording's beginning to its end. SimulationError: a unit fails."""
        start, time = self.start(recording.initial), recording.time - recording.time[0]
        return self.run(start, time, recording.inputs, recording.held)

    def piece(self, time: Array, table: Array, inputs: Mapping[str, Array]) -> Piece:
        """Of a table of what was recorded."""
        # an integrator overshoots: a drive's heat count, used up within a step
        x = self.inside(table[:, : len(self.states)])
        return Piece(time, x, table, dict(inputs), self.layout)

    def values_of(self, component: str, t: float) -> dict[str, Value]:
        """variable -> value at the time t."""
        there = {n: v for n, v in self.values.items() if self.onsets.get(n, -np.inf) <= t}
        return {n.split(".", 1)[1]: v for n, v in there.items() if n.split(".", 1)[0] == component}

    def _before_onsets(self) -> dict[str, Value]:
        return {name: value for name, value in self.values.items() if name not in self.onsets}

    def own_signal(self, name: str, signals: Mapping[str, Array]) -> Array | None:
        """`component.variable` among recorded signals, an input by the wire into it; None: it was not recorded."""
        if name in signals:
            return signals[name]
        component, variable = name.split(".", 1)
        for c in self.wires:
            if (c.sink_component, c.sink) == (component, variable):
                return c.factor * signals[f"{c.source_component}.{c.source}"] + c.offset
        return None

    def _behind(self, name: str) -> str:
        """`component.variable` behind an output of the system."""
        if name in self.system.outputs:
            tap = _tap(self.system, name)
            return f"{tap.source_component}.{tap.source}"
        return name


@dataclass(frozen=True)
class Runs:
    """Along a recording, from any of its samples. ports: further inputs -> their rows of `quick`, which runs without a
    call per unit, where these units allow it. limits: (recorded signals,), absolute values at which a run is lost."""

    sampled: SampledSystem
    time: Array
    inputs: Mapping[str, Array]
    held: Collection[str]
    ports: Mapping[str, int]
    limits: Array
    quick: Restarts | None = None

    def run(self, x: Array, rows: slice, entering: Mapping[str, Array] | None = None) -> Piece:
        """From the states x at the first of the samples on, with signals at ports. SimulationError: a unit fails;
        LostError: the run goes beyond the limits."""
        inputs = summed({name: u[rows] for name, u in self.inputs.items()}, entering or {})
        if self.quick is None:
            piece = self.sampled.run(x, self.time[rows], inputs, self.held)
            if not (np.abs(piece.table) <= self.limits).all():  # nor is it a number
                raise LostError
            return piece
        for port, k in self.ports.items():
            self.quick.samples[k, rows] = inputs.get(port, 0.0)
        table = self.quick.run(self.sampled.inside(x), rows.start, rows.stop - rows.start)
        return self.sampled.piece(self.time[rows], table, inputs)


def _tap(system: System, channel: str) -> Connection:
    """The wire to an output of the system, or to what is recorded of a component. UserError: there is none."""
    for c in system.connections:
        if c.sink_component is None and c.sink == channel and c.source_component is not None:
            return c
    component, _, variable = channel.partition(".")
    if any(c.name == component and variable in c.unit.variables for c in system.components):
        return Connection(component, variable, None, channel)
    raise UserError(f"{system.name} has no output {channel!r}")


def _that_matter(system: System, wires: list[Connection], taps: list[Connection]) -> list[Connection]:
    """Wires into units with states, and into others where a needed output depends on them."""
    needed = {(c.source_component, c.source) for c in taps}
    chosen: list[Connection] = []
    while True:
        more = [w for w in wires if w not in chosen and _reads(system, w, needed)]
        if not more:
            return chosen
        chosen += more
        needed |= {(c.source_component, c.source) for c in more}


def _reads(system: System, wire: Connection, needed: set[tuple[str | None, str]]) -> bool:
    unit = system.component(str(wire.sink_component)).unit
    if unit.states:
        return True
    outputs = [v for name, v in needed if name == wire.sink_component]
    return any(wire.sink in unit.needs.get(v, [wire.sink]) for v in outputs)
