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

LONGEST_HEADER = 1000  # characters; a line that is longer is no header
LONGEST_UNIT = 40

# As logs and data sheets write them; pint reads some of them as something else (Nm: textiles, U: enzymes, Grad: giga).
WHOLE = {
    **dict.fromkeys(("U/min", "Upm", "rev/min", "r/min", "tr/min", "Umdr./min", "RPM", "Rpm"), "rpm"),
    **dict.fromkeys(("U/s", "rev/s", "r/s", "rps"), "turn/s"),
    **dict.fromkeys(("-", "1", ""), "1"),
    "gcm2": "g.cm2",
    "kgm2": "kg.m2",
    "kgcm2": "kg.cm2",
}
PER_MINUTE = ("1/min", "/min", "min-1")  # DIN 1301: the speed of a shaft, where a speed is wanted; else a rate
WORDS = {
    **{f"{prefix}Nm": f"{prefix}N.m" for prefix in ("", "m", "u", "µ", "c", "k")},
    "Ncm": "N.cm",
    "Nmm": "N.mm",
    **{f"{prefix}Nms": f"{prefix}N.m.s" for prefix in ("", "m", "u", "µ")},
    **dict.fromkeys(("U", "rev", "Umdr"), "turn"),
    **dict.fromkeys(("°", "Grad"), "deg"),
    "°C": "degC",
    "%": "percent",
    "‰": "permille",
    **dict.fromkeys(("sec", "secs", "seconds", "Sek"), "s"),
    "msec": "ms",
    **dict.fromkeys(("usec", "µsec"), "us"),
    **dict.fromkeys(("Amp", "Amps", "amps", "Ampere"), "A"),
    **dict.fromkeys(("Volt", "Volts", "volts"), "V"),
    **dict.fromkeys(
        ("inc", "incr", "increments", "Inkremente", "tick", "ticks", "cnt", "cnts", "pulse", "pulses"), "count"
    ),
}
SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻·⋅", "0123456789-..")
FACTOR = re.compile(r"-?\d{1,15}(?:\.\d{0,15})?(?:[eE][+-]?\d{1,2})?(?=\s|$)|-?0?\.\d{1,15}(?=\s|$)")
TOKEN = re.compile(
    r"\s*(?:(?P<word>[^\W\d_]*[^\W\d]|[%°‰][^\W\d_]*)(?:(?:\*\*|\^)?(?P<power>-?\d))?|(?P<op>[./*()]|1(?=\s*/)))"
)

TORQUES = {  # as hobby servos' and American data sheets write them: weights, not masses
    re.compile(r"\bozf?[-.]?in\b(?![-.²2^])"): "ozf.inch",
    re.compile(r"\b(?:lbf?[-.]?in|in[-.]lbf?)\b(?![-.²2^])"): "lbf.inch",
    re.compile(r"\b(?:lbf?[-.]?ft|ft[-.]lbf?)\b(?![-.²2^])"): "lbf.foot",
    re.compile(r"\bkgf?-?cm\b(?![-.²2^])"): "kgf.cm",
}
PER_THOUSAND_RPM = re.compile(r"(?:/|\bper)\s*1000\s*(?:rpm|min-1|U/min)\b")  # of viscous friction, in data sheets
IN_PARENTHESES = re.compile(r"\s*\(([^()]+)\)$")
# a unit, not `(raw)`, `(min)` or phase `(A)`: a letter alone is none here, or one that changes nothing
PLAIN = re.compile(r"[munkcµ]?(?:Nm|Hz|rad|Ohm|Ω)|[munkcµ](?:N|V|W|A|m|s)|deg|rpm|rev")


