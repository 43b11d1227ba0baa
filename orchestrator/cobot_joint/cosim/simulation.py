"""Runs of a system: instances loaded once, then any number of experiments, one after the other."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from types import TracebackType
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import native
from cobot_joint.cosim.clock import SLIGHT, Clock, halfway, make_clock, turns
from cobot_joint.cosim.energy import mechanical_connections, unmeasured, works
from cobot_joint.cosim.experiment import Experiment, Feedback
from cobot_joint.cosim.foreign.step_choice import PROBE, choose_step
from cobot_joint.cosim.initialise import initialise
from cobot_joint.cosim.instances import Instance, SimulationError, check_parameters
from cobot_joint.cosim.plan import discrete_inputs, make_plan
from cobot_joint.cosim.reference.master import Master as ReferenceMaster
from cobot_joint.cosim.schemes import DEFAULT, MONOLITHIC, WITHOUT_ROLLBACK, Scheme, scheme_of
from cobot_joint.errors import UserError, among
from cobot_joint.results.result import Result
from cobot_joint.system.initial import initial_order
from cobot_joint.system.model import Inputs, System, Value
from cobot_joint.system.parameters import split

log = logging.getLogger("cobot_joint")
Engine = Literal["native", "reference"]
Progress = Callable[[float, float], None]  # (simulated time, stop time), s
Rows = NDArray[np.float64]
Changes = dict[str, dict[str, Value | Callable[[], float]]]  # component -> variable -> value, or what gives it
ROWS_PER_CHUNK = 10_000


class Master(Protocol):
    """What native.Master and ReferenceMaster have in common."""

    def begin(self) -> None: ...
    def resume(self) -> None: ...
    def advance(self, tick: int, rows: Rows) -> None: ...
    def record(self, row: Rows) -> None: ...
    def rows(self) -> int: ...
    @property
    def tick(self) -> int: ...
    def counters(self) -> dict[str, int]: ...
    def works(self) -> list[tuple[float, float]]: ...
    def close(self) -> None: ...


@dataclass(frozen=True)
class _Run:
    """A run that is ready to begin. `events`: (tick, component -> variable -> value), those that are still to come."""

    master: Master
    scheme: Scheme
    clock: Clock
    names: tuple[str, ...]
    units: Mapping[str, str | None]
    events: list[tuple[int, Changes]]


class Simulation:
    """A system whose units are loaded and instantiated once, for any number of runs, one after the other.

    `engine`: "native", or "reference", the same in plain FMPy.
    """

    def __init__(self, system: System, engine: Engine = "native") -> None:
        """SimulationError: a unit does not load or instantiate."""
        self.system = system
        self.engine = engine
        self.counters: dict[str, int] = {}
        self._instances: dict[str, Instance] = {}
        self._order = initial_order(system)
        self._tables: dict[object, tuple[native.Tables, dict[str, str | None]]] = {}
        self._connections = mechanical_connections(system)
        self._measured = [(0.0, 0.0)] * len(unmeasured(self._connections))
        try:
            for component in system.components:
                self._instances[component.name] = Instance(component)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Simulation:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, value: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """SimulationError: a unit crashes while it is freed, and nothing else went wrong."""
        failures = self._freed()
        if failures and value is None:
            raise failures[0]

    @property
    def instances(self) -> Mapping[str, Instance]:
        """By component; between two runs they are anyone's to use, every run resets them."""
        return self._instances

    def close(self) -> None:
        """Free the instances. A unit that crashes meanwhile has done what was asked of it: a warning is logged."""
        for failure in self._freed():
            log.warning("%s", failure)

    def _freed(self) -> list[SimulationError]:
        failures = []
        for instance in self._instances.values():
            try:
                instance.close()
            except SimulationError as error:
                failures.append(error)
        self._instances.clear()
        return failures

    def run(self, experiment: Experiment, progress: Progress | None = None) -> Result:
        """One run, all of it in memory. `progress`: called with (time, stop time) now and then.

        Where a unit asks to stop, the result ends there, with a warning.
        UserError: a name, value or time that is wrong. SimulationError: a unit fails.
        """
        with self._prepared(self._coupled(experiment)) as run:
            table, filled = np.empty((run.clock.rows, len(run.names))), 0
            for first in range(0, run.clock.rows, ROWS_PER_CHUNK):
                filled = first + self._fill(run, first, table[first : first + ROWS_PER_CHUNK], progress)
                if filled < min(first + ROWS_PER_CHUNK, len(table)):
                    break
            return self._result(run, 0, table[:filled])

    def stream(
        self, experiment: Experiment, progress: Progress | None = None, rows_per_chunk: int = ROWS_PER_CHUNK
    ) -> Iterator[Result]:
        """As `run`, in pieces of `rows_per_chunk` that follow one another: memory does not grow with the run.

        Each piece's `energy` is that from the start to the piece's end. Where a unit fails, the rows until then come as
        a last piece, without energy, before SimulationError.
        """
        with self._prepared(self._coupled(experiment)) as run:
            for first in range(0, run.clock.rows, rows_per_chunk):
                rows = np.empty((min(rows_per_chunk, run.clock.rows - first), len(run.names)))
                try:
                    filled = self._fill(run, first, rows, progress)
                except SimulationError:
                    if (done := run.master.rows() - first) > 0:
                        yield self._result(run, first, rows[:done], failed=True)
                    raise
                if filled:
                    yield self._result(run, first, rows[:filled])
                if filled < len(rows):
                    return

    @cached_property
    def is_one_system(self) -> bool:
        """Whether scheme monolithic can run it, and the system asks for no other."""
        if self.system.default_experiment.scheme is not None:
            return False
        try:
            make_plan(self.system, list(self._instances.values()), MONOLITHIC, tuple(self.system.inputs), ())
        except SimulationError:
            return False
        return True

    def energy(self) -> dict[str, tuple[float, float, float]]:
        """Mechanical connection -> (work given, work taken, integral of |power given|) since the run's start, J."""
        return works(self._connections, self._instances, self._measured)

    @contextmanager
    def _prepared(self, e: Experiment) -> Iterator[_Run]:
        """Units initialised, a master over them; `counters` afterwards."""
        scheme = self._scheme(e.scheme)
        clock = make_clock(scheme, e.start_time, e.stop_time, e.step, e.output_step)
        tables, units = self._table(e, scheme, dense=clock.stride > clock.per_row)
        events = [(clock.tick_at(t), self._checked(changes)) for t, changes in e.parameter_events]
        at_start = e.inputs.at(clock.start)
        parameters = check_parameters(self.system, e.parameters)
        initialise(self._order, self._instances, parameters, at_start, clock.start, e.stop_time)
        breaks = self._breaks(scheme, e.inputs, clock)
        master: Master
        if self.engine == "native":
            master = native.Master(tables, scheme, e.inputs, clock, breaks)
        elif scheme.monolithic:
            raise UserError(f"scheme {scheme.name} with engine {self.engine!r} is given, it runs with 'native' alone")
        else:
            master = ReferenceMaster(tables.plan, scheme, e.inputs, clock, breaks)
        try:
            yield _Run(master, scheme, clock, tables.plan.names, units, sorted(events, key=lambda event: event[0]))
            self.counters = master.counters()
        finally:
            master.close()

    def _breaks(self, scheme: Scheme, inputs: Inputs, clock: Clock) -> NDArray[np.int64]:
        """Ticks at which no step may look beyond an input's turn."""
        if scheme.adaptive:
            return turns(inputs, clock)
        if scheme.monolithic:
            jumps = halfway(inputs, clock, discrete_inputs(self.system, inputs.values))
            return np.union1d(turns(inputs, clock, SLIGHT), jumps)
        return np.empty(0, dtype=np.int64)

    def _checked(self, changes: Mapping[str, Value | Feedback]) -> Changes:
        """By component, each allowed while time runs; of a Feedback its value at 0. UserError: one is not."""
        at_zero = {name: x.of(0.0) if isinstance(x, Feedback) else x for name, x in changes.items()}
        found: Changes = {c: dict(own) for c, own in check_parameters(self.system, at_zero, during=True).items()}
        for name, x in changes.items():
            if isinstance(x, Feedback):
                component, parameter = split(self.system, name, "parameters")
                found[component.name][parameter] = self._fed_back(x)
        return found

    def _fed_back(self, x: Feedback) -> Callable[[], float]:
        """Asked for the moment's value. UserError: it goes by a variable that is not there."""
        component, variable = split(self.system, x.variable, "Feedback")
        if variable not in component.unit.variables:
            known = among(component.unit.variables)
            raise UserError(f"Feedback: {x.variable!r} is given, {component.name} has {known}")
        instance = self._instances[component.name]
        return lambda: x.of(instance.get(variable))

    def _coupled(self, e: Experiment) -> Experiment:
        """With scheme and step. Where neither is given and a unit cannot take a step back, the step is estimated."""
        own = self.system.default_experiment
        if e.scheme is not None or own.scheme is not None:
            return e
        if all(i.rolls_back and i.varies_step for i in self._instances.values()):
            return replace(e, scheme=DEFAULT)
        e = replace(e, scheme=WITHOUT_ROLLBACK)
        if e.step is not None:
            return e
        start = replace(e, stop_time=min(e.stop_time, e.start_time + PROBE))
        longest = make_clock(scheme_of(WITHOUT_ROLLBACK), e.start_time, e.stop_time, None, e.output_step).step
        plan = self._table(e, scheme_of(WITHOUT_ROLLBACK), dense=False)[0].plan
        nominal = dict(zip(plan.names, map(plan.nominal_of, plan.recorded), strict=True))
        return replace(e, step=choose_step(lambda step: self.run(replace(start, step=step)), longest, nominal))

    def _scheme(self, scheme: str | Scheme | None) -> Scheme:
        """UserError: there is none of that name."""
        if scheme is not None:
            return scheme_of(scheme)
        own = self.system.default_experiment
        chosen = scheme_of(str(own.scheme))
        return replace(chosen, step=own.step) if own.step else chosen

    def _table(self, e: Experiment, scheme: Scheme, dense: bool) -> tuple[native.Tables, dict[str, str | None]]:
        """The plan and its signals' units, made once for all runs with the same inputs, recorded signals and scheme."""
        driven, wanted = tuple(e.inputs.values), tuple(self.system.outputs if e.record is None else e.record)
        key = (scheme, driven, wanted, dense)
        if key not in self._tables:
            plan = make_plan(self.system, list(self._instances.values()), scheme, driven, wanted, dense)
            self._tables[key] = native.Tables(plan), {name: self.system.unit_of(name) for name in plan.names}
        return self._tables[key]

    def _fill(self, run: _Run, first: int, rows: Rows, progress: Progress | None) -> int:
        """On through the rows from the `first` on, float64[n, recorded signals]: how many there are before a unit asked
        to stop, or all."""
        per_row = run.clock.per_row
        done = 0
        if first == 0:
            self._apply(run.events, 0)
            run.master.begin()
            run.master.record(rows[0])
            done = 1
        end = first + len(rows)
        tick, last_tick = max(0, first - 1) * per_row, (end - 1) * per_row
        while tick < last_tick:
            target = min(last_tick, run.events[0][0]) if run.events else last_tick
            passed = target // per_row - tick // per_row
            if not self._advanced(run, target, rows[done : done + passed]):
                return run.master.tick // per_row + 1 - first
            tick, done = target, done + passed
            if self._apply(run.events, tick):
                run.master.resume()
        if progress:
            progress(
                float(run.clock.times(end - 1, end)[0]), float(run.clock.times(run.clock.rows - 1, run.clock.rows)[0])
            )
        return len(rows)

    def _advanced(self, run: _Run, target: int, rows: Rows) -> bool:
        """False: a unit asked to stop before. SimulationError: it failed."""
        try:
            run.master.advance(target, rows)
        except SimulationError as error:
            stopping = [i.name for i in self._instances.values() if "discard" in str(error) and i.asks_to_stop()]
            if not stopping:
                raise
            t = run.clock.start + run.master.tick * run.clock.step
            log.warning("%s asks to stop at t = %.9g s: the results end there", among(stopping), t)
            return False
        return True

    def _apply(self, events: list[tuple[int, Changes]], tick: int) -> bool:
        """Set what is due."""
        due = False
        while events and events[0][0] <= tick:
            due = True
            _, changes = events.pop(0)
            for component, own in changes.items():
                instance = self._instances[component]
                with instance.explained(f"on setting {among(own)} while time runs"):
                    for name, value in own.items():
                        instance.set(name, value() if callable(value) else value)
        return due

    def _result(self, run: _Run, first: int, rows: Rows, failed: bool = False) -> Result:
        signals = {name: np.ascontiguousarray(rows[:, j]) for j, name in enumerate(run.names)}
        times = run.clock.times(first, first + len(rows))
        self._measured = run.master.works()
        step = run.clock.step * run.clock.stride
        one = run.scheme.monolithic  # a single integrator: no wire has two sides that could differ
        energy = {} if failed or one else self.energy()  # a unit that failed cannot be asked
        return Result(times, signals, energy, run.scheme.name, step, dict(run.units))


def simulate(
    system: System, experiment: Experiment, progress: Progress | None = None, engine: Engine = "native"
) -> Result:
    """Load a system, run it once, free it; see Simulation.run."""
    with Simulation(system, engine) as simulation:
        return simulation.run(experiment, progress)
