"""Runs of a system: instances loaded once, then any number of runs with other parameters, inputs and schemes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import native, reference
from cobot_joint.cosim.energy import mechanical_connections, works
from cobot_joint.cosim.initialise import initialise
from cobot_joint.cosim.instances import Instance, check_parameters
from cobot_joint.cosim.plan import make_plan
from cobot_joint.cosim.schemes import DEFAULT, WITHOUT_ROLLBACK, Scheme, scheme_of
from cobot_joint.errors import UserError
from cobot_joint.system.initial import initial_order
from cobot_joint.system.model import Inputs, Result, System, Value

Progress = Callable[[float, float], None]  # (simulated time, stop time), s
ParameterEvents = Sequence[tuple[float, Mapping[str, Value]]]
Rows = NDArray[np.float64]
ROWS_PER_CHUNK = 10_000


class Master(Protocol):
    """What native.Master and reference.Master have in common."""

    def begin(self) -> None: ...
    def resume(self) -> None: ...
    def advance(self, tick: int, rows: Rows) -> None: ...
    def record(self, row: Rows) -> None: ...
    def counters(self) -> dict[str, int]: ...
    def close(self) -> None: ...


@dataclass(frozen=True)
class Clock:
    """Points in time t = start + tick*step; every `per_row`th is recorded; no step is longer than `stride` ticks."""

    start: float
    step: float
    per_row: int
    stride: int
    rows: int  # the one at the start included

    def times(self, first_row: int, end_row: int) -> NDArray[np.float64]:
        """s"""
        return np.float64(self.start) + np.arange(first_row, end_row) * self.per_row * np.float64(self.step)

    def tick_at(self, t: float) -> int:
        """The first communication point not before t."""
        return max(0, math.ceil((t - self.start) / self.step - 1e-6))


def make_clock(scheme: Scheme, start: float, stop: float, step: float | None, output_step: float) -> Clock:
    """`step` of None: the scheme's own, or the next below that divides `output_step`. UserError: times do not fit."""
    if not (output_step > 0 and math.isfinite(stop) and stop >= start):
        raise UserError(f"start {start:g} s, stop {stop:g} s, output step {output_step:g} s: time has to go forward")
    if step is not None and not 0 < step < math.inf:
        raise UserError(f"step {step:g} s is given, it has to be positive")
    longest = step or min(scheme.step, output_step)  # rows inside of steps, interpolated, only where asked for
    rows = math.floor((stop - start) / output_step + 1e-6) + 1
    if scheme.adaptive:  # ticks that divide output_step by powers of two, strides of such powers
        per_row = 2 ** max(0, math.ceil(math.log2(output_step / min(scheme.shortest, longest)) - 1e-9))
        tick = output_step / per_row
        return Clock(start, tick, per_row, 2 ** max(0, math.floor(math.log2(longest / tick) + 1e-9)), rows)
    per_row = max(1, math.ceil(output_step / longest - 1e-9))
    if step is not None and abs(per_row * step - output_step) > 1e-9 * output_step:
        raise UserError(f"step {step:g} s is given, the output step {output_step:g} s has to be a multiple of it")
    return Clock(start, output_step / per_row, per_row, 1, rows)


def turns(inputs: Inputs, clock: Clock) -> NDArray[np.int64]:
    """Ticks next to where an input's slope changes: before the first sample and after the last it is 0."""
    t, found = inputs.time, np.zeros(len(inputs.time), dtype=bool)
    for samples in inputs.values.values():
        slopes = np.concatenate([[0.0], np.diff(samples) / np.diff(t), [0.0]])
        rounding = 1e-9 * np.max(np.abs(samples), initial=0.0) / np.min(np.diff(t), initial=np.inf)
        found |= np.abs(np.diff(slopes)) > rounding
    ticks = (t[found] - clock.start) / clock.step
    near = np.round(ticks)
    exact = np.abs(ticks - near) < 1e-6
    return np.unique(np.concatenate([near[exact], np.floor(ticks[~exact]), np.ceil(ticks[~exact])])).astype(np.int64)


