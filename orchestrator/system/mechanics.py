"""Shafts between units: which flange is wired to which, so that the work through both can be compared."""

from __future__ import annotations

from dataclasses import dataclass

from orchestrator.system.model import System


@dataclass(frozen=True)
class Shaft:
    """A mechanical connection, and the variables (component, name) in which each side integrates its work."""

    name: str
    given: tuple[str, str]
    taken: tuple[str, str]
    absolute: tuple[str, str]


def shafts(system: System) -> tuple[Shaft, ...]:
    """Pairs of a flange that gives and one that takes, with both speed and torque wired. From vendor annotations."""
    wires = {
        frozenset({(c.source_component, c.source), (c.sink_component, c.sink)})
        for c in system.connections
        if c.source_component and c.sink_component
    }
    found = []
    for giver in system.components:
        for taker in system.components:
            for g in (f for f in giver.unit.flanges if f.role == "gives"):
                for t in (f for f in taker.unit.flanges if f.role == "takes"):
                    ends = [((giver.name, a), (taker.name, b)) for a, b in ((g.w, t.w), (g.tau, t.tau))]
                    if all(frozenset(pair) in wires for pair in ends):
                        name = f"{giver.name}.{g.name} -> {taker.name}.{t.name}"
                        found.append(Shaft(name, (giver.name, g.W), (taker.name, t.W), (giver.name, g.W_abs)))
    return tuple(found)
