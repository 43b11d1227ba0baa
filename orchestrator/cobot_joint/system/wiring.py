"""Wires: do both ends exist, do kinds, types and units fit, has every sink one source; conversion between units."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from fmpy.model_description import BaseUnit

from cobot_joint import paths
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import Component, Connection, Connector, System, Type
from cobot_joint.units import Unit

log = logging.getLogger("cobot_joint")
ADDITIVE = "_add"  # how the name of an additive input ends
CURRENT_MODE = 2  # of `drive.mode`: i_ref = drive.k_i * set value, fmus/motor_bldc/drive.h
EFFORTS = ("kg.m2.s-2", "kg.m.s-2", "kg.m2.s-3.A-1")  # N.m, N, V
EXPONENTS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Endpoint:
    """One end of a wire, as both FMUs and systems offer it."""

    component: str | None
    name: str
    type: Type | None
    is_source: bool
    unit: str | None
    base: BaseUnit | None
    relative: bool = False

    def __str__(self) -> str:
        return self.name if self.component is None else f"{self.component}.{self.name}"


class Wiring:
    """The ends that a system's components and its own connectors offer, to be connected."""

    def __init__(
        self,
        components: Sequence[Component],
        connectors: Iterable[Connector] = (),
        units: Mapping[str, BaseUnit] | None = None,
        where: str = "system",
    ):
        self.where = where
        self.components = {c.name: c for c in components}
        self.connectors = {c.name: c for c in connectors}
        self.units = units or {}

    def connect(
        self,
        start: tuple[str | None, str],
        end: tuple[str | None, str],
        factor: float = 1.0,
        offset: float = 0.0,
        convert: bool = True,
    ) -> Connection:
        """The wire between two ends (component or None for the system, name), in whichever direction their kinds say.

        sink = factor*(source in the sink's unit) + offset; `convert=False` leaves the units alone.
        UserError: an end is missing, both are sources or both sinks, types differ, units do not convert.
        """
        a, b = self.endpoint(*start), self.endpoint(*end)
        if a.is_source == b.is_source:
            kind = "give" if a.is_source else "take"
            raise UserError(f"{self.where}: {a} and {b} are connected, but both {kind} a value: one output, one input")
        source, sink = (a, b) if a.is_source else (b, a)
        if source.type and sink.type and source.type != sink.type:
            raise UserError(f"{self.where}: {source} ({source.type}) is connected to {sink} ({sink.type}): one type")
        scale, shift = conversion(source, sink, self.where) if convert else (1.0, 0.0)
        return Connection(
            source.component, source.name, sink.component, sink.name, factor * scale, factor * shift + offset
        )

    def endpoint(self, component: str | None, name: str) -> Endpoint:
        """The end of that name. UserError: no such component or connector, or it is no input or output."""
        if component is None:
            if name not in self.connectors:
                raise UserError(f"{self.where}: the system has no connector {name!r}, it has {among(self.connectors)}")
            own = self.connectors[name]
            # seen from inside, a system's input gives and its output takes
            return Endpoint(None, name, own.type, own.causality == "input", own.unit, self.units.get(own.unit or ""))
        if component not in self.components:
            raise UserError(f"{self.where}: there is no component {component!r}, there are {among(self.components)}")
        return unit_endpoint(component, self.components[component].unit, name, self.where)


def unit_endpoint(component: str, unit: Unit, name: str, where: str) -> Endpoint:
    """The end that a variable of a unit is."""
    variable = unit.variables.get(name)
    if variable is None or variable.causality not in ("input", "output"):
        ports = [v.name for v in unit.variables.values() if v.causality in ("input", "output")]
        what = "no variable" if variable is None else f"a {variable.causality}"
        raise UserError(
            f"{where}: {component}.{name} is {what} of {unit.path.name}; inputs and outputs: {among(ports)}"
        )
    named = unit.unit_of(name)
    base = unit.units.get(named or "")
    return Endpoint(
        component, name, port_type(variable.type), variable.causality == "output", named, base,
        bool(variable.relativeQuantity),
    )  # fmt: skip


def port_type(fmi_type: str) -> Type | None:
    """Real, Integer (Enumerations travel as such) or Boolean; None: what no wire of ours carries."""
    return {"Real": "Real", "Integer": "Integer", "Enumeration": "Integer", "Boolean": "Boolean"}.get(fmi_type)  # type: ignore[return-value]


def conversion(source: Endpoint, sink: Endpoint, where: str) -> tuple[float, float]:
    """(factor, offset) that carry a value from the source's unit into the sink's. UserError: they do not convert.

    FMI 2.0, 2.2.2: base = factor*value + offset. An end without unit takes any.
    """
    if source.unit is None or sink.unit is None:
        return 1.0, 0.0
    if source.base is None or sink.base is None:
        if source.unit == sink.unit:
            return 1.0, 0.0
        unknown = source if source.base is None else sink
        raise UserError(
            f"{where}: {source} [{source.unit}] is connected to {sink} [{sink.unit}], "
            f"but [{unknown.unit}] is given no BaseUnit, so it cannot be converted"
        )
    a, b = source.base, sink.base
    if any(getattr(a, e) != getattr(b, e) for e in EXPONENTS):
        raise UserError(
            f"{where}: {source} [{source.unit}] is connected to {sink} [{sink.unit}]: "
            f"{spell(a)} does not convert to {spell(b)}"
        )
    factor = a.factor / b.factor
    relative = source.relative or sink.relative
    return factor, 0.0 if relative else (a.offset - b.offset) / b.factor