class Simulation:
    """A system whose units are loaded and instantiated once, for any number of runs, one after the other.

    `engine`: "native", or "reference", the same in plain FMPy.
    """

    def __init__(self, system: System, engine: Literal["native", "reference"] = "native") -> None:
        """SimulationError: a unit does not load or instantiate."""
        self.system = system
        self.engine = engine
        self.counters: dict[str, int] = {}
        self._instances: dict[str, Instance] = {}
        self._order = initial_order(system)
        self._tables: dict[object, native.Tables] = {}
        self._flanges = mechanical_connections(system)
        try:
            for component in system.components:
                self._instances[component.name] = Instance(component)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Simulation:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _value: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def instances(self) -> Mapping[str, Instance]:
        """By component; between two runs they are anyone's to use, every run resets them."""
        return self._instances

    def close(self) -> None:
        """Free the instances."""
        for instance in self._instances.values():
            instance.close()
        self._instances.clear()

    def run(
        self,
        inputs: Inputs,
        stop_time: float,
        *,
        scheme: str | Scheme | None = None,
        step: float | None = None,
        output_step: float = 1e-3,
        start_time: float = 0.0,
        parameters: Mapping[str, Value] | None = None,
        parameter_events: ParameterEvents = (),
        record: Sequence[str] | None = None,
        progress: Progress | None = None,
    ) -> Result:
        """One run, all of it in memory.

        `step`: s, the communication step, `output_step` a multiple of it, or the longest of an adaptive scheme; None:
        the scheme's own.
        `parameters`: `component.variable` -> value, over the system's; `parameter_events`: the same at times during the
        run, taking effect at the first communication point not before. `record`: the system's outputs and inputs and
        `component.variable`; None: the system's outputs. `progress`: called with (time, stop time) now and then.
        UserError: a name, value or time that is wrong. SimulationError: a unit fails.
        """
        chosen = self._scheme(scheme)
        clock = make_clock(chosen, start_time, stop_time, step, output_step)
        master, names = self._prepare(inputs, chosen, clock, stop_time, parameters or {}, record)
        try:
            table = np.empty((clock.rows, len(names)))
            for _ in self._drive(master, clock, _events(self.system, parameter_events, clock), table, progress):
                pass
            self.counters = master.counters()
        finally:
            master.close()
        signals = {name: np.ascontiguousarray(table[:, j]) for j, name in enumerate(names)}
        return Result(clock.times(0, clock.rows), signals, self.energy(), chosen.name, clock.step * clock.stride)

    def stream(
        self,
        inputs: Inputs,
        stop_time: float,
        *,
        scheme: str | Scheme | None = None,
        step: float | None = None,
        output_step: float = 1e-3,
        start_time: float = 0.0,
        parameters: Mapping[str, Value] | None = None,
        parameter_events: ParameterEvents = (),
        record: Sequence[str] | None = None,
        progress: Progress | None = None,
        rows_per_chunk: int = ROWS_PER_CHUNK,
    ) -> Iterator[Result]:
        """As `run`, in pieces of `rows_per_chunk` that follow one another: memory does not grow with the run.

        Each piece's `energy` is that from the start to the piece's end.
        """
        chosen = self._scheme(scheme)
        clock = make_clock(chosen, start_time, stop_time, step, output_step)
        master, names = self._prepare(inputs, chosen, clock, stop_time, parameters or {}, record)
        try:
            events = _events(self.system, parameter_events, clock)
            for first, rows in self._drive(master, clock, events, None, progress, len(names), rows_per_chunk):
                signals = {name: np.ascontiguousarray(rows[:, j]) for j, name in enumerate(names)}
                times = clock.times(first, first + len(rows))
                yield Result(times, signals, self.energy(), chosen.name, clock.step * clock.stride)
            self.counters = master.counters()
        finally:
            master.close()

    def energy(self) -> dict[str, tuple[float, float, float]]:
        """Mechanical connection -> (work given, work taken, integral of |power given|) since the run's start, J."""
        return works(self._flanges, self._instances)

    def _scheme(self, scheme: str | Scheme | None) -> Scheme:
        own = self.system.default_experiment
        if scheme is None and own.scheme is None:
            able = all(i.rolls_back and i.varies_step for i in self._instances.values())
            return scheme_of(DEFAULT if able else WITHOUT_ROLLBACK)
        if scheme is not None:
            return scheme_of(scheme)
        chosen = scheme_of(str(own.scheme))
        return replace(chosen, step=own.step) if own.step else chosen

    def _prepare(
        self,
        inputs: Inputs,
        scheme: Scheme,
        clock: Clock,
        stop_time: float,
        parameters: Mapping[str, Value],
        record: Sequence[str] | None,
    ) -> tuple[Master, tuple[str, ...]]:
        wanted = tuple(self.system.outputs if record is None else record)
        driven, dense = tuple(inputs.values), clock.stride > clock.per_row
        key = (scheme, driven, wanted, dense)
        if key not in self._tables:
            plan = make_plan(self.system, list(self._instances.values()), scheme, driven, wanted, dense)
            self._tables[key] = native.Tables(plan)
        tables = self._tables[key]
        samples = np.array(list(inputs.values.values()), dtype=np.float64).reshape(len(inputs.values), len(inputs.time))
        at_start = {name: float(np.interp(clock.start, inputs.time, row)) for name, row in inputs.values.items()}
        checked = check_parameters(self.system, parameters)
        initialise(self._order, self._instances, checked, at_start, clock.start, stop_time)
        breaks = turns(inputs, clock) if scheme.adaptive else np.empty(0, dtype=np.int64)
        common = (scheme, inputs.time, samples, clock.start, clock.step, clock.per_row, clock.stride, breaks)
        if self.engine == "native":
            return native.Master(tables, *common), tables.plan.names
        return reference.Master(tables.plan, *common), tables.plan.names

    def _drive(
        self,
        master: Master,
        clock: Clock,
        events: list[tuple[int, dict[str, dict[str, Value]]]],
        table: Rows | None,
        progress: Progress | None,
        width: int = 0,
        rows_per_chunk: int = ROWS_PER_CHUNK,
    ) -> Iterator[tuple[int, Rows]]:
        """Chunk after chunk: (first row, rows); into `table` where there is one, else into fresh arrays."""
        stop_time = float(clock.times(clock.rows - 1, clock.rows)[0])
        tick = 0
        for first in range(0, clock.rows, rows_per_chunk):
            end = min(first + rows_per_chunk, clock.rows)
            rows = np.empty((end - first, width)) if table is None else table[first:end]
            done = 0
            if first == 0:
                self._apply(events, 0)
                master.begin()
                master.record(rows[0])
                done = 1
            last_tick = (end - 1) * clock.per_row
            while tick < last_tick:
                target = min(last_tick, events[0][0]) if events else last_tick
                passed = target // clock.per_row - tick // clock.per_row
                master.advance(target, rows[done : done + passed])
                tick, done = target, done + passed
                if self._apply(events, tick):
                    master.resume()
            if progress:
                progress(float(clock.times(end - 1, end)[0]), stop_time)
            yield first, rows

    def _apply(self, events: list[tuple[int, dict[str, dict[str, Value]]]], tick: int) -> bool:
        """Set what is due."""
        due = False
        while events and events[0][0] <= tick:
            due = True
            _, changes = events.pop(0)
            for instance in self._instances.values():
                with instance.explained(f"on {changes.get(instance.name)} while time runs"):
                    for name, value in changes.get(instance.name, {}).items():
                        instance.set(name, value)
        return due


def _events(system: System, events: ParameterEvents, clock: Clock) -> list[tuple[int, dict[str, dict[str, Value]]]]:
    checked = [(clock.tick_at(t), check_parameters(system, changes, during=True)) for t, changes in events]
    return sorted(checked, key=lambda event: event[0])


def simulate(
    system: System,
    inputs: Inputs,
    stop_time: float,
    *,
    scheme: str | Scheme | None = None,
    step: float | None = None,
    output_step: float = 1e-3,
    start_time: float = 0.0,
    parameters: Mapping[str, Value] | None = None,
    parameter_events: ParameterEvents = (),
    record: Sequence[str] | None = None,
    progress: Progress | None = None,
    engine: Literal["native", "reference"] = "native",
) -> Result:
    """Load a system, run it once, free it; see Simulation.run."""
    with Simulation(system, engine) as simulation:
        return simulation.run(
            inputs,
            stop_time,
            scheme=scheme,
            step=step,
            output_step=output_step,
            start_time=start_time,
            parameters=parameters,
            parameter_events=parameter_events,
            record=record,
            progress=progress,
        )
