"""Initial values along the wires: an output is read once all it depends on is set (FMI 2.0, 2.2.8: InitialUnknowns)."""

from __future__ import annotations

from collections.abc import Mapping
from graphlib import TopologicalSorter

import numpy as np
from fmpy.fmi2 import FMU2Slave
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from orchestrator.errors import UserError
from orchestrator.system.model import Component, Connection, System

SWEEPS = 100
TOLERANCE = 1e-12  # relative change of a value in a loop that counts as settled


def initial_order(system: System) -> tuple[tuple[Connection, ...], ...]:
    """Wires between components and from the system's inputs, in the order in which to pass initial values on.

    Each group can be passed after those before it; a group of more than one wire is an algebraic loop, to be iterated.
    """
    wires = [c for c in system.connections if c.sink_component is not None]
    into: dict[tuple[str | None, str], int] = {(c.sink_component, c.sink): k for k, c in enumerate(wires)}
    needs = [
        {into[(c.source_component, name)] for name in _dependencies(system, c) if (c.source_component, name) in into}
        for c in wires
    ]
    pairs = [(k, n) for k, before in enumerate(needs) for n in before]
    rows, columns = ([p[0] for p in pairs], [p[1] for p in pairs]) if pairs else ([], [])
    graph = coo_array((np.ones(len(pairs)), (rows, columns)), shape=(len(wires), len(wires)))
    _, loop = connected_components(graph, connection="strong") if wires else (0, [])
    order = TopologicalSorter({label: set() for label in loop})
    for k, n in pairs:
        if loop[k] != loop[n]:
            order.add(loop[k], loop[n])
    return tuple(tuple(w for k, w in enumerate(wires) if loop[k] == label) for label in order.static_order())


def propagate_initial_values(
    system: System, instances: Mapping[str, FMU2Slave], inputs: Mapping[str, float] | None = None
) -> None:
    """Pass initial values on while all instances (component -> FMPy instance) are in initialisation mode.

    `inputs`: values of the system's inputs at the start; wires from inputs that are not named pass nothing on.
    UserError: a loop of outputs that depend on each other does not settle.
    """
    given = inputs or {}
    for group in initial_order(system):
        wires = [c for c in group if c.source_component is not None or c.source in given]
        for _ in range(SWEEPS):
            changes = [_pass_on(system, c, instances, given) for c in wires]
            if len(group) == 1 or not any(changes):
                break
        else:
            names = ", ".join(c.name for c in group)
            raise UserError(f"{system.name}: the initial values of this algebraic loop do not settle: {names}")


def read(instance: FMU2Slave, component: Component, name: str) -> float:
    """The value of a Real, Integer, Enumeration or Boolean variable, as a number."""
    variable = component.unit.variables[name]
    get = {"Real": instance.getReal, "Boolean": instance.getBoolean}.get(variable.type, instance.getInteger)
    return float(get([variable.valueReference])[0])


def write(instance: FMU2Slave, component: Component, name: str, value: float) -> None:
    """Set a Real, Integer, Enumeration or Boolean variable from a number."""
    variable = component.unit.variables[name]
    if variable.type == "Real":
        instance.setReal([variable.valueReference], [value])
    elif variable.type == "Boolean":
        instance.setBoolean([variable.valueReference], [bool(value)])
    else:
        instance.setInteger([variable.valueReference], [int(value)])


def _pass_on(system: System, c: Connection, instances: Mapping[str, FMU2Slave], given: Mapping[str, float]) -> bool:
    """Has the sink's value changed?"""
    assert c.sink_component is not None
    if c.source_component is None:
        value = given[c.source]
    else:
        value = read(instances[c.source_component], system.component(c.source_component), c.source)
    value = c.factor * value + c.offset
    sink, instance = system.component(c.sink_component), instances[c.sink_component]
    before = read(instance, sink, c.sink)
    write(instance, sink, c.sink, value)
    return abs(value - before) > TOLERANCE * max(1.0, abs(value))


def _dependencies(system: System, connection: Connection) -> list[str]:
    """Inputs of a component that the source of a wire from it depends on at the start."""
    if connection.source_component is None:
        return []
    unit = system.component(connection.source_component).unit
    for unknown in unit.description.initialUnknowns:
        if unknown.variable is not None and unknown.variable.name == connection.source:
            if unknown.dependencies is None:  # nothing said: on all of them
                return [v.name for v in unit.variables.values() if v.causality == "input"]
            return [v.name for v in unknown.dependencies]
    return []  # not an unknown: it starts at its start value
