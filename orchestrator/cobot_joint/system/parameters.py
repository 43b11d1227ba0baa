"""Values given to a unit's variables: do these exist, may they be set, are the values inside the bounds."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import replace

from fmpy.model_description import ModelVariable

from cobot_joint.errors import UserError, among
from cobot_joint.system.model import Component, System, Value
from cobot_joint.units import Unit


def with_parameters(system: System, values: Mapping[str, Value | str], where: str = "parameters") -> System:
    """The system with `component.variable` -> value on top of what it sets. UserError: unknown or not allowed."""
    given: dict[str, dict[str, Value]] = {component.name: {} for component in system.components}
    for name, value in values.items():
        component, variable = split(system, name, where)
        given[component.name][variable] = checked(component.unit, variable, value, f"{where}: {name}")
    return replace(
        system,
        components=tuple(replace(c, parameters={**c.parameters, **given[c.name]}) for c in system.components),
    )


def split(system: System, name: str, where: str) -> tuple[Component, str]:
    """`motor_bldc.winding.R` -> (component, `winding.R`); the longest component name that fits."""
    fitting = [c for c in system.components if name.startswith(f"{c.name}.")]
    if not fitting:
        raise UserError(
            f"{where}: {name}: no such component of {system.name}, it has {among(c.name for c in system.components)}"
        )
    component = max(fitting, key=lambda c: len(c.name))
    return component, name[len(component.name) + 1 :]


def checked(unit: Unit, name: str, value: Value | str, where: str) -> Value:
    """The value in the variable's type, if the variable has a start value to set and the value lies in its bounds.

    What has named values takes them by name or number. UserError: says what was given and what is allowed.
    """
    variable = unit.variables.get(name)
    if variable is None or not _settable(variable):
        settable = [v.name for v in unit.variables.values() if _settable(v)]
        near = difflib.get_close_matches(name, settable, n=5, cutoff=0.5) or settable
        what = "no variable" if variable is None else "not a parameter"
        raise UserError(f"{where}: {what} of {unit.path.name}, allowed are {among(near)}")
    if isinstance(value, str) and (items := unit.choices_of(name)):
        value = items.get(value, value)
        if isinstance(value, str) and not value.lstrip("-").isdigit():
            raise UserError(f"{where}: {value!r} is given, {among(items)} is allowed")
    number = _number(value, variable.type, where)
    lower, upper = unit.bounds_of(name)
    if (lower is not None and number < lower) or (upper is not None and number > upper):
        unit_name = unit.unit_of(name)
        suffix = f" {unit_name}" if unit_name and unit_name != "1" else ""
        low = "any" if lower is None else f"{lower:g}"
        high = "any" if upper is None else f"{upper:g}"
        raise UserError(f"{where}: {number:g}{suffix} is given, {low} to {high}{suffix} is allowed ({unit.path.name})")
    return number


def _settable(variable: ModelVariable) -> bool:
    return variable.start is not None and variable.variability != "constant"


def _number(value: Value | str, kind: str, where: str) -> Value:
    if kind == "Boolean":
        spelled = {"true": True, "1": True, "1.0": True, "false": False, "0": False, "0.0": False}
        if (text := str(value).lower()) not in spelled:
            raise UserError(f"{where}: {value!r} is given, true or false is allowed")
        return spelled[text]
    if kind not in ("Real", "Integer", "Enumeration"):
        raise UserError(f"{where}: {value!r} is given for a {kind}, which cannot be set; Real, Integer, Boolean can")
    if isinstance(value, bool):
        raise UserError(f"{where}: {str(value).lower()} is given, a number is allowed")
    try:
        number = float(value)
    except ValueError:
        raise UserError(f"{where}: {value!r} is given, a number is allowed") from None
    if not math.isfinite(number):
        raise UserError(f"{where}: {value!r} is given, a finite number is allowed")
    if kind == "Real":
        return number
    if number != int(number):
        raise UserError(f"{where}: {value!r} is given, a whole number is allowed")
    return int(number)
