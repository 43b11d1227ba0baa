"""A campaign's settings held against its system before anything is read: what was given, what is allowed, where."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from cobot_joint.diagnosis.data.parameters import run_values
from cobot_joint.diagnosis.data.quantity import convert, split_header
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import Component, System
from cobot_joint.system.shafts import position_behind

if TYPE_CHECKING:
    from cobot_joint.diagnosis.data.campaign_file import CampaignFile, Logged, RecordingEntry, Tolerance
    from cobot_joint.diagnosis.data.recording import Connector

Offered = Mapping[str, Mapping[str, "Connector"]]  # set-up -> its connectors by name


def check(where: str, given: CampaignFile, systems: Mapping[str, System], offered: Offered) -> None:
    """UserError: the first setting that does not fit the systems; `where` is the file."""
    components = {c.name: c for system in systems.values() for c in system.components}
    for name, tolerance in given.tolerances.items():
        _tolerance(f"{where}: [tolerances] {name!r}", name, tolerance, components)
    terms = [f"{c.name}.{term.name}" for c in components.values() for term in c.unit.terms if term.amplitude]
    for name in given.terms:
        if name not in terms:
            raise UserError(f"{where}: terms: {name!r} is given, {_nearest(name, terms)} is allowed")
    for name, (low, high) in given.scan.items():
        _scan(f"{where}: [scan] {name!r}", name, (low, high), components)
    for header, column in given.channels.items():
        if not isinstance(column, str) and column.mean:
            _mean(f"{where}: [channels] {header!r}", column.to, systems, offered)
    for name, logged in given.logged.items():
        _logged(f"{where}: [logged] {name!r}", name, logged, offered)
    for entry in given.recording:
        system = systems.get(entry.setup or next(iter(systems)))
        if system is not None:
            _recording(f"{where}: recording {entry.file!r}", entry, system)
            for name in given.initial:
                start_value(f"{where}: [initial] {name!r}", name, system)


def _tolerance(where: str, name: str, tolerance: Tolerance, components: Mapping[str, Component]) -> None:
    parameters = {
        f"{c.name}.{v.name}": (c, v)
        for c in components.values()
        for v in c.unit.variables.values()
        if v.causality == "parameter" and v.type == "Real"
    }
    if name not in parameters:
        raise UserError(f"{where}: no such parameter, allowed are {_nearest(name, parameters)}")
    component, variable = parameters[name]
    nominal = float(component.parameters.get(variable.name, variable.start) or 0.0)
    lower, upper = component.unit.bounds_of(variable.name)
    low, high = tolerance.bounds(nominal)
    if tolerance.between is None and low == high:
        raise UserError(f"{where}: a share of its nominal value is given, which is 0; [lower, upper] is allowed")
    if tolerance.between and ((lower is not None and low < lower) or (upper is not None and high > upper)):
        allowed = f"{'any' if lower is None else f'{lower:g}'} to {'any' if upper is None else f'{upper:g}'}"
        raise UserError(f"{where}: [{low:g}, {high:g}] is given, {component.unit.path.name} allows {allowed}")


def _scan(where: str, name: str, given: tuple[float, float], components: Mapping[str, Component]) -> None:
    shapes = {
        f"{c.name}.{shape.name}": (c.unit, shape)
        for c in components.values()
        for term in c.unit.terms
        if term.amplitude
        for shape in term.shapes
        if shape.scan != "phase"
    }
    if name not in shapes:
        raise UserError(f"{where}: no term has such a shape, allowed are {_nearest(name, shapes)}")
    unit, shape = shapes[name]
    low, high = given
    said = f"{where}: [{low:g}, {high:g}] is given"
    lower, upper = unit.bounds_of(shape.name)
    if (lower is not None and low < lower) or (upper is not None and high > upper):
        allowed = f"{'any' if lower is None else f'{lower:g}'} to {'any' if upper is None else f'{upper:g}'}"
        raise UserError(f"{said}, {unit.path.name} allows {allowed}")
    if shape.scan == "log" and low <= 0:
        raise UserError(f"{said}, it is scanned in equal ratios: more than 0 is allowed")
    if shape.scan == "order" and np.ceil(low) > np.floor(high):
        raise UserError(f"{said}, a whole number in between is needed: it counts periods per turn")


def _mean(where: str, name: str, systems: Mapping[str, System], offered: Offered) -> None:
    there = [system for setup, system in systems.items() if name in offered[setup]]
    if there and not any(position_behind(system, name) for system in there):
        allowed = "a speed whose unit has its position as well is allowed; of others say late, half a sample"
        raise UserError(f"{where}: mean is given, for {name!r}: {allowed}")


def _logged(where: str, name: str, logged: Logged, offered: Offered) -> None:
    for setup in logged.setups or ():
        if setup not in offered:
            raise UserError(f"{where}: setups: {setup!r} is given, {among(offered)} is allowed")
    for setup in logged.setups or offered:
        if name not in offered[setup]:
            hint = "" if len(offered) == 1 else f" of set-up {setup!r} (`setups` says which have it)"
            raise UserError(f"{where}: no such connector{hint}, allowed are {_nearest(name, offered[setup])}")
        connector = offered[setup][name]
        if logged.causality not in (None, connector.causality):
            raise UserError(f"{where}: causality: {logged.causality!r} is given, it is an {connector.causality}")
        if logged.unit is not None:
            convert(np.zeros(1), logged.unit, connector.unit, where)


def _recording(where: str, entry: RecordingEntry, system: System) -> None:
    if entry.time is not None:
        convert(np.zeros(1), split_header(entry.time)[1], "s", f"{where}: time = {entry.time!r}")
    if entry.begin is not None and entry.end is not None and entry.begin >= entry.end:
        raise UserError(f"{where}: begin = {entry.begin:g}, end = {entry.end:g} is given, begin has to be before end")
    run_values(entry.parameters, system, where)
    for name in entry.initial:
        start_value(f"{where}: initial {name!r}", name, system)


def start_value(where: str, name: str, system: System) -> None:
    """UserError: the name is no start value of a state or input of the system, nor an output that shows one."""
    ends = [w for w in system.connections if w.sink_component is None and w.sink == name]
    full = f"{ends[0].source_component}.{ends[0].source}" if ends else name
    starts = {
        f"{c.name}.{v.name}": v
        for c in system.components
        for v in c.unit.variables.values()
        if v.start is not None or v.causality == "parameter"
    }
    if full in starts and starts[full].causality == "parameter":
        raise UserError(f"{where}: a parameter is given, start values are allowed; parameters belong to [parameters], "
                        "or to the recording's parameters where they differ from run to run")  # fmt: skip
    if full not in starts:
        own = [n for n, v in starts.items() if v.causality != "parameter"]
        raise UserError(f"{where}: no start value of the system, allowed are {_nearest(name, own)}")


def _nearest(name: str, known: Iterable[str]) -> str:
    """Those of `known` that look like `name`, else the first of them."""
    known = list(known)
    return among(difflib.get_close_matches(name, known, n=5, cutoff=0.6) or known)
