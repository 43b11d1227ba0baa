"""Units of recorded columns: `name [unit]` headers, and the way to the unit that the system speaks (pint)."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pint

from cobot_joint.errors import UserError

if TYPE_CHECKING:
    from numpy.typing import NDArray

HEADER = re.compile(r"^\s*(?P<name>.*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*$")


def split_header(header: str) -> tuple[str, str | None]:
    """`"w_motor [rad/s]"` -> `("w_motor", "rad/s")`; no brackets, or empty ones: unit None."""
    match = HEADER.match(header)
    assert match  # the pattern takes any single line
    return match["name"], (match["unit"] or "").strip() or None


def convert(values: NDArray[np.float64], unit: str | None, target: str | None, where: str) -> tuple[NDArray, str]:
    """Values in `target`, or in SI base units where no target is given, and the unit that they now have.

    A missing unit is taken for the target's. `where` names the column in the error for units that do not convert.
    """
    if unit is None or unit == target:
        return values, target or unit or "1"
    have = _parse(unit, where)
    want = _parse(target, where) if target else _base(have)
    if have.dimensionality != want.dimensionality or _turns(have) != _turns(want):
        raise UserError(f"{where}: unit {unit!r} is given, one that converts to {target!r} is needed")
    if have == want:
        return values, target or unit
    # linear, q = at_0 + (at_1 - at_0) x: degC has an offset, "0.1 %" a factor of its own
    at_0, at_1 = (_registry().Quantity(x * have.m, have.u).to(want.u).m / want.m for x in (0.0, 1.0))
    return at_0 + (at_1 - at_0) * values, target or f"{want.u:~C}".replace("**", "").replace("*", ".") or "1"


@cache
def _registry() -> pint.UnitRegistry:
    registry: pint.UnitRegistry = pint.UnitRegistry()
    registry.define("@alias ohm = Ohm")
    registry.define("@alias turn = rev")
    registry.define("@alias degree_Celsius = °C")
    return registry


@cache
def _parse(unit: str, where: str) -> pint.Quantity:
    """FMI and SI spelling, `kg.m2/s`, in pint's: `kg*m**2/s`."""
    text = re.sub(r"(?<=[A-Za-z°µΩ])(-?\d+)", r"**\1", unit.replace("^", ""))
    text = re.sub(r"(?<!\d)\.|\.(?!\d)|·", "*", text)
    try:
        text = text.replace("%", " percent").strip()
        quantity = _registry().Quantity(1.0, text) if text in ("degC", "°C") else _registry().parse_expression(text)
        return quantity if isinstance(quantity, pint.Quantity) else _registry().Quantity(float(quantity), "")
    except (pint.PintError, ValueError, TypeError, AttributeError, SyntaxError) as error:
        raise UserError(
            f"{where}: unit {unit!r} is given, an SI spelling such as 'rad/s' or 'N.m' is needed"
        ) from error


def _base(q: pint.Quantity) -> pint.Quantity:
    return _registry().Quantity(1.0, q.to_base_units().u)


def _turns(q: pint.Quantity) -> bool:
    """Speeds only: is it an angle per time (rad/s, rpm) rather than a frequency (Hz, 1/s)? pint calls both 1/s."""
    base = _base(q).u
    return dict(base._units).get("second", 0) == -1 and dict(base._units).get("radian", 0) == 1
