"""Units as functions: states, inputs and parameters in, derivatives of states and outputs out, at many points at once.

A unit is such a function in initialization mode (FMI 2.0.4, 4.2.4), where its states have start values that may be set.
It has to list the derivatives of its states in its ModelStructure, as co-simulation units may (2.2.8).
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from ctypes import POINTER, c_char, c_double, c_int32, c_size_t, c_void_p

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import library
from cobot_joint.cosim.instances import Instance, SimulationError
from cobot_joint.cosim.native import Variables
from cobot_joint.system.model import Value

Array = NDArray[np.float64]
STEP = 1e-6  # of a variable's nominal value, of difference quotients where a unit gives no directional derivatives
_FUNCTIONS = {
    "reset": "fmi2Reset",
    "setup_experiment": "fmi2SetupExperiment",
    "enter_initialization_mode": "fmi2EnterInitializationMode",
    "set_real": "fmi2SetReal",
    "set_integer": "fmi2SetInteger",
    "set_boolean": "fmi2SetBoolean",
    "get_real": "fmi2GetReal",
    "get_directional_derivative": "fmi2GetDirectionalDerivative",
}


class PointFunction(ctypes.Structure):
    """As cosim.h has it."""

    _fields_ = [
        ("component", c_void_p),
        *((field, c_void_p) for field in _FUNCTIONS),
        *((field, Variables) for field in ("reals", "integers", "booleans")),
        ("real_values", POINTER(c_double)),
        ("integer_values", POINTER(c_int32)),
        ("boolean_values", POINTER(c_int32)),
        *((field, Variables) for field in ("known", "unknown", "directions")),
        ("message", c_char * 256),
    ]


class UnitFunction:
    """One unit as unknown(time, known). Uses the instance: a run of it has to begin anew afterwards.

    values: variable -> value at all points, over the component's own. known: states and inputs, unknown: derivatives
    of states and outputs, by name.
    """

    def __init__(
        self, instance: Instance, values: Mapping[str, Value], known: Sequence[str], unknown: Sequence[str]
    ) -> None:
        self.instance = instance
        self.values = {**instance.component.parameters, **values}
        self.known, self.unknown = tuple(known), tuple(unknown)

    @property
    def gives_derivatives(self) -> bool:
        """Whether the unit itself gives directional derivatives."""
        return bool(self.instance.description.coSimulation.providesDirectionalDerivative)

    def prepared(self, directions: Sequence[str]) -> PointFunction:
        """For calls from native code, each of them after `begin`."""
        return self._function(self.values, directions)

    def begin(self, f: PointFunction) -> None:
        """The instance is this function's until its next run."""
        self.instance.reset()  # not fresh any more: the next run resets it again
        f.component = self.instance.fmu.component

    def failure(self, f: PointFunction) -> SimulationError:
        """What a native call came to."""
        return self.instance.failure(f.message.decode())

    def __call__(self, time: Array, known: Array) -> Array:
        """(n, unknown) at the points time: (n,), known: (n, known). SimulationError: the unit refuses."""
        return self._at(self.values, time, known, ())[0]

    def jacobian(self, time: Array, known: Array, directions: Sequence[str]) -> Array:
        """Derivatives by known variables and parameters, by name: (n, unknown, directions)"""
        if self.gives_derivatives:
            return self._at(self.values, time, known, directions)[1].transpose(0, 2, 1)
        columns = [self._quotient(time, known, name) for name in directions]
        return np.stack(columns, axis=-1) if columns else np.zeros((len(time), len(self.unknown), 0))

    def _quotient(self, time: Array, known: Array, name: str) -> Array:
        return self._by_known(time, known, name) if name in self.known else self._by_parameter(time, known, name)

    def _by_known(self, time: Array, known: Array, name: str) -> Array:
        h = STEP * abs(float(self.instance.variables[name].nominal or 1.0))
        step = h * (np.arange(known.shape[1]) == self.known.index(name))
        return (self(time, known + step) - self(time, known - step)) / (2 * h)

    def _by_parameter(self, time: Array, known: Array, name: str) -> Array:
        value = float(self.values.get(name, self.instance.variables[name].start or 0.0))
        h = STEP * (abs(value) or 1.0)
        above, below = (self._at({**self.values, name: value + s * h}, time, known, ())[0] for s in (1, -1))
        return (above - below) / (2 * h)

    def _at(
        self, values: Mapping[str, Value], time: Array, known: Array, directions: Sequence[str]
    ) -> tuple[Array, Array]:
        """(n, unknown) and (n, directions, unknown)"""
        time, known = np.ascontiguousarray(time, dtype=float), np.ascontiguousarray(known, dtype=float)
        n, loaded = len(time), library.load()
        unknown = np.empty((n, len(self.unknown)))
        jacobian = np.empty((n, len(directions), len(self.unknown)))
        f = self._function(values, directions)
        self.begin(f)
        loaded.cosim_points.argtypes = [POINTER(PointFunction), c_size_t, c_void_p, c_void_p, c_void_p, c_void_p]
        status = loaded.cosim_points(
            ctypes.byref(f), n, time.ctypes.data, known.ctypes.data, unknown.ctypes.data,
            jacobian.ctypes.data if directions else None,
        )  # fmt: skip
        if status:
            raise self.failure(f)
        return unknown, jacobian

    def _function(self, values: Mapping[str, Value], directions: Sequence[str]) -> PointFunction:
        by_type: dict[str, dict[str, Value]] = {"Real": {}, "Integer": {}, "Boolean": {}}
        for name, value in values.items():
            kind = self.instance.variables[name].type
            by_type["Integer" if kind == "Enumeration" else kind][name] = value
        real, integer, boolean = by_type["Real"], by_type["Integer"], by_type["Boolean"]
        f = PointFunction(component=self.instance.fmu.component)
        for field, function in _FUNCTIONS.items():
            setattr(f, field, self.instance.address(function))
        f.reals, f.integers, f.booleans = (self._variables(v) for v in (real, integer, boolean))
        f.real_values = (c_double * len(real))(*(float(v) for v in real.values()))
        f.integer_values = (c_int32 * len(integer))(*(int(v) for v in integer.values()))
        f.boolean_values = (c_int32 * len(boolean))(*(bool(v) for v in boolean.values()))
        f.known, f.unknown, f.directions = (self._variables(v) for v in (self.known, self.unknown, directions))
        return f

    def _variables(self, names: Sequence[str] | Mapping[str, Value]) -> Variables:
        refs = [self.instance.variables[name].valueReference for name in names]
        return Variables(len(refs), (ctypes.c_uint32 * len(refs))(*refs))
