"""Energy that crosses mechanical connections, from the work that each unit integrates at its own flange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cobot_joint.cosim.instances import Instance
from cobot_joint.system.model import System
from cobot_joint.units import Flange


@dataclass(frozen=True)
class MechanicalConnection:
    """Two flanges whose speeds are wired together."""

    giver: str
    gives: Flange
    taker: str
    takes: Flange

    @property
    def name(self) -> str:
        """`motor.shaft -> gear.input`"""
        return f"{self.giver}.{self.gives.name} -> {self.taker}.{self.takes.name}"


def mechanical_connections(system: System) -> list[MechanicalConnection]:
    """Every pair of a giving and a taking flange between which a speed is wired, in whichever direction."""
    wired = {(c.source_component, c.source, c.sink_component, c.sink) for c in system.connections}
    found = []
    for giver in system.components:
        for gives in (f for f in giver.unit.flanges if f.role == "gives"):
            for taker in system.components:
                for takes in (f for f in taker.unit.flanges if f.role == "takes"):
                    a, b = (giver.name, gives.w), (taker.name, takes.w)
                    if (*a, *b) in wired or (*b, *a) in wired:
                        found.append(MechanicalConnection(giver.name, gives, taker.name, takes))
    return found


def works(
    connections: list[MechanicalConnection], instances: Mapping[str, Instance]
) -> dict[str, tuple[float, float, float]]:
    """name -> (work given, work taken, integral of |power given|), J, as the units hold them now."""
    return {
        c.name: (
            instances[c.giver].get(c.gives.W),
            instances[c.taker].get(c.takes.W),
            instances[c.giver].get(c.gives.W_abs),
        )
        for c in connections
    }