def split_header(header: str) -> tuple[str, str | None]:
    """`"w_motor [rad/s]"` -> `("w_motor", "rad/s")`; no brackets, or empty ones: unit None. `pos[0]` is a name.
    `"torque (mNm)"` -> `("torque (mNm)", "mNm")`.

    UserError: brackets in brackets, or more characters than a header has.
    """
    if len(header) > LONGEST_HEADER:
        raise UserError(f"a column's name of {len(header)} characters is given, {LONGEST_HEADER} are allowed")
    text = "".join(c if c.isprintable() else "\ufffd" for c in header.strip())  # a terminal obeys some of the others
    name, bracket, unit = text[:-1].rpartition("[")
    if not (text.endswith("]") and bracket) or (unit.isdigit() and name and not name[-1].isspace()):
        return text, _in_parentheses(text)
    if "]" in unit:
        raise UserError(f"column {text!r} is given, one unit in one pair of brackets is allowed: 'w_motor [rad/s]'")
    return name.strip(), unit.strip() or None


def without_parentheses(name: str) -> str:
    """`"Time (s)"` -> `"Time"`"""
    return IN_PARENTHESES.sub("", name) or name


def _in_parentheses(name: str) -> str | None:
    """The unit at the end of a name; None: what stands there is none, or nothing does."""
    found = IN_PARENTHESES.search(name)
    unit = found[1].strip() if found and found.start() else ""
    known = PLAIN.fullmatch(unit) or any(c in unit for c in "/.*·°%") or (len(unit) > 1 and unit in {*WHOLE, *WORDS})
    return unit if known and is_unit(unit) else None


def convert(values: NDArray[np.float64], unit: str | None, target: str | None, where: str) -> tuple[NDArray, str]:
    """Values in `target`, or in SI base units where no target is given, and the unit that they now have.

    A missing unit is taken for the target's. `where` names the column in the error for units that do not convert.
    """
    if unit is None or unit == target:
        return values, target or unit or "1"
    want = _parse(target, where) if target else None
    have = _parse(unit, where, speed=want is not None and _turns(want))
    if want is None:
        want = _base(have)
    if have.dimensionality != want.dimensionality or _turns(have) != _turns(want):
        raise UserError(f"{where}: unit {unit!r} is given, one that converts to {target!r} is needed")
    if _leads(want) and not _leads(have):  # pint takes a radian for 1: a screw's 5 mm would be 5 mm/rad
        raise UserError(f"{where}: unit {unit!r} is given, a length per angle is needed: '{unit}/rev' or '{unit}/rad'")
    if have == want:
        return values, target or unit
    # linear, q = at_0 + (at_1 - at_0) x: degC has an offset, "0.1 %" a factor of its own
    at_0, at_1 = (_registry().Quantity(x * have.m, have.u).to(want.u).m / want.m for x in (0.0, 1.0))
    return at_0 + (at_1 - at_0) * values, target or _spelled(want)


def product(unit: str | None, scale: str, where: str) -> str:
    """The unit of a column in `unit` times a scale with a unit, `"9.84 mN.m"`: `%` times it is `0.0984 mN.m`."""
    quantity = _parse(scale, where) * (_parse(unit, where) if unit else _registry().Quantity(1.0, ""))
    base = quantity.to_base_units()
    return f"{base.m:.12g} {_spelled(base)}"


def is_unit(text: str) -> bool:
    """Whether it can be read as a unit of measure."""
    try:
        _parse(text.strip().removeprefix("[").removesuffix("]"), "")
    except UserError:
        return False
    return True


def is_duration(text: str) -> bool:
    """Whether it is a unit of time."""
    return is_unit(text) and _parse(text.strip().removeprefix("[").removesuffix("]"), "").check("[time]")


def duration(text: str) -> float | None:
    """Seconds of `"10 ms"`; None: it is no number with a unit of time."""
    number = FACTOR.match(text.strip())
    unit = text.strip()[number.end() :] if number else ""
    return float(convert(np.array([float(number[0])]), unit, "s", "")[0][0]) if number and is_duration(unit) else None


def is_position(unit: str | None) -> bool:
    """Whether it is an angle's or a way's."""
    if unit is None or not is_unit(unit):
        return False
    return dict(_base(_parse(unit, "")).u._units) in ({"radian": 1}, {"meter": 1})


def is_angle(unit: str | None) -> bool:
    """Whether it is an angle's: `deg`, `rad`, `rev`."""
    return is_position(unit) and dict(_base(_parse(str(unit), "")).u._units) == {"radian": 1}


