"""A plant made of FMUs: candidates read from their annotations, runs by the native master."""

from __future__ import annotations

import queue
import re
import threading
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import Simulation
from cobot_joint.cosim.instances import UnitEndedError
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.given_ranges import Ranges, with_ranges
from cobot_joint.diagnosis.plant.plant import (
    ANY_ORDER,
    SPEEDS,
    Courses,
    Parameter,
    Port,
    ScannedShape,
    Signals,
    SimulationError,
    TermCandidate,
)
from cobot_joint.diagnosis.plant.simulator import run_beside, setting_in
from cobot_joint.system.model import Component, Connection, Connector, System
from cobot_joint.system.wiring import ADDITIVE, CURRENT_MODE
from cobot_joint.units import Shape, Term, Unit

MOTION, LOADS = ("rad", "rad/s", "m", "m/s"), ("N.m", "N", "A")  # units of measure


@dataclass
class Crash:
    """Runs in which a unit's process ended in the same way: what was said of the first, and what was set in it."""

    said: str
    values: dict[str, float]
    runs: int = 0

    def __str__(self) -> str:
        values = ", ".join(f"{name} = {x:.6g}" for name, x in self.values.items())
        first = f", the first with {values}" if values else ""
        return f"{self.said}: {self.runs} runs with it are passed over{first}"


class FmuPlant:
    """Systems by set-up, loaded once per worker thread. A context manager. ranges: of scanned shapes."""

    def __init__(self, systems: Mapping[str, System], ranges: Ranges | None = None) -> None:
        components = {c.name: c for system in systems.values() for c in system.components}
        self.systems = {setup: _with_ports(system) for setup, system in systems.items()}
        self._bare = dict(systems)  # an input costs time even while nothing enters there
        self._there = {setup: {c.name for c in system.components} for setup, system in systems.items()}
        self.parameters = {p.name: p for c in components.values() for p in _parameters(c)}
        self.terms = with_ranges([t for c in components.values() for t in _terms(c)], ranges or {})
        offered = {name for system in self.systems.values() for name in system.inputs}
        self.ports = tuple(p for c in components.values() for p in _ports(c) if p.name in offered)
        self.inputs = tuple(_inputs(systems))
        self._connectors = {port.name: port.connector for port in self.inputs}
        self._idle: dict[tuple[str, bool], queue.LifoQueue[Simulation]] = {
            (setup, ports): queue.LifoQueue() for setup in systems for ports in (False, True)
        }
        self._all: list[Simulation] = []
        self.crashes: dict[tuple[str, str], Crash] = {}  # by component and what became of which call
        self._noting = threading.Lock()
        self._turn, self._workers, self._closed = threading.Condition(), 0, False

    def __enter__(self) -> FmuPlant:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _value: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Once nobody is at work: an interruption may have left threads that step these units."""
        with self._turn:
            self._closed = True
            self._turn.wait_for(lambda: self._workers == 0)
        for simulation in self._all:
            simulation.close()
        self._all.clear()

    def has(self, name: str, recording: Recording) -> bool:
        """Whether the set-up of that recording has this component, or the component of this parameter or port."""
        return name.split(".")[0] in self._there[recording.setup]

    def simulate(
        self,
        values: Mapping[str, float],
        recording: Recording,
        *,
        onsets: Mapping[str, float] | None = None,
        added: Mapping[str, NDArray[np.float64]] | None = None,
        signals: Sequence[str] = (),
        courses: Courses | None = None,
    ) -> Signals:
        """See Plant.simulate."""
        added = {self._connectors.get(port, port): x for port, x in (added or {}).items()}
        start, late = setting_in(values, onsets)
        with self._simulation(recording.setup, bool(added)) as simulation:
            try:
                return run_beside(
                    simulation,
                    recording,
                    start,
                    courses={**late, **(courses or {})},
                    added=added,
                    record=[*recording.outputs, *signals],
                )
            except SimulationError as error:
                if isinstance(error, UnitEndedError):
                    self._note(error, values)
                raise SimulationError(f"{error}; in {recording.name}") from error

    def _note(self, error: UnitEndedError, values: Mapping[str, float]) -> None:
        with self._noting:
            crash = self.crashes.setdefault((error.component, error.how), Crash(str(error), self._changed(values)))
            crash.runs += 1

    def _changed(self, values: Mapping[str, float]) -> dict[str, float]:
        """What is not as the system has it."""
        return {n: x for n, x in values.items() if n not in self.parameters or x != self.parameters[n].nominal}

    @contextmanager
    def _at_work(self) -> Iterator[None]:
        """SimulationError: the plant is closed."""
        with self._turn:
            if self._closed:
                raise SimulationError("the simulation is over")
            self._workers += 1
        try:
            yield
        finally:
            with self._turn:
                self._workers -= 1
                self._turn.notify_all()

    @contextmanager
    def _simulation(self, setup: str, ports: bool) -> Iterator[Simulation]:
        """One that no other thread uses. ports: with the additive ones as inputs."""
        idle = self._idle[setup, ports]
        with self._at_work():
            try:
                simulation = idle.get_nowait()
            except queue.Empty:
                simulation = Simulation((self.systems if ports else self._bare)[setup])
                self._all.append(simulation)
            try:
                yield simulation
            finally:
                idle.put(simulation)


def _inputs(systems: Mapping[str, System]) -> Iterator[Port]:
    """Every set-up's inputs that are 0 while nobody uses them, each once."""
    known = set()
    for system in systems.values():
        for wire in system.connections:
            name = f"{wire.sink_component}.{wire.sink}"
            if wire.source_component is not None or wire.sink_component is None or name in known:
                continue
            unit = system.component(wire.sink_component).unit
            if unit.variables[wire.sink].type == "Real" and not float(unit.variables[wire.sink].start or 0.0):
                known.add(name)
                yield Port(name, unit.unit_of(wire.sink) or "1", (), connector=wire.source)


