"""Another FMU in a component's place: the wires stay, and have to fit the new unit as they fitted the old one."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from cobot_joint.errors import UserError, among
from cobot_joint.system.model import Component, Connection, Connector, System
from cobot_joint.system.parameters import checked
from cobot_joint.system.wiring import Wiring, check, conversion
from cobot_joint.units import Unit, load_unit

HOW = "names that differ are given as in my.fmu:tau=tau_m, with another sign as tau=-tau_m, a port to leave out as tau="


@dataclass(frozen=True)
class Replacement:
    """An FMU, and what it calls the ports (and parameters) of the component in whose place it comes.

    `names`: the component's name -> the FMU's; empty: the FMU has no such port, and its wires are left out.
    `flipped`: the component's names whose values have the opposite sign in the FMU.
    """

    file: Path
    names: Mapping[str, str] = field(default_factory=dict)
    flipped: frozenset[str] = frozenset()

    def name(self, port: str) -> str:
        """What the FMU calls it; empty where it is left out."""
        return self.names.get(port, port)


def replacement(text: str, where: str = "units") -> Replacement:
    """Of `my.fmu`, or `my.fmu:tau=tau_m,w_o=-speed,J_coupled=`. UserError: a part that is no pair."""
    split = re.fullmatch(r"(.*?\.fmu):(.*)", text, flags=re.IGNORECASE | re.DOTALL)
    if split is None:
        return Replacement(Path(text))
    names, flipped = {}, set()
    for part in filter(None, (part.strip() for part in split[2].split(","))):
        port, equals, own = (piece.strip() for piece in part.partition("="))
        if not (port and equals):
            raise UserError(f"{where}: {part!r} is given; {HOW}")
        names[port] = own.removeprefix("-")
        if own.startswith("-"):
            flipped.add(port)
    return Replacement(Path(split[1]), names, frozenset(flipped))


def with_units(system: System, files: Mapping[str, str | Path], where: str = "units") -> System:
    """The system with these components' FMUs replaced. `files`: component -> .fmu file, as `replacement` reads it.

    UserError: there is no such component or file; the new unit lacks a wired variable or a parameter that the system
    sets, or its types or units do not fit.
    """
    for name, file in files.items():
        system = _swapped(system, name, replacement(str(file), where), f"{where}: {name}={file}")
    return system


def wired_ports(system: System, name: str) -> list[str]:
    """Variables of a component that have a wire, each once, in the system's order."""
    ends = [end for c in system.connections for end in ((c.source_component, c.source), (c.sink_component, c.sink))]
    return list(dict.fromkeys(port for component, port in ends if component == name))


def component_of(system: System, name: str, where: str) -> Component:
    """UserError: there is none of that name."""
    if name not in {c.name for c in system.components}:
        raise UserError(
            f"{where}: no such component of {system.name}, it has {among(c.name for c in system.components)}"
        )
    return system.component(name)


def _swapped(system: System, name: str, new: Replacement, where: str) -> System:
    old = component_of(system, name, where)
    unit = load_unit(new.file)
    _check_names(system, old, new, unit, where)
    parameters = {
        new.name(n): checked(unit, new.name(n), value, f"{where}: {n}")
        for n, value in old.parameters.items()
        if new.name(n)
    }
    component = replace(old, source=str(new.file), unit=unit, parameters=parameters)
    components = tuple(component if c.name == name else c for c in system.components)
    connectors: list[Connector] = [*system.inputs.values(), *system.outputs.values()]
    known = {n: base for c in (*system.components, component) for n, base in c.unit.units.items()}
    before = Wiring(system.components, connectors, known, where)
    after = Wiring(components, connectors, known, where)
    kept = [wire for wire in system.connections if all(new.name(port) for port in _ports(wire, name))]
    wires = tuple(_rewired(wire, before, after, name, new) if _ports(wire, name) else wire for wire in kept)
    fed = {wire.sink for wire in wires if wire.sink_component is None}
    outputs = {n: connector for n, connector in system.outputs.items() if n in fed}
    swapped = replace(system, components=components, connections=wires, outputs=outputs)
    check(swapped)
    return swapped


def _check_names(system: System, old: Component, new: Replacement, unit: Unit, where: str) -> None:
    """UserError: mapped names that the component does not have, or wired ports that the new unit lacks; all of them."""
    wired = wired_ports(system, old.name)
    if unknown := [port for port in new.names if port not in (*wired, *old.parameters)]:
        raise UserError(f"{where}: {among(unknown)}: {old.name} has no such wired port, it has {among(wired)}")
    lacking = [new.name(port) for port in wired if new.name(port) and new.name(port) not in unit.variables]
    if lacking:
        own = [
            f"{v.name} [{unit.unit_of(v.name) or 'no unit'}]"
            for v in unit.variables.values()
            if v.causality in ("input", "output")
        ]
        raise UserError(f"{where}: {among(lacking)} is no variable of {new.file.name}, it has {among(own)}; {HOW}")


def _ports(wire: Connection, name: str) -> list[str]:
    """The component's own ends of a wire."""
    ends = ((wire.source_component, wire.source), (wire.sink_component, wire.sink))
    return [port for component, port in ends if component == name]


def _rewired(wire: Connection, before: Wiring, after: Wiring, name: str, new: Replacement) -> Connection:
    """The wire at the new names, with the new ends' conversion of units in place of the old ones'; what else it scales
    by, it keeps."""
    start, end = (wire.source_component, wire.source), (wire.sink_component, wire.sink)
    scale, shift = conversion(before.endpoint(*start), before.endpoint(*end), before.where)
    factor = wire.factor / scale
    offset = wire.offset - factor * shift
    new_start, new_end = ((c, new.name(port) if c == name else port) for c, port in (start, end))
    source_flipped, sink_flipped = (c == name and port in new.flipped for c, port in (start, end))
    if source_flipped != sink_flipped:
        factor = -factor
    return after.connect(new_start, new_end, factor, -offset if sink_flipped else offset)