def spell(base: BaseUnit) -> str:
    """`kg.m2.s-2`"""
    powers = {e: getattr(base, e) for e in EXPONENTS}
    return ".".join(f"{e}{p if p != 1 else ''}" for e, p in powers.items() if p) or "1"


def check(system: System) -> None:
    """Every wire has two ends that exist and fit, and every sink one source. UserError: the first that does not.

    Units were settled when the wires were made (`Wiring.connect`).
    """
    where = str(system.path or system.name)
    names = [c.name for c in system.components]
    if doubled := {name for name in names if names.count(name) > 1}:
        raise UserError(f"{where}: component {among(sorted(doubled))} is there twice, names have to differ")
    if both := set(system.inputs) & set(system.outputs):
        raise UserError(f"{where}: connector {among(sorted(both))} is input and output, names have to differ")
    wiring = Wiring(system.components, [*system.inputs.values(), *system.outputs.values()], where=where)
    feeding: dict[tuple[str | None, str], Connection] = {}
    for connection in system.connections:
        wiring.connect(
            (connection.source_component, connection.source), (connection.sink_component, connection.sink),
            convert=False,
        )  # fmt: skip
        sink = (connection.sink_component, connection.sink)
        if sink in feeding:
            raise UserError(
                f"{where}: two sources feed one sink, only one may: {feeding[sink].name} and {connection.name}"
            )
        feeding[sink] = connection
    if unfed := [name for name in system.outputs if (None, name) not in feeding]:
        raise UserError(f"{where}: output {among(unfed)} of the system is not connected to any component")


def with_inputs(system: System, names: Iterable[str]) -> System:
    """The system with these unwired inputs of its components, `component.variable`, as inputs of its own.

    Other names are left alone. UserError: a wire gives one of them already.
    """
    wires = {(c.sink_component, c.sink): c for c in system.connections}
    inputs, connections = dict(system.inputs), list(system.connections)
    for component in system.components:
        for v in component.unit.variables.values():
            name = f"{component.name}.{v.name}"
            if v.causality != "input" or name not in names or name in inputs:
                continue
            if wire := wires.get((component.name, v.name)):
                source = f"{wire.source_component}.{wire.source}" if wire.source_component else wire.source
                raise UserError(f"{system.path}: {name} is given a column, but {source} is wired to it")
            inputs[name] = Connector(name, "input", v.type, component.unit.unit_of(v.name), v.description or "")
            connections.append(Connection(None, name, component.name, v.name))
    return replace(system, inputs=inputs, connections=tuple(connections))


def unconnected(system: System) -> list[tuple[str, float, str]]:
    """Torques, forces and voltages that nothing gives: (`component.variable`, the value it stays at, its unit).

    Left out are additive inputs, which are there for what is not modelled, and those that the system gives a value.
    """
    fed = {(c.sink_component, c.sink) for c in system.connections}
    return [
        (f"{c.name}.{v.name}", float(v.start or 0.0), c.unit.unit_of(v.name) or "1")
        for c in system.components
        for v in c.unit.variables.values()
        if v.causality == "input" and (c.name, v.name) not in fed and not v.name.endswith(ADDITIVE)
        and v.name not in c.parameters
        and (base := c.unit.units.get(c.unit.unit_of(v.name) or "")) is not None and spell(base) in EFFORTS
    ]  # fmt: skip


def unwired(system: System) -> list[str]:
    """Connectors that a column may have: the system's, and of its components inputs that nothing is wired to and
    outputs that the system does not show under a name of its own; no work, which nobody logs."""
    taken = {(c.sink_component, c.sink) for c in system.connections}
    taken |= {(c.source_component, c.source) for c in system.connections if c.sink_component is None}
    of_components = [
        f"{c.name}.{v.name}"
        for c in system.components
        for v in c.unit.variables.values()
        if v.causality in ("input", "output") and (c.name, v.name) not in taken
        and v.name not in {work for flange in c.unit.flanges for work in (flange.W, flange.W_abs)}
    ]  # fmt: skip
    return [*system.inputs, *system.outputs, *of_components]


def read_by_loops(system: System) -> list[str]:
    """`component.variable` of what position loops read, wired or not: a record of it, fed in as well, is read twice."""
    loops = [c for c in system.components if {"phi_ref", "s_ref"} <= c.unit.variables.keys()]
    return [f"{c.name}.{name}" for c in loops for name in ("phi", "w", "s", "v") if name in c.unit.variables]


def driving(system: System) -> list[str]:
    """Torques, `component.variable`, at shaft ends where a machine is driven and that nothing is wired to."""
    free = unwired(system)
    ends = [
        f"{c.name}.{flange.tau}"
        for c in system.components
        for flange in c.unit.flanges
        if flange.role == "takes" and c.unit.variables[flange.tau].causality == "input"
    ]
    return [name for name in ends if name in free]


def warn_of_unconnected(system: System) -> None:
    """A line for each of them, before anything runs. Shipped systems are as they are meant."""
    if system.path is None or system.path.parent == paths.folder("systems"):
        return
    for name, value, unit in unconnected(system):
        log.warning("%s: %s is not connected and stays at %g %s", system.path, name, value, unit)


def shown_by(system: System) -> dict[str, str]:
    """Output of the system -> `component.variable` that it shows as it is."""
    plain = (w for w in system.connections if w.sink_component is None and (w.factor, w.offset) == (1.0, 0.0))
    return {w.sink: f"{w.source_component}.{w.source}" for w in plain if w.source_component is not None}
