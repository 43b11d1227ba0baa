"""Energy that crosses mechanical connections: what one unit gives at its port, and what its neighbour takes.

A unit that annotates flanges integrates its work itself. Of every other port, a speed and a torque (or force) that are
wired between two units in opposite directions, the master integrates what the unit saw and what it gave.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import copysign, prod

from fmpy.model_description import BaseUnit

from cobot_joint.cosim.instances import Instance
from cobot_joint.system.model import Component, Connection, System
from cobot_joint.system.wiring import ADDITIVE, spell
from cobot_joint.units import Flange

log = logging.getLogger("cobot_joint")
SPEED, TORQUE, VELOCITY, FORCE = "s-1.rad", "kg.m2.s-2", "m.s-1", "kg.m.s-2"  # as `spell` spells base units
EFFORT_OF = {SPEED: TORQUE, VELOCITY: FORCE}
BY_NAME = {"w": SPEED, "omega": SPEED, "tau": TORQUE, "v": VELOCITY, "f": FORCE}  # Modelica's, where no unit is given
WORTH_SAYING = 0.01  # residual over the energy that flowed
NOTHING = 1e-6  # J


@dataclass(frozen=True)
class Port:
    """One end of a mechanical connection: effort and flow, and the unit's own integrals of their product if it has.

    `factor`: from the product in the variables' own units and signs to W, as at the sinks of both wires.
    """

    component: str
    name: str
    effort: str
    flow: str
    W: str | None = None
    W_abs: str | None = None
    factor: float = 1.0


@dataclass(frozen=True)
class MechanicalConnection:
    """Two ports whose speeds are wired together."""

    gives: Port
    takes: Port

    @property
    def name(self) -> str:
        """`motor.shaft -> gear.input`"""
        return f"{self.gives.component}.{self.gives.name} -> {self.takes.component}.{self.takes.name}"

    @property
    def annotated(self) -> bool:
        """Whether both units integrate their work themselves."""
        return self.gives.W is not None and self.takes.W is not None


def mechanical_connections(system: System) -> list[MechanicalConnection]:
    """Every pair of a giving and a taking flange between which a speed is wired; then every pair of a speed and a
    torque, or force, that two units wire in opposite directions and that no two flanges are."""
    wired = {(c.source_component, c.source, c.sink_component, c.sink) for c in system.connections}
    found = []
    for giver, taker in product(system.components, repeat=2):
        for gives, takes in product(_flanges(giver, "gives"), _flanges(taker, "takes")):
            a, b = (giver.name, gives.w), (taker.name, takes.w)
            if (*a, *b) in wired or (*b, *a) in wired:
                found.append(MechanicalConnection(_annotated(giver.name, gives), _annotated(taker.name, takes)))
    return found + _unannotated(system, found)


def unmeasured(connections: Iterable[MechanicalConnection]) -> list[Port]:
    """The ports whose work the master integrates."""
    return [port for c in connections for port in (c.gives, c.takes) if port.W is None]


def works(
    connections: Sequence[MechanicalConnection],
    instances: Mapping[str, Instance],
    measured: Sequence[tuple[float, float]],
) -> dict[str, tuple[float, float, float]]:
    """name -> (work given, work taken, integral of |power given|), J, as units and master hold them now.

    `measured`: (work, integral of |power|) of the ports that `unmeasured` lists, in the variables' own units.
    """
    own = dict(zip(unmeasured(connections), measured, strict=True))

    def done(port: Port) -> tuple[float, float]:
        if port.W is None or port.W_abs is None:
            work, absolute = own[port]
        else:
            work, absolute = (instances[port.component].get(name) for name in (port.W, port.W_abs))
        return work * port.factor, absolute * abs(port.factor)

    return {c.name: (done(c.gives)[0], done(c.takes)[0], done(c.gives)[1]) for c in connections}


def warn_of_residuals(energy: Mapping[str, tuple[float, float, float]]) -> None:
    """A line for each connection at which more than WORTH_SAYING of the energy that flowed was lost or made."""
    for name, (given, taken, absolute) in energy.items():
        if absolute > NOTHING and not abs(given - taken) <= WORTH_SAYING * absolute:
            log.warning(
                "%s: %.3g J were given and %.3g J taken, a residual of %.2g %%: the coupling is too coarse here; "
                "a shorter --step or another --scheme helps", name, given, taken, 100 * (given - taken) / absolute,
            )  # fmt: skip


def _flanges(component: Component, role: str) -> list[Flange]:
    return [f for f in component.unit.flanges if f.role == role]


def _annotated(component: str, f: Flange) -> Port:
    return Port(component, f.name, f.tau, f.w, f.W, f.W_abs)


def _unannotated(system: System, known: list[MechanicalConnection]) -> list[MechanicalConnection]:
    taken: set[tuple[str | None, str]] = {(port.component, port.flow) for c in known for port in (c.gives, c.takes)}
    between = [c for c in system.connections if c.source_component and c.sink_component]
    found = []
    for flow in between:
        ends = {(flow.source_component, flow.source), (flow.sink_component, flow.sink)}
        wanted = EFFORT_OF.get(_quantity(system, flow))
        if wanted is None or ends & taken:
            continue
        efforts = [c for c in between if _opposite(c, flow) and _quantity(system, c) == wanted]
        if effort := _partner(flow, [c for c in efforts if not c.sink.endswith(ADDITIVE)]):
            found.append(_connection(system, flow, effort))
            taken |= ends
    return found


def _opposite(a: Connection, b: Connection) -> bool:
    return (a.source_component, a.sink_component) == (b.sink_component, b.source_component)


def _partner(flow: Connection, efforts: list[Connection]) -> Connection | None:
    """The one that there is, or of several the one whose names end as the speed's do: w_o and tau_o."""
    if len(efforts) == 1:
        return efforts[0]
    ends = {name.partition("_")[2] for name in (flow.source, flow.sink)}
    alike = [c for c in efforts if ends & {name.partition("_")[2] for name in (c.source, c.sink)}]
    return alike[0] if len(alike) == 1 else None


