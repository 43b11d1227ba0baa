"""Jacobians of units joined along the wires, and matrix exponentials: linear.c, which holds no lock of Python's."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import POINTER, c_double, c_int32, c_size_t, c_void_p
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import SimulationError, library
from cobot_joint.cosim.points import PointFunction, UnitFunction

Array = NDArray[np.float64]
LOOP = -2


@dataclass(frozen=True)
class Unit:
    """A unit's part in a system. inner, outer: rows of its unknowns among the followed states and the outputs that are
    read; columns, factors: of its directions."""

    function: UnitFunction
    directions: Sequence[str]
    inner: Sequence[int]
    outer: Sequence[int]
    columns: Sequence[int]
    factors: Sequence[float]


class _Part(ctypes.Structure):
    _fields_ = [
        ("function", POINTER(PointFunction)),
        ("jacobian", c_void_p),
        *((f, c_size_t) for f in ("n_directions", "n_inner", "n_outer", "first_known")),
        *((f, POINTER(c_int32)) for f in ("inner", "outer", "column")),
        ("factor", POINTER(c_double)),
    ]


class _System(ctypes.Structure):
    _fields_ = [
        ("n_parts", c_size_t),
        ("parts", POINTER(_Part)),
        *((f, c_size_t) for f in ("n_x", "n_q", "n_u", "n_o", "n_y", "n_known")),
        *((f, c_void_p) for f in ("wires", "taps")),
        ("failed", c_int32),
    ]


class _Steps(ctypes.Structure):
    _fields_ = [
        *((f, c_size_t) for f in ("n", "m", "n_q")),
        ("h", c_double),
        *((f, c_void_p) for f in ("scale", "X", "A", "Phi", "Hold", "inputs")),
    ]


class System:
    """Units with their values, joined. sizes: n_x, n_q, n_u, n_o, n_y, n_known, as linear.h says; wires: (n_u, n_o),
    taps: (n_y, n_o)."""

    def __init__(self, units: Sequence[Unit], sizes: Sequence[int], wires: Array, taps: Array) -> None:
        self._units = list(units)
        self._functions = [unit.function.prepared(unit.directions) for unit in units]
        self._first = np.cumsum([0, *(len(unit.function.known) for unit in units)])
        self._parts = (_Part * len(units))(*map(self._part, range(len(units))))
        self._arrays = np.ascontiguousarray(wires), np.ascontiguousarray(taps)
        self._system = _System(len(units), self._parts, *sizes, *(M.ctypes.data for M in self._arrays))

    def jacobians(self, time: Array, known: Array, found: Sequence[Array]) -> None:
        """Fills X, Y, T and S of linear.h at the points time: (n,), known: (n, n_known). SimulationError: a unit
        refuses, or a loop of wires has no answer."""
        time, known = np.ascontiguousarray(time, dtype=np.float64), np.ascontiguousarray(known, dtype=np.float64)
        given = [self._given(k, time, known) for k in range(len(self._units))]
        for part, J in zip(self._parts, given, strict=True):
            part.jacobian = None if J is None else J.ctypes.data
        assert all(M.flags.c_contiguous for M in found)
        if _typed_library().linear_jacobians(
            ctypes.byref(self._system), len(time), time.ctypes.data, known.ctypes.data, *(M.ctypes.data for M in found)
        ):
            self._refuse()

    def _given(self, k: int, time: Array, known: Array) -> Array | None:
        """(n, directions, unknown) of a unit that gives no directional derivatives; None: it does."""
        unit, f = self._units[k], self._units[k].function
        if f.gives_derivatives:
            f.begin(self._functions[k])
            return None
        J = f.jacobian(time, known[:, self._first[k] : self._first[k + 1]], unit.directions)
        return np.ascontiguousarray(J.transpose(0, 2, 1))

    def _refuse(self) -> None:
        failed = int(self._system.failed)
        if failed >= 0:
            raise self._units[failed].function.failure(self._functions[failed])
        if failed == LOOP:
            raise SimulationError("a loop of wires has no answer to a small deviation")
        raise MemoryError("Jacobians")

    def _part(self, k: int) -> _Part:
        unit = self._units[k]
        inner, outer, columns = ((c_int32 * len(v))(*v) for v in (unit.inner, unit.outer, unit.columns))
        factors = (c_double * len(unit.factors))(*unit.factors)
        sizes = len(unit.directions), len(unit.inner), len(unit.outer), int(self._first[k])
        return _Part(ctypes.pointer(self._functions[k]), None, *sizes, inner, outer, columns, factors)


def steps(X: Array, h: float, scale: Array) -> tuple[Array, Array, Array, Array]:
    """A, Phi, Hold, and what the other columns of X add from sample to sample, of n steps of length h. X: (n, states,
    columns), the steps' Jacobians; scale: what counts as much of each state."""
    n, m, n_q = X.shape
    X, scale = (np.ascontiguousarray(M, dtype=np.float64) for M in (X, scale))
    A, Phi, Hold, inputs = (np.empty((n, m, size)) for size in (m, m, m, n_q - m))
    arrays = (scale, X, A, Phi, Hold, inputs)
    if _typed_library().linear_steps(ctypes.byref(_Steps(n, m, n_q, h, *(M.ctypes.data for M in arrays)))):
        raise MemoryError("the tangent")
    return A, Phi, Hold, inputs


def exponential(A: Array, h: float, scale: Array | None = None) -> tuple[Array, Array]:
    """e^(A h), and its integral from 0 to h; A: (n, m, m), in units of scale: (m,) of one size."""
    n, m = A.shape[:2]
    A = np.ascontiguousarray(A, dtype=np.float64)
    scale = np.ascontiguousarray(np.ones(m) if scale is None else scale, dtype=np.float64)
    E, integral = np.empty_like(A), np.empty_like(A)
    if _typed_library().linear_exponential(
        n, m, A.ctypes.data, h, scale.ctypes.data, E.ctypes.data, integral.ctypes.data
    ):
        raise MemoryError("matrix exponentials")
    return E, integral


@cache
def _typed_library() -> ctypes.CDLL:
    loaded = library.load()
    loaded.linear_jacobians.argtypes = [POINTER(_System), c_size_t, *[c_void_p] * 6]
    loaded.linear_steps.argtypes = [POINTER(_Steps)]
    loaded.linear_exponential.argtypes = [c_size_t, c_size_t, c_void_p, c_double, *[c_void_p] * 3]
    return loaded
