"""What no list names as a unit of its own: the precompiled correction with a formula or a table for parameters."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cobot_joint.errors import UserError

FEATURES, SIGNALS, POINTS = 8, 4, 64  # what fmus/correction has room for
FUNCTIONS = ("one", "u", "u2", "u3", "abs", "tanh", "sin", "cos", "exp", "gauss", "eddy")
NUMBER = {name: k for k, name in enumerate(FUNCTIONS, 1)}
TIME = "t"
SGN = 1e-3  # scale of a sign: its tanh is a step for every signal of a bench
_VALUES: dict[str, Callable[[NDArray[np.float64], float], NDArray[np.float64]]] = {
    "u": lambda u, p: u,
    "u2": lambda u, p: u**2,
    "u3": lambda u, p: u**3,
    "abs": lambda u, p: np.abs(u),
    "tanh": lambda u, p: np.tanh(u / p),
    "sin": lambda u, p: np.sin(p * u),
    "cos": lambda u, p: np.cos(p * u),
    "exp": lambda u, p: np.exp(-np.abs(u) / p),
    "gauss": lambda u, p: np.exp(-((u / p) ** 2)),
    "eddy": lambda u, p: (u / p) / (1 + (u / p) ** 2),
}


@dataclass(frozen=True)
class Factor:
    """f(signal) of a product; p: scale or frequency."""

    signal: str
    function: str
    p: float = 1.0

    def __str__(self) -> str:
        """As `parse` reads it."""
        name, p = self.signal, f"{self.p:g}"
        if self.function == "tanh":
            return f"sgn({name})" if self.p == SGN else f"tanh({name}/{p})"
        if self.function == "exp":
            return f"exp(-{name}/{p})" if name == TIME else f"exp(-abs({name})/{p})"
        return {
            "u": name,
            "u2": f"{name}^2",
            "u3": f"{name}^3",
            "abs": f"abs({name})",
            "sin": f"sin({p}*{name})",
            "cos": f"cos({p}*{name})",
            "gauss": f"exp(-({name}/{p})^2)",
            "eddy": f"eddy({name}/{p})",
        }[self.function]

    def of(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """As the unit computes it, equations.c. u: of the signal, (n,)"""
        return np.asarray(_VALUES[self.function](u, self.p))


@dataclass(frozen=True)
class Product:
    """A summand of a formula, without its coefficient; without factors it is 1."""

    factors: tuple[Factor, ...] = ()

    def __str__(self) -> str:
        """As `parse` reads it."""
        return "*".join(str(factor) for factor in self.factors) or "1"

    @property
    def signals(self) -> tuple[str, ...]:
        """That it depends on, the time not among them."""
        return tuple(dict.fromkeys(f.signal for f in self.factors if f.signal != TIME))

    def renamed(self, names: Mapping[str, str]) -> Product:
        """The same over other signals; those without another name, and the time, stay."""
        return Product(tuple(replace(f, signal=names.get(f.signal, f.signal)) for f in self.factors))

    def of(self, signals: Mapping[str, NDArray[np.float64]], time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Its values, (n,). signals: name -> (n,); time: since the run began, s."""
        values = np.ones_like(time)
        for factor in self.factors:
            values = values * factor.of(time if factor.signal == TIME else signals[factor.signal])
        return values


def formula_parameters(
    terms: Sequence[tuple[float, str]], onset: float | None = None
) -> tuple[dict[str, float], list[str]]:
    """Parameters of the correction unit for sum of coefficient*form, and the signals to wire to u1, u2, ...

    Forms are products such as `sin(2*phi_b)*sgn(w_b)`, `w^2`, `tanh(w/0.5)`, `exp(-(i/2)^2)`, `exp(-t/4)*w`; `t` is the
    time, which needs no wire. UserError: a form that the unit has no room for.
    """
    products = [(coefficient, *parse(form)) for coefficient, form in terms]
    slots = _slots([factors for _, _, factors in products])
    if len(products) > FEATURES or len(slots) > SIGNALS:
        raise UserError(
            f"a formula of {len(products)} terms in {', '.join(slots)} is given, "
            f"{FEATURES} terms in {SIGNALS} signals at most are allowed"
        )
    values: dict[str, float] = {"onset.t": onset} if onset else {}
    values |= _clock(slots)
    for k, (coefficient, constant, factors) in enumerate(products, 1):
        values[f"feature{k}.A"] = coefficient * constant
        free = list(range(len(slots)))
        for factor in factors:
            j = next(j for j in free if slots[j] == factor.signal)
            free.remove(j)
            values[f"feature{k}.f{j + 1}"] = NUMBER[factor.function]
            values[f"feature{k}.p{j + 1}"] = factor.p
    return values, [s for s in slots if s != TIME]


def has_room(products: Sequence[Product]) -> bool:
    """Whether the unit can compute their sum."""
    return len(products) <= FEATURES and len(_slots([product.factors for product in products])) <= SIGNALS