def _quantity(system: System, wire: Connection) -> str:
    """What a wire carries, in base units, by the unit of measure at either end; by its name where neither has one."""
    base = _base(system, wire)
    return spell(base) if base else BY_NAME.get(wire.source.rpartition(".")[2].partition("_")[0].lower(), "")


def _base(system: System, wire: Connection, component: str | None = None) -> BaseUnit | None:
    """The base unit at `component`'s end of a wire, or at the other where that says none."""
    ends = [(wire.source_component, wire.source), (wire.sink_component, wire.sink)]
    for owner, name in sorted(ends, key=lambda end: end[0] != component):
        unit = system.component(str(owner)).unit
        if base := unit.units.get(unit.unit_of(name) or ""):
            return base
    return None


def _connection(system: System, flow: Connection, effort: Connection) -> MechanicalConnection:
    """The speed's source gives, unless a flange at either end says otherwise."""
    source, source_role = _port(system, str(flow.source_component), flow, effort)
    sink, sink_role = _port(system, str(flow.sink_component), flow, effort)
    backwards = source_role == "takes" or sink_role == "gives"
    return MechanicalConnection(sink, source) if backwards else MechanicalConnection(source, sink)


def _port(system: System, component: str, flow: Connection, effort: Connection) -> tuple[Port, str | None]:
    """The component's end of both wires, and its role where that is a flange."""
    w, tau = (wire.source if wire.source_component == component else wire.sink for wire in (flow, effort))
    sign = prod(copysign(1, wire.factor) for wire in (flow, effort) if wire.source_component == component)
    for flange in system.component(component).unit.flanges:
        if (flange.w, flange.tau) == (w, tau):
            return replace(_annotated(component, flange), factor=sign), flange.role
    bases = [_base(system, wire, component) for wire in (flow, effort)]
    return Port(component, tau, tau, w, factor=sign * prod(base.factor for base in bases if base)), None