def _with_ports(system: System) -> System:
    """The system with its unwired additive inputs as inputs of its own, under `component.variable`."""
    wired = {(c.sink_component, c.sink) for c in system.connections}
    inputs, connections = dict(system.inputs), list(system.connections)
    for component in system.components:
        for port in _ports(component):
            variable = port.name.split(".", 1)[1]
            if (component.name, variable) not in wired:
                inputs[port.name] = Connector(port.name, "input", unit=port.unit)
                connections.append(Connection(None, port.name, component.name, variable))
    return replace(system, inputs=inputs, connections=tuple(connections))


def _parameters(component: Component) -> list[Parameter]:
    unit = component.unit
    found = []
    for name, variable in unit.variables.items():
        if variable.causality == "parameter" and variable.type == "Real":
            lower, upper = unit.bounds_of(name)
            nominal = component.parameters.get(name, variable.start)
            found.append(
                Parameter(
                    f"{component.name}.{name}",
                    float(nominal or 0.0),
                    unit.unit_of(name) or "1",
                    -np.inf if lower is None else lower,
                    np.inf if upper is None else upper,
                )
            )
    return found


def _terms(component: Component) -> list[TermCandidate]:
    return [found for term in component.unit.terms if (found := _term(component, term)) is not None]


def _term(component: Component, term: Term) -> TermCandidate | None:
    """None: it has no amplitude, or the system uses it already."""
    unit, amplitude = component.unit, term.amplitude
    if amplitude is None:
        return None
    start = component.parameters.get(amplitude, unit.variables[amplitude].start)
    if float(start or 0.0) != term.neutral:
        return None
    lower, upper = unit.bounds_of(amplitude)
    phases = [shape for shape in term.shapes if shape.scan == "phase"]
    angle, turns = _angle(component, term)
    return TermCandidate(
        name=f"{component.name}.{term.name}",
        amplitude=f"{component.name}.{amplitude}",
        neutral=term.neutral,
        lower=-np.inf if lower is None else lower,
        upper=np.inf if upper is None else upper,
        unit=unit.unit_of(amplitude) or "1",
        shapes=tuple(_shape(component.name, unit, shape) for shape in term.shapes if shape.scan != "phase"),
        phase=f"{component.name}.{phases[0].name}" if phases else None,
        angle=angle,
        turns=turns,
        compensated=component.parameters.get("drive.mode") == CURRENT_MODE and unit.unit_of(amplitude) in ("V", "Ohm"),
    )


