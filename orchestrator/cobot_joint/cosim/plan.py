"""A system as index tables: what the master's loop works on, natively and in the Python reference alike.

Signals are numbered: first the outputs of all units, unit by unit (those that drive inputs before those that are only
recorded; Real, Integer, Boolean within each), then the system's own inputs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter

from fmpy.model_description import ModelVariable

from cobot_joint.cosim.energy import MechanicalConnection, Port, mechanical_connections, unmeasured
from cobot_joint.cosim.instances import Instance, SimulationError
from cobot_joint.cosim.schemes import Scheme
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import Connection, System
from cobot_joint.units import TOOL

TYPES = ("Real", "Integer", "Boolean")
MOST_STATES = 64  # cosim/monolithic/linear.h
STAIRS = 8  # parts of a step, for units that hold their inputs over each
Source = tuple[str | None, str]  # component, variable
Columns = list[list[ModelVariable]]  # by type, in TYPES' order


@dataclass(frozen=True)
class Wire:
    """value = factor*signal + offset"""

    signal: int
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Flow:
    """Work through two flanges that are wired together: signals of what is given and taken, J; nominal power, W."""

    given: int
    taken: int
    power: float


@dataclass(frozen=True)
class PlannedPort:
    """Where the master integrates work: of a unit by number, its Real input by number, and the signal of its output."""

    unit: int
    input: int
    output: int


@dataclass(frozen=True)
class PlannedUnit:
    """One unit's variables by value reference, in TYPES' order, and where its inputs come from.

    `input_order`: 3: follows cubics, 1: follows lines, 0: sees constants over a step; these are the value at the step's
    end where `holds_end`, else at its middle. `stairs`: a step is made of that many parts with a constant each, and a
    short last one; 0: of one. `is_sink`: no other unit reads it, so that it is stepped once, from row
    to row, when a step is final, and its state is never saved (only units of ours: they discard no step).
    """

    instance: Instance
    first_signal: int
    inputs: tuple[tuple[int, ...], ...]
    wires: tuple[Wire, ...]
    outputs: tuple[tuple[int, ...], ...]
    watched: tuple[tuple[int, ...], ...]
    input_order: int
    holds_end: bool
    stairs: int
    output_derivatives: bool
    is_sink: bool

    @property
    def n_outputs(self) -> int:
        return sum(map(len, self.outputs))

    @property
    def n_signals(self) -> int:
        return self.n_outputs + sum(map(len, self.watched))


@dataclass(frozen=True)
class Plan:
    """Everything of a run that does not change between runs with the same inputs and the same recorded signals."""

    units: tuple[PlannedUnit, ...]
    n_outputs: int
    inputs: tuple[str, ...]
    nominal: tuple[float, ...]
    judged: tuple[bool, ...]
    flows: tuple[Flow, ...]
    ports: tuple[PlannedPort, ...]
    recorded: tuple[Wire, ...]
    names: tuple[str, ...]
    order: tuple[int, ...] = ()  # monolithic: of the units that are one system, so that each finds its inputs known

    def nominal_of(self, wire: Wire) -> float:
        """Size of what a wire carries; of an input of the system, which nobody judges, 1."""
        return abs(wire.factor) * (self.nominal[wire.signal] if wire.signal < self.n_outputs else 1.0)


def make_plan(
    system: System,
    instances: Sequence[Instance],
    scheme: Scheme,
    inputs: Sequence[str],
    record: Sequence[str],
    dense: bool = False,
) -> Plan:
    """`inputs`: the system's inputs that have samples; `record`: names as in Result.signals: the system's outputs and
    inputs, and `component.variable`. `dense`: rows inside of steps are recorded, so all signals are followed.

    UserError: a name that the system does not have. SimulationError: the scheme needs what a unit cannot do.
    """
    for name in inputs:
        if name not in system.inputs:
            raise UserError(f"input {name!r} is given, {system.name} has {among(system.inputs)}")
    driven = [c for c in system.connections if c.sink_component and (c.source_component or c.source in inputs)]
    taps = {name: _tap(system, name, inputs) for name in record}
    tapped = {(c.source_component, c.source) for c in taps.values() if c}
    connections = mechanical_connections(system)
    shafts = [c for c in connections if c.annotated] if scheme.adaptive else []
    turned: set[Source] = {(p.component, str(p.W)) for s in shafts for p in (s.gives, s.takes)}
    sinks = _sinks(driven, turned, instances) if scheme.rolls_back or scheme.monolithic else set()
    driven = [c for c in driven if c.sink_component not in sinks or _matters(c, tapped, instances)]
    read = {(c.source_component, c.source) for c in driven} | turned
    if dense:
        read |= {(name, variable) for name, variable in tapped if name not in sinks}
    watched = tapped - read

    columns = [(_columns(instance, read), _columns(instance, watched)) for instance in instances]
    numbers = _numbers(instances, columns, inputs)
    units = tuple(
        _plan_unit(
            instance,
            *own,
            [c for c in driven if c.sink_component == instance.name],
            numbers,
            instance.name in sinks,
            scheme,
        )
        for instance, own in zip(instances, columns, strict=True)
    )
    _check_abilities(scheme, instances)
    variables = [v for own in columns for part in own for v in _flat(part)]
    return Plan(
        units=units,
        n_outputs=len(variables),
        inputs=tuple(inputs),
        nominal=tuple(abs(float(v.nominal or 1.0)) if v.type == "Real" else 1.0 for v in variables),
        judged=_judged(units, len(variables), scheme),
        flows=tuple(_flow(system, shaft, numbers) for shaft in shafts),
        ports=tuple(_port(port, units, numbers) for port in unmeasured(connections)),
        recorded=tuple(Wire(numbers[c.source_component, c.source], c.factor, c.offset) for c in taps.values() if c),
        names=tuple(name for name, c in taps.items() if c),
        order=_order(driven, sinks, instances) if scheme.monolithic else (),
    )


def _numbers(
    instances: Sequence[Instance],
    columns: Sequence[tuple[Columns, Columns]],
    inputs: Sequence[str],
) -> dict[Source, int]:
    """(component or None for the system, variable) -> number of the signal"""
    numbers: dict[Source, int] = {}
    for instance, own in zip(instances, columns, strict=True):
        for variable in [v for part in own for v in _flat(part)]:
            numbers[instance.name, variable.name] = len(numbers)
    for name in inputs:
        numbers[None, name] = len(numbers)
    return numbers


def _tap(system: System, name: str, inputs: Sequence[str]) -> Connection | None:
    """Where a recorded signal comes from; None for an input of the system that nothing drives."""
    if name in system.inputs:
        return Connection(None, name, None, name) if name in inputs else None
    for connection in system.connections:
        if connection.sink_component is None and connection.sink == name:
            return connection if connection.source_component or connection.source in inputs else None
    owner, _, variable = name.partition(".")
    component = next((c for c in system.components if c.name == owner), None)
    if component and variable in component.unit.variables:
        return Connection(owner, variable, None, name)
    if component:
        raise UserError(f"{name!r} is to be recorded, {owner} has {among(component.unit.variables, 200)}")
    raise UserError(f"{name!r} is to be recorded, {system.name} has {among([*system.outputs, *system.inputs])}")


def _columns(instance: Instance, wanted: set[Source]) -> Columns:
    found = [v for name, v in instance.variables.items() if (instance.name, name) in wanted]
    for variable in found:
        if variable.type not in (*TYPES, "Enumeration"):
            raise UserError(
                f"{instance.name}.{variable.name} is a {variable.type}: only numbers are passed on and recorded"
            )
    return [[v for v in found if _kind(v) == kind] for kind in TYPES]


def _kind(variable: ModelVariable) -> str:
    return "Integer" if variable.type == "Enumeration" else str(variable.type)


def _flat(columns: Columns) -> list[ModelVariable]:
    return [variable for column in columns for variable in column]


def _plan_unit(
    instance: Instance,
    outputs: Columns,
    watched: Columns,
    driven: list[Connection],
    numbers: Mapping[Source, int],
    is_sink: bool,
    scheme: Scheme,
) -> PlannedUnit:
    kinds = {c.sink: _kind(instance.variables[c.sink]) for c in driven}
    ordered = [[c for c in driven if kinds[c.sink] == kind] for kind in TYPES]
    return PlannedUnit(
        instance=instance,
        first_signal=min((numbers[instance.name, v.name] for v in _flat([*outputs, *watched])), default=0),
        inputs=tuple(tuple(instance.variables[c.sink].valueReference for c in column) for column in ordered),
        wires=tuple(
            Wire(numbers[c.source_component, c.source], c.factor, c.offset) for column in ordered for c in column
        ),
        outputs=tuple(tuple(v.valueReference for v in column) for column in outputs),
        watched=tuple(tuple(v.valueReference for v in column) for column in watched),
        input_order=0 if scheme.holds else _input_order(instance),
        holds_end=_is_static(instance),
        stairs=STAIRS if _climbs(instance) else 0,
        output_derivatives=instance.gives_slopes and instance.interpolates,  # else slopes know nothing of the inputs'
        is_sink=is_sink,
    )


def discrete_inputs(system: System, names: Iterable[str]) -> list[str]:
    """Those of a system's inputs that drive Integers or Booleans."""
    driven = {
        c.source
        for c in system.connections
        if c.source_component is None
        and c.sink_component is not None
        and _kind(system.component(c.sink_component).unit.variables[c.sink]) != "Real"
    }
    return [name for name in names if name in driven]


