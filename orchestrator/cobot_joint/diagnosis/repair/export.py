"""Repaired units and systems: FMUs that carry their values, corrections on their ports, and the SSP that wires them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, count
from pathlib import Path

from cobot_joint.errors import UserError
from cobot_joint.files import write_atomically
from cobot_joint.system.model import Component, Connection, System, Value
from cobot_joint.system.parameters import split
from cobot_joint.system.start_values import PortText, carries_values, set_start_values
from cobot_joint.system.write import file_names, write_fmu, write_ssp
from cobot_joint.units import TOOL, Unit, find_fmu, load_unit


@dataclass(frozen=True)
class Correction:
    """An effect that no list names: the correction unit with these parameters, from the component's signals to its
    port.

    port and signals: `component.variable`; parameters: of the correction unit. Signals go to u1, u2, ... in this order.
    """

    name: str
    port: str
    signals: tuple[str, ...]
    parameters: Mapping[str, float]


def export_unit(
    unit: Unit,
    values: Mapping[str, Value],
    path: Path,
    *,
    onsets: Mapping[str, float] | None = None,
    ports: Mapping[str, PortText] | None = None,
) -> Path:
    """The FMU with other start values, in its XML and in its resources, under a GUID that belongs to both.

    onsets: of these values, which hold only from a time on, s. ports: variable -> (unit, description) where the general
    unit has none of its own. The library inside is the same. UserError: a value that the unit does not take, or a unit
    that does not read its resources.
    """
    if not carries_values(unit):
        raise UserError(f"{unit.path}: cannot carry start values: only units of {TOOL} read them from their resources")
    change = partial(set_start_values, unit=unit, values=values, onsets=onsets, ports=ports)
    return write_fmu(unit, path, [change])


def repaired_system(
    system: System,
    values: Mapping[str, Value],
    folder: Path,
    *,
    onsets: Mapping[str, float] | None = None,
    corrections: tuple[Correction, ...] = (),
    names: Mapping[str, str] | None = None,
) -> System:
    """The system over units that carry the values, written to `folder`; corrections wired to their ports.

    values, onsets: `component.variable`; components that the system does not have are passed over, so that one repair
    serves every set-up. Units that do not read their resources keep their values in the system's parameters.
    names: component -> file; default: one file per component, named as it is.
    """
    names = names or fmu_files({"": system})[""]
    folder.mkdir(parents=True, exist_ok=True)
    own = tuple(f"{c.name}." for c in system.components)
    given: dict[str, dict[str, Value]] = {c.name: dict(c.parameters) for c in system.components}
    late: dict[str, dict[str, float]] = {c.name: {} for c in system.components}
    for name, value in values.items():
        if name.startswith(own):
            component, variable = split(system, name, "repair")
            given[component.name][variable] = value
            if onsets and name in onsets:
                late[component.name][variable] = onsets[name]
    components = [_repaired(c, given[c.name], late[c.name], folder / names[c.name]) for c in system.components]
    system = replace(system, components=tuple(components), path=None)
    for correction in corrections:
        if correction.port.startswith(own):
            system = with_correction(system, correction, folder)
    return system


def with_correction(system: System, correction: Correction, folder: Path) -> System:
    """The system with a correction between the component's signals and its port.

    A port that is wired already gets the correction in between: y = x + correction. Where a component of an earlier
    repair has its name, the correction gets a number.
    """
    there = {c.name for c in system.components}
    names = chain([correction.name], (f"{correction.name}_{k}" for k in count(2)))
    correction = replace(correction, name=next(name for name in names if name not in there))
    component, port = split(system, correction.port, "correction")
    general = load_unit(find_fmu("correction.fmu"))
    ports = {
        "x": PortText(component.unit, port, f"what else goes to {correction.port}"),
        "y": PortText(component.unit, port, f"what goes to {correction.port}"),
    }
    wires = []
    for k, signal in enumerate(correction.signals, 1):
        source, variable = split(system, signal, "correction")
        ports[f"u{k}"] = PortText(source.unit, variable, signal)
        wires += _wire(system, source, variable, correction.name, f"u{k}")
    path = folder / file_names([(correction.name, correction.name, "")])[0]
    export_unit(general, dict(correction.parameters), path, ports=ports)
    kept = []
    for wire in system.connections:
        if (wire.sink_component, wire.sink) == (component.name, port):
            wires.append(replace(wire, sink_component=correction.name, sink="x"))
        else:
            kept.append(wire)
    wires.append(Connection(correction.name, "y", component.name, port))
    # behind the component whose state it reads: what it adds acts in the next step
    order = list(system.components)
    order.insert(order.index(component) + 1, Component(correction.name, path.name, load_unit(path)))
    return replace(system, components=tuple(order), connections=(*kept, *wires))


def _wire(system: System, component: Component, variable: str, sink_component: str, sink: str) -> list[Connection]:
    """From an output of the component; from what feeds it, if it is an input; none, if nothing does: it stays at 0."""
    if component.unit.variables[variable].causality == "output":
        return [Connection(component.name, variable, sink_component, sink)]
    return [
        replace(wire, sink_component=sink_component, sink=sink)
        for wire in system.connections
        if (wire.sink_component, wire.sink) == (component.name, variable)
    ]


def write_repair(
    systems: Mapping[str, System],
    values: Mapping[str, Value],
    out: Path,
    *,
    onsets: Mapping[str, float] | None = None,
    corrections: tuple[Correction, ...] = (),
) -> dict[str, Path]:
    """Set-up -> its SSP: the first is OUT/repaired.ssp, others OUT/repaired_<setup>.ssp; their FMUs are in OUT/fmus."""
    written: dict[str, Path] = {}
    names, files = fmu_files(systems), ssp_files(systems)
    for setup, system in systems.items():
        repaired = repaired_system(
            system, values, out / "fmus", onsets=onsets, corrections=corrections, names=names[setup]
        )
        written[setup] = write_ssp(repaired, out / files[setup])
    return written


def fmu_files(systems: Mapping[str, System]) -> dict[str, dict[str, str]]:
    """Set-up -> component -> file: one for each component, the same where set-ups have the very same component."""
    each = [(setup, c) for setup, system in systems.items() for c in system.components]
    wanted = [((c.name, c.unit.directory, *sorted(c.parameters.items())), c.name, setup) for setup, c in each]
    found: dict[str, dict[str, str]] = {setup: {} for setup in systems}
    for (setup, component), file in zip(each, file_names(wanted), strict=True):
        found[setup][component.name] = file
    return found


def ssp_files(setups: Iterable[str]) -> dict[str, str]:
    """Set-up -> file of its repaired system."""
    first, *others = setups
    return {first: "repaired.ssp"} | dict(
        zip(others, file_names([(s, f"repaired_{s}", "") for s in others], ".ssp"), strict=True)
    )


def _repaired(component: Component, values: Mapping[str, Value], late: Mapping[str, float], path: Path) -> Component:
    if not values or not carries_values(component.unit):
        write_atomically(path, lambda file: file.write_bytes(component.unit.path.read_bytes()))
        return replace(component, unit=load_unit(path), parameters=values)
    export_unit(component.unit, values, path, onsets=late)
    return replace(component, unit=load_unit(path), parameters={})
