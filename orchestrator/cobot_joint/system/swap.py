"""Another FMU in a component's place: the wires stay, and have to fit the new unit as they fitted the old one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from cobot_joint.errors import UserError, among
from cobot_joint.system.model import Connection, Connector, System
from cobot_joint.system.parameters import checked
from cobot_joint.system.wiring import Wiring, check, conversion
from cobot_joint.units import load_unit


def with_units(system: System, files: Mapping[str, str | Path], where: str = "units") -> System:
    """The system with these components' FMUs replaced. `files`: component -> .fmu file.

    UserError: there is no such component or file; the new unit lacks a wired variable or a parameter that the system
    sets, or its types or units do not fit.
    """
    for name, file in files.items():
        system = _swapped(system, name, Path(file), f"{where}: {name}={file}")
    return system


def _swapped(system: System, name: str, file: Path, where: str) -> System:
    if name not in {c.name for c in system.components}:
        raise UserError(
            f"{where}: no such component of {system.name}, it has {among(c.name for c in system.components)}"
        )
    unit = load_unit(file)
    old = system.component(name)
    parameters = {n: checked(unit, n, value, f"{where}: {n}") for n, value in old.parameters.items()}
    new = replace(old, source=str(file), unit=unit, parameters=parameters)
    components = tuple(new if c.name == name else c for c in system.components)
    connectors: list[Connector] = [*system.inputs.values(), *system.outputs.values()]
    known = {n: base for c in (*system.components, new) for n, base in c.unit.units.items()}
    before = Wiring(system.components, connectors, known, where)
    after = Wiring(components, connectors, known, where)
    wires = tuple(
        _rewired(wire, before, after) if name in (wire.source_component, wire.sink_component) else wire
        for wire in system.connections
    )
    swapped = replace(system, components=components, connections=wires)
    check(swapped)
    return swapped


def _rewired(wire: Connection, before: Wiring, after: Wiring) -> Connection:
    """The wire with the new ends' conversion of units in place of the old ones'; what else it scales by, it keeps."""
    start, end = (wire.source_component, wire.source), (wire.sink_component, wire.sink)
    scale, shift = conversion(before.endpoint(*start), before.endpoint(*end), before.where)
    factor = wire.factor / scale
    return after.connect(start, end, factor, wire.offset - factor * shift)