def _order(driven: Sequence[Connection], sinks: set[str], instances: Sequence[Instance]) -> tuple[int, ...]:
    """Units by number, so that outputs which are no states are known before they are needed.

    A unit of which somebody needs such an output before its own inputs are known comes twice, first among all; the
    output then depends on states and the system's inputs alone.
    SimulationError: a unit has no vector field, gives another what is no Real, or they wait for each other.
    """
    names = [i.name for i in instances]
    needs: dict[str, set[str]] = {i.name: set() for i in instances if i.name not in sinks}
    for instance in instances:
        if instance.name in needs and not instance.field:
            raise SimulationError(f"scheme monolithic needs units of ours, in this process: {instance.name} is none")
    if (states := sum(len(i.component.unit.states) for i in instances if i.name in needs)) > MOST_STATES:
        raise SimulationError(f"scheme monolithic has room for {MOST_STATES} states, the units have {states}")
    from_units = {(c.sink_component, c.sink) for c in driven if c.source_component}
    early: list[tuple[str, str]] = []
    for wire in driven:
        sink, source = str(wire.sink_component), wire.source_component
        if sink not in needs or source is None:
            continue
        unit = instances[names.index(source)].component.unit
        if _kind(unit.variables[wire.source]) != "Real":
            raise SimulationError(f"scheme monolithic passes on Reals from unit to unit: {wire.name} is none")
        if wire.source in unit.states:
            continue
        if any((source, name) in from_units for name in unit.feeds_through(wire.source)):
            needs[sink].add(source)
        else:
            early.append((source, sink))
    try:
        order = list(TopologicalSorter(needs).static_order())
    except CycleError as error:
        raise SimulationError(f"scheme monolithic: {among(error.args[1])} wait for each other's outputs") from error
    first = dict.fromkeys(source for source, sink in early if order.index(source) >= order.index(sink))
    return tuple(names.index(name) for name in (*first, *order))


