"""Initial values along the wires: an output is read once all it depends on is set (FMI 2.0, 2.2.8: InitialUnknowns)."""

from __future__ import annotations

from collections.abc import Sequence
from graphlib import TopologicalSorter

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
    before = [_reached(needs, k) for k in range(len(wires))]
    # wires that need one another are a loop, known by the first of them
    loop = [min({k} | {n for n in before[k] if k in before[n]}) for k in range(len(wires))]
    order = TopologicalSorter({label: set() for label in loop})
    for k, direct in enumerate(needs):
        order.add(loop[k], *(loop[n] for n in direct if loop[n] != loop[k]))
    return tuple(tuple(w for k, w in enumerate(wires) if loop[k] == label) for label in order.static_order())


def _reached(needs: Sequence[set[int]], k: int) -> set[int]:
    """All that k needs, directly or through others."""
    found: set[int] = set()
    todo = [k]
    while todo:
        new = needs[todo.pop()] - found
        found |= new
        todo += new
    return found


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