def _spelled(quantity: pint.Quantity) -> str:
    return f"{quantity.u:~C}".replace("**", "").replace("*", ".") or "1"


@cache
def _registry() -> pint.UnitRegistry:
    registry: pint.UnitRegistry = pint.UnitRegistry()
    registry.define("@alias turn = rev")
    return registry


@cache
def _parse(unit: str, where: str, speed: bool = False) -> pint.Quantity:
    """A factor and a product of units, `9.84 mN.m`, `kg.m2/s`. speed: 1/min is a shaft's. UserError: anything else."""
    text = unit.strip().translate(SUPERSCRIPTS)
    try:
        if len(text) > LONGEST_UNIT:
            raise ValueError
        factor = FACTOR.match(text)
        text = text[factor.end() :].strip() if factor else text
        text = PER_THOUSAND_RPM.sub("/krpm", text)
        for written, read in TORQUES.items():
            text = written.sub(read, text)
        text = "rpm" if speed and text in PER_MINUTE else WHOLE.get(text, text)
        quantity = _product(_tokens(text)) if text != "1" else _registry().Quantity(1.0, "")
        if factor:
            quantity = _registry().Quantity(float(factor[0]) * quantity.m, quantity.u)
    except (pint.PintError, ValueError, TypeError, AttributeError, ArithmeticError) as error:
        raise UserError(
            f"{where}: unit {unit[:60]!r} is given, an SI spelling such as 'rad/s' or 'N.m' is needed"
        ) from error
    if not (np.isfinite(quantity.m) and quantity.m > 0):
        raise UserError(f"{where}: unit {unit!r} is given, its factor has to be positive; a sign is `sign = -1`")
    return quantity


def _tokens(text: str) -> list[re.Match[str]]:
    """Words with their powers, and what stands between them, the next one last. ValueError: something else."""
    found, at = [], 0
    while at < len(text):
        token = TOKEN.match(text, at)
        if token is None:
            raise ValueError(text)
        found.append(token)
        at = token.end()
    return found[::-1]


def _product(tokens: list[re.Match[str]]) -> pint.Quantity:
    """Words multiplied and divided, up to a closing bracket. Nothing is left to pint but the words themselves."""
    quantity, divide, wants = _registry().Quantity(1.0, ""), False, True
    while tokens and (token := tokens.pop())["op"] != ")":
        if token["op"] in (".", "*", "/"):
            divide, wants = token["op"] == "/", True
            continue
        next_ = (
            _registry().Quantity(1.0, "") if token["op"] == "1" else _word(token) if token["word"] else _product(tokens)
        )
        if quantity.u == _registry().Unit("") and not divide:
            quantity = next_  # a unit with an offset, degC, stands alone
        else:
            quantity = quantity / next_ if divide else quantity * next_
        divide, wants = False, False
    if wants:
        raise ValueError("a unit is missing")
    return quantity


def _word(token: re.Match[str]) -> pint.Quantity:
    word, power = token["word"].replace("Ohm", "ohm").replace("Ω", "ohm"), int(token["power"] or 1)
    if word in WORDS:
        quantity = _registry().Quantity(1.0, "degC") if word == "°C" else _product(_tokens(WORDS[word]))
    else:
        quantity = _registry().Quantity(1.0, word)
    return quantity if power == 1 else quantity**power


def _base(q: pint.Quantity) -> pint.Quantity:
    return _registry().Quantity(1.0, q.to_base_units().u)


def _leads(q: pint.Quantity) -> bool:
    """Whether it is a length per angle."""
    return dict(_base(q).u._units) == {"meter": 1, "radian": -1}


def _turns(q: pint.Quantity) -> bool:
    """Speeds only: is it an angle per time (rad/s, rpm) rather than a frequency (Hz, 1/s)? pint calls both 1/s."""
    base = _base(q).u
    return dict(base._units).get("second", 0) == -1 and dict(base._units).get("radian", 0) == 1
