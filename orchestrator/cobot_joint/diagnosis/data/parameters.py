"""Values that a campaign gives to a system's parameters: numbers, choices, and quantities in any unit that converts."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.data.quantity import convert
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import System, Value
from cobot_joint.system.parameters import checked, split
from cobot_joint.units import Unit

QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)?\s*")  # "9 uN.m.s/rad"


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
    match = QUANTITY.fullmatch(given) if isinstance(given, str) else None
    if variable is not None and match and match[2]:
        measure = unit.unit_of(name) or "1"
        given = float(convert(np.array([float(match[1])]), match[2], measure, where)[0][0])
    return checked(unit, name, given, where)
