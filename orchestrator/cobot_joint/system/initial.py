"""Initial values along the wires: an output is read once all it depends on is set (FMI 2.0, 2.2.8: InitialUnknowns)."""

from __future__ import annotations

from graphlib import TopologicalSorter

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cobot_joint.system.model import Connection, System


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
