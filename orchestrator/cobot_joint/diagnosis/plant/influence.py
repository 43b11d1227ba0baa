"""Which signals of a system depend on which others, as wires and the units' ModelStructure say."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from cobot_joint.system.model import System

Influences = Mapping[str, frozenset[str]]


def influences(system: System) -> dict[str, frozenset[str]]:
    """Output of a unit (`component.variable`) or of the system -> outputs of units and inputs of the system behind it.

    One step: what its unit computes it from, through the wires at the unit's inputs.
    """
    source = {(c.sink_component, c.sink): _name(c.source_component, c.source) for c in system.connections}
    found = {name: frozenset({source[None, name]}) for name in system.outputs if (None, name) in source}
    for component in system.components:
        for output, needed in component.unit.needs.items():
            wired = (source.get((component.name, name)) for name in needed)
            found[f"{component.name}.{output}"] = frozenset(name for name in wired if name)
    return found


def behind(names: Collection[str], behind_one: Influences, known: Collection[str] = ()) -> set[str]:
    """`names` and everything that they depend on; what lies behind a `known` signal is not looked for."""
    found, left = set(names), list(names)
    while left:
        new = behind_one.get(left.pop(), frozenset()) - found
        found |= new
        left += [name for name in new if name not in known]
    return found


def _name(component: str | None, variable: str) -> str:
    return variable if component is None else f"{component}.{variable}"