def _slots(products: Sequence[Sequence[Factor]]) -> list[str]:
    """Signals by input of the unit: one that a product has twice takes two, the time comes last."""
    slots: list[str] = []
    for factors in products:
        own = [f.signal for f in factors]
        slots += [s for s in dict.fromkeys(own) for _ in range(own.count(s) - slots.count(s))]
    return sorted(slots, key=lambda s: s == TIME)


def _clock(slots: Sequence[str]) -> dict[str, float]:
    return {"clock.u": slots.index(TIME) + 2} if TIME in slots else {}  # choices count from 1, the first is none


def table_parameters(
    signal: str,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    onset: float | None = None,
    *,
    period: float = 0.0,
    factor: str = "",
) -> tuple[dict[str, float], list[str]]:
    """Parameters for factor*y(signal), linear between points, held outside, and the signals to wire to u1, u2.

    factor: one function, such as `sgn(w)`. period: of a table over an angle. More points than the unit has room for
    are resampled. UserError: no point is finite.
    """
    order = np.argsort(x)
    x, y = np.asarray(x, dtype=float)[order], np.asarray(y, dtype=float)[order]
    keep = np.isfinite(x) & np.isfinite(y) & np.concatenate([[True], np.diff(x) > 0])
    x, y = x[keep], y[keep]
    if len(x) > POINTS:
        grid = np.linspace(x[0], x[-1], POINTS)
        x, y = grid, np.interp(grid, x, y)
    if not len(x):
        raise UserError("a table without a finite point is given")
    names = [f"{row}{column}" for row in range(1, 9) for column in range(1, 9)]
    values: dict[str, float] = {"table.n": len(x)} | ({"onset.t": onset} if onset else {})
    values |= {f"table.x{name}": float(v) for name, v in zip(names, x, strict=False)}
    values |= {f"table.y{name}": float(v) for name, v in zip(names, y, strict=False)}
    values |= {"table.period": period} if period else {}
    slots = [signal]
    if factor:
        _, (only,) = parse(factor)
        values |= {"table.f2": NUMBER[only.function], "table.p2": only.p}
        slots.append(only.signal)
    return values | _clock(slots), [s for s in slots if s != TIME]


def parse(form: str) -> tuple[float, list[Factor]]:
    """(constant, factors) of a product of functions. UserError: it is none."""
    try:
        return _product(ast.parse(form.replace("^", "**"), mode="eval").body)
    except (SyntaxError, ValueError, ZeroDivisionError) as error:
        raise UserError(
            f"form {form!r} is given, a product of {', '.join(FUNCTIONS[1:])}, sgn of signals is needed"
        ) from error


def _product(node: ast.expr) -> tuple[float, list[Factor]]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        (a, left), (b, right) = _product(node.left), _product(node.right)
        return a * b, left + right
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        constant, factors = _product(node.operand)
        return -constant, factors
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        return float(node.value), []
    return 1.0, [_factor(node)]


def _factor(node: ast.expr) -> Factor:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        power = ast.literal_eval(node.right)
        if power in (2, 3):
            return Factor(_name(node.left), f"u{power}")
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and len(node.args) == 1:
        return _call(node.func.id, node.args[0])
    return Factor(_name(node), "u")


def _call(function: str, argument: ast.expr) -> Factor:
    if function == "abs":
        return Factor(_name(argument), "abs")
    if function in ("sgn", "sign"):
        return Factor(_name(argument), "tanh", SGN)
    if function in ("sin", "cos"):
        scale, signal = _scaled(argument)
        return Factor(signal, function, scale)
    if function in ("tanh", "eddy"):
        scale, signal = _scaled(argument)
        return Factor(signal, function, 1 / scale)
    if function == "exp":
        return _decay(argument)
    raise ValueError(function)


def _decay(node: ast.expr) -> Factor:
    """Of exp: -(w/p)^2, -abs(w)/p or -t/p"""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and isinstance(node.operand, ast.BinOp):
        if isinstance(node.operand.op, ast.Pow) and ast.literal_eval(node.operand.right) == 2:
            scale, signal = _scaled(node.operand.left)
            return Factor(signal, "gauss", 1 / abs(scale))
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div) and isinstance(node.left, ast.UnaryOp):
        factor = _factor(node.left.operand)
        falls = factor.function == "abs" or factor.signal == TIME  # time does not change its sign
        if falls and isinstance(node.left.op, ast.USub):
            return Factor(factor.signal, "exp", float(ast.literal_eval(node.right)))
    raise ValueError(ast.dump(node))


def _scaled(node: ast.expr) -> tuple[float, str]:
    """n*signal or signal/p -> (n or 1/p, signal)"""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        return float(ast.literal_eval(node.left)), _name(node.right)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
        return 1 / float(ast.literal_eval(node.right)), _name(node.left)
    return 1.0, _name(node)


def _name(node: ast.expr) -> str:
    """`phi_b`, or `component.variable`"""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        return f"{_name(node.value)}.{node.attr}"
    raise ValueError(ast.dump(node))
