"""Values that a campaign gives to a system's parameters: numbers, choices, and quantities in any unit that converts;
start values that follow from recorded motion."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.conditioning import beginning
from cobot_joint.diagnosis.data.quantity import convert
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import Component, System, Value
from cobot_joint.system.parameters import checked, split
from cobot_joint.units import Unit

IMPOSED = "w_imposed"  # input of a unit whose motion is recorded
PLACE = "phi"  # output of such a unit: where it is
STILL = 0.01  # of the largest speed in a recording, up to which it begins at rest
AGAINST_ONE = re.compile(r"\s*([-+]?\d+(?:\.\d+)?)\s*:\s*1\s*")  # a ratio, "25:1"
QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)?\s*")  # "9 uN.m.s/rad"
FIRST = re.compile(r"first sample(?: of (?P<channel>.+?))?(?:\s*(?P<op>[*/])\s*(?P<factor>[-+.\deE]+))?")
COMMA = re.compile(r"\s*[-+]?\d+,\d")


def with_values(systems: Mapping[str, System], values: Mapping[str, Value | str], where: str) -> dict[str, System]:
    """The systems by set-up with `component.parameter` -> value in place of what they set, where they have it.

    UserError: no set-up has the component, or its unit does not take the value; one line that begins with `where`.
    """
    found = dict(systems)
    for name, given in values.items():
        having = [s for s, system in systems.items() if any(name.startswith(f"{c.name}.") for c in system.components)]
        if not having:
            known = among(dict.fromkeys(c.name for system in systems.values() for c in system.components))
            raise UserError(f"{where}: {name}: no such component, there are {known}")
        for setup in having:
            component, variable = split(found[setup], name, where)
            value = parameter(component.unit, variable, given, f"{where}: {name}")
            changed = replace(component, parameters={**component.parameters, variable: value})
            components = tuple(changed if c is component else c for c in found[setup].components)
            found[setup] = replace(found[setup], components=components)
    return found


def run_values(values: Mapping[str, Value | str], system: System, where: str) -> dict[str, float]:
    """`component.parameter` -> value in one run of the system. UserError: as `with_values`."""
    found = {}
    for name, given in values.items():
        component, variable = split(system, name, f"{where}: parameters")
        found[name] = float(parameter(component.unit, variable, given, f"{where}: parameters: {name}"))
    return found


def parameter(unit: Unit, name: str, given: Value | str, where: str) -> Value:
    """A value as the unit takes it. UserError: it is no parameter, does not convert, or is out of bounds."""
    variable = unit.variables.get(name)
    if variable is not None and variable.causality != "parameter":
        raise UserError(
            f"{where}: {variable.causality} of {unit.path.name}; a start value belongs to a recording's initial"
        )
    if isinstance(given, str) and COMMA.match(given):
        raise UserError(f"{where}: {given!r} is given, a decimal point is needed: {given.replace(',', '.', 1)!r}")
    if isinstance(given, str) and (ratio := AGAINST_ONE.fullmatch(given)):
        given = ratio[1]
    match = QUANTITY.fullmatch(given) if isinstance(given, str) else None
    if variable is not None and match and match[2]:
        measure = unit.unit_of(name) or "1"
        given = float(convert(np.array([float(match[1])]), match[2], measure, where)[0][0])
    return checked(unit, name, given, where)


def imposed(system: System, inputs: Mapping[str, NDArray[np.float64]]) -> list[str]:
    """Those of the system's inputs that are recorded motion."""
    wires = [w for w in system.connections if w.source_component is None and w.sink == IMPOSED]
    return [name for name in dict.fromkeys(w.source for w in wires) if name in inputs]


def place_of(system: System, name: str) -> str:
    """The position, `component.variable`, of the shaft that an input of the system moves; "": its unit shows none."""
    wire = next(w for w in system.connections if (w.source_component, w.source, w.sink) == (None, name, IMPOSED))
    assert wire.sink_component is not None
    unit = system.component(wire.sink_component).unit
    return f"{wire.sink_component}.{PLACE}" if PLACE in unit.variables else ""


def moving_starts(system: System, inputs: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    """`component.state` -> speed at the first sample, of all that recorded motion drives, through springs and gears.

    inputs: of the system, (n,) each. Left at rest beside a shaft that moves, a load rings on its spring from the start
    on: a healthy axis was said to have an effect at its sensor, 95 % sure.
    """
    speeds: dict[tuple[str, str], float] = {}
    for wire in system.connections:
        x = inputs.get(wire.source) if wire.source_component is None else None
        if x is None or wire.sink != IMPOSED or wire.sink_component is None:
            continue
        first = float(x[np.argmax(np.isfinite(x))])
        if abs(first) > STILL * float(np.nanmax(np.abs(x))):
            (flange,) = system.component(wire.sink_component).unit.flanges
            speeds[wire.sink_component, flange.w] = wire.factor * first + wire.offset
    driven: dict[str, float] = {}
    for _ in system.components:  # from one to the next
        for component in system.components:
            driven |= _passed_on(system, component, speeds)
    return driven


def _passed_on(system: System, component: Component, speeds: dict[tuple[str, str], float]) -> dict[str, float]:
    """State -> speed behind a component of two flanges, one of which is known to turn; `speeds` is added to."""
    if len(component.unit.flanges) != 2:
        return {}
    ends = [_end(system, component, flange.w) for flange in component.unit.flanges]
    ratio = component.unit.variables.get("ratio.N")
    N = float(component.parameters.get("ratio.N", ratio.start)) if ratio is not None else 1.0
    for known, other, times in ((0, 1, 1 / N), (1, 0, N)):
        at, to = ends[known], ends[other]
        if at is None or to is None or at not in speeds or to in speeds:
            continue
        speeds[to] = times * speeds[at]
        name, variable = to
        states = system.component(name).unit.states
        state = next((s for s in (variable, f"x_{variable}") if s in states), None)
        return {f"{name}.{state}": speeds[to]} if state else {}
    return {}


def _end(system: System, component: Component, variable: str) -> tuple[str, str] | None:
    """Whose output a flange's speed is; None: nobody's."""
    if component.unit.variables[variable].causality == "output":
        return component.name, variable
    wires = (w for w in system.connections if (w.sink_component, w.sink) == (component.name, variable))
    return next(((w.source_component, w.source) for w in wires if w.source_component), None)


def first_values(
    path: Path, initial: Mapping[str, float | str], series: Mapping[str, NDArray[np.float64]]
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Start values of a recording, as a campaign gives them: numbers, or the first of a series, (n,); and series ->
    start value -> what 1 sigma of where that series begins makes of it. UserError: there is no such series."""
    values: dict[str, float] = {}
    scatter: dict[str, dict[str, float]] = {}
    for name, given in initial.items():
        if isinstance(given, (int, float)):
            values[name] = float(given)
            continue
        match = FIRST.fullmatch(given)
        channel = (match["channel"] or name) if match else ""
        if not match or channel not in series:
            raise UserError(
                f"{path}: initial {name!r} = {given!r} is given, "
                f'a number or "first sample" of one of {among(series)} is needed'
            )
        first, sigma = beginning(series[channel])
        factor = float(match["factor"] or 1.0) ** (-1 if match["op"] == "/" else 1)
        values[name] = factor * first
        scatter.setdefault(channel, {})[name] = factor * sigma
    return values, scatter


def first_sample(connector: str, times: float = 1.0) -> str:
    """A start value in words, as `first_values` reads them."""
    return f"first sample of {connector}" + (f" * {times:.12g}" if times != 1 else "")
