"""What a unit of a parameter adds to states and readings along a run: effect.c, which holds no lock of Python's."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import POINTER, c_int32, c_size_t, c_void_p
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import library
from cobot_joint.cosim.native import Variables
from cobot_joint.cosim.points import PointFunction, UnitFunction

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Part:
    """Of a unit: parameters: one, or one for each column; inner, outer: rows of its unknowns among the followed states
    and the outputs that are read; time: (n,), known: (n, known variables)."""

    function: UnitFunction
    parameters: Sequence[str]
    inner: Sequence[int]
    outer: Sequence[int]
    time: Array
    known: Array


@dataclass(frozen=True)
class Answer:
    """Of the system: Phi and Hold: (n - 1, states, states) of one of so many points of a step, or, 0, of a whole step,
    whose ends are looked at then; T: (n - 1, states, outputs), S: (n, channels, outputs)."""

    points: int
    Phi: Array
    Hold: Array
    T: Array
    S: Array


class _Effect(ctypes.Structure):
    _fields_ = [
        ("function", POINTER(PointFunction)),
        ("jacobian", c_void_p),
        ("varied", Variables),
        ("values", c_void_p),
        *((f, c_size_t) for f in ("n", "n_columns", "n_known", "n_inner", "n_outer", "n_x", "n_o", "n_y", "points")),
        *((f, POINTER(c_int32)) for f in ("inner", "outer")),
        *((f, c_void_p) for f in ("time", "known", "Phi", "Hold", "T", "S", "psi", "direct")),
    ]


def along(part: Part, varied: Sequence[str], values: Array, answer: Answer) -> tuple[Array, Array]:
    """(n - 1, states, columns) and (n, channels, columns). varied: Real variables of the unit that differ from column
    to column, and how, (columns, varied). SimulationError: the unit refuses."""
    arrays = [part.time, part.known, answer.Phi, answer.Hold, answer.T, answer.S]
    time, known, Phi, Hold, T, S = (np.ascontiguousarray(M, dtype=np.float64) for M in arrays)
    values, n_c = np.ascontiguousarray(values, dtype=np.float64), len(values)
    psi, direct = np.empty((len(T), T.shape[1], n_c)), np.empty((len(S), S.shape[1], n_c))
    variables = part.function.instance.variables
    assert all(variables[name].type == "Real" for name in varied)  # else its number says another variable
    f = part.function.prepared(part.parameters)
    given = None if part.function.gives_derivatives else _given(part, varied, values)
    if given is None:
        part.function.begin(f)
    refs = [variables[name].valueReference for name in varied]
    sizes = len(time), n_c, known.shape[1], len(part.inner), len(part.outer), T.shape[1], T.shape[2], S.shape[1]
    assert given is None or not answer.points
    inner, outer = ((c_int32 * len(v))(*v) for v in (part.inner, part.outer))
    status = _typed_library().effect_along(ctypes.byref(_Effect(
        ctypes.pointer(f), None if given is None else given.ctypes.data,
        Variables(len(refs), (ctypes.c_uint32 * len(refs))(*refs)), values.ctypes.data, *sizes, answer.points, inner,
        outer, *(M.ctypes.data for M in (time, known, Phi, Hold, T, S, psi, direct)),
    )))  # fmt: skip
    if status == -2:
        raise MemoryError("a term's answer")
    if status:
        raise part.function.failure(f)
    return psi, direct


def _given(part: Part, varied: Sequence[str], values: Array) -> Array:
    """(n, columns, unknown) at the samples, of a unit that gives no directional derivatives."""
    f, found = part.function, []
    for column in values if len(part.parameters) == 1 else values[:1]:
        own = UnitFunction(f.instance, {**f.values, **dict(zip(varied, map(float, column), strict=True))}, f.known,
                           f.unknown)  # fmt: skip
        found.append(own.jacobian(part.time, part.known, part.parameters))
    return np.ascontiguousarray(np.concatenate(found, axis=2).transpose(0, 2, 1))


@cache
def _typed_library() -> ctypes.CDLL:
    loaded = library.load()
    loaded.effect_along.argtypes = [POINTER(_Effect)]
    return loaded