def _angle(component: Component, term: Term) -> tuple[str | None, float]:
    """(the shaft's angle that a wave goes by, periods per turn where its equation has a number), by its equation, as in
    sin(n*phi + phi_0); (None, 1): it has no phase that may change on the way, or no angle that the unit shows."""
    phase, unit = next((s.name for s in term.shapes if s.scan == "phase"), None), component.unit
    if phase is None or unit.variables[phase].variability != "tunable":  # it has to change while time runs
        return None, 1.0
    told = re.search(rf"(?:(\w+)\*)?(\w+) \+ {phase.rsplit('.', 1)[-1]}\b", term.equation)
    name = told[2] if told else ""
    shown = name in unit.variables and unit.variables[name].causality in ("input", "output")
    if told is None or not shown or unit.unit_of(name) != "rad":
        return None, 1.0
    return f"{component.name}.{name}", float(told[1]) if told[1] and told[1].isdigit() else 1.0


def _shape(component: str, unit: Unit, shape: Shape) -> ScannedShape:
    lower, upper = unit.bounds_of(shape.name)
    whole = shape.scan == "order"
    if whole:
        values = np.arange(np.ceil(shape.min), np.floor(shape.max) + 1)
    elif shape.scan == "log":
        values = np.geomspace(shape.min, shape.max, shape.points)
    else:
        values = np.linspace(shape.min, shape.max, shape.points)
    # a fit may leave the scanned range, by as much again; any order, as far as the unit takes it
    reach = np.inf if whole and len(values) >= ANY_ORDER else shape.max - shape.min
    outer = (shape.min / 30, shape.max * 30) if shape.scan == "log" else (shape.min - reach, shape.max + reach)
    return ScannedShape(
        name=f"{component}.{shape.name}",
        values=tuple(float(v) for v in values),
        lower=max(outer[0], -np.inf if lower is None else lower),
        upper=min(outer[1], np.inf if upper is None else upper),
        unit=unit.unit_of(shape.name) or "1",
        logarithmic=shape.scan == "log",
        whole=whole,
    )


def _ports(component: Component) -> list[Port]:
    """Additive inputs; the signals of a port are the unit's own motion, torque and current. A load that the port shows
    in at once is none of an effect there: it would depend on itself."""
    unit = component.unit

    def own(kinds: Collection[str], causalities: Collection[str] = ("input", "output")) -> list[str]:
        """Names of the signals in these units of measure."""
        return [
            name
            for name, variable in unit.variables.items()
            if variable.causality in causalities
            and variable.type == "Real"
            and unit.unit_of(name) in kinds
            and not name.endswith(ADDITIVE)
        ]

    def full(names: Iterable[str]) -> tuple[str, ...]:
        return tuple(f"{component.name}.{name}" for name in names)

    outside = {flange.tau for flange in unit.flanges}
    loads = sorted(own(LOADS), key=lambda n: (n in outside, unit.variables[n].causality == "input"))
    signals, angles = full(own((*MOTION, *LOADS, "V"))), full(own(("rad",)))
    voltages, speeds = full(own(("V",), ("input",))), full(own(SPEEDS))
    at_once = {n: unit.feeds_through(n) for n in loads if unit.variables[n].causality == "output"}

    def port(name: str) -> Port:
        others = full(n for n in loads if name not in at_once.get(n, ()))
        measure = unit.unit_of(name) or "1"
        return Port(f"{component.name}.{name}", measure, signals, angles, "", others, voltages, speeds)

    return [
        port(name)
        for name, variable in unit.variables.items()
        if variable.causality == "input" and variable.type == "Real" and name.endswith(ADDITIVE)
    ]