def _sinks(driven: Sequence[Connection], turned: set[Source], instances: Sequence[Instance]) -> set[str]:
    """Units of ours that others drive and none reads."""
    read = {c.source_component for c in driven} | {name for name, _ in turned}
    followers = {c.sink_component for c in driven if c.source_component}
    return {i.name for i in instances if i.name in followers - read and _is_ours(i)}


def _matters(wire: Connection, tapped: set[Source], instances: Sequence[Instance]) -> bool:
    """Whether anything that is recorded of a sink depends on this wire into it."""
    unit = next(i.component.unit for i in instances if i.name == wire.sink_component)
    wanted = [variable for name, variable in tapped if name == wire.sink_component]
    return any(wire.sink in unit.needs.get(variable, [wire.sink]) for variable in wanted)


def _is_ours(instance: Instance) -> bool:
    return TOOL in (instance.description.generationTool or "")


def _input_order(instance: Instance) -> int:
    """Our units follow cubics; FMI 2.0 does not let others say how far they go, so they get lines."""
    if not instance.interpolates:
        return 0
    return 3 if _is_ours(instance) else 1


def _climbs(instance: Instance) -> bool:
    """Holds its inputs, has states, and may be stepped in parts."""
    return not instance.interpolates and not _is_static(instance) and instance.varies_step


def _is_static(instance: Instance) -> bool:
    """Outputs follow inputs through nothing that has a state: they need the inputs at a step's end, not its middle."""
    feeds_through = any(output.dependencies for output in instance.description.outputs)
    return feeds_through and not instance.component.unit.states


def _judged(units: tuple[PlannedUnit, ...], n_outputs: int, scheme: Scheme) -> tuple[bool, ...]:
    """Signals that a unit reads before their own unit has stepped; where steps adapt, all that are read."""
    owner = [i for i, unit in enumerate(units) for _ in range(unit.n_signals)]
    judged = [False] * n_outputs
    for reader, unit in enumerate(units):
        for wire in unit.wires:
            if wire.signal < n_outputs and (not scheme.sequential or owner[wire.signal] >= reader):
                judged[wire.signal] = True
    return tuple(judged)


def _flow(system: System, shaft: MechanicalConnection, numbers: Mapping[Source, int]) -> Flow:
    gives, takes = shaft.gives, shaft.takes
    variables = system.component(gives.component).unit.variables
    nominal = [float(variables[v].nominal or 1.0) for v in (gives.flow, gives.effort)]
    given, taken = (numbers[p.component, str(p.W)] for p in (gives, takes))
    return Flow(given, taken, abs(nominal[0] * nominal[1]))


def _port(port: Port, units: Sequence[PlannedUnit], numbers: Mapping[Source, int]) -> PlannedPort:
    """Of effort and flow, one is an input of the unit and one an output."""
    k, unit = next((k, u) for k, u in enumerate(units) if u.instance.name == port.component)
    variables = unit.instance.variables
    inward, outward = sorted((port.effort, port.flow), key=lambda name: variables[name].causality != "input")
    place = unit.inputs[0].index(variables[inward].valueReference)
    return PlannedPort(k, place, numbers[port.component, outward])


def _check_abilities(scheme: Scheme, instances: Sequence[Instance]) -> None:
    unable = [i.name for i in instances if not i.rolls_back] if scheme.rolls_back else []
    if unable:
        raise SimulationError(f"scheme {scheme.name} rolls back, but {among(unable)} cannot get and set the FMU state")
    if scheme.adaptive:
        unable = [i.name for i in instances if not i.varies_step]
        if unable:
            raise SimulationError(f"scheme {scheme.name} varies its step, but {among(unable)} cannot")
