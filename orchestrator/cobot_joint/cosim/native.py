"""The master in native code (master/master.c), over the FMUs' own function pointers."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_char_p, c_double, c_int32, c_int64, c_size_t, c_uint32, c_void_p
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import library
from cobot_joint.cosim.clock import Clock
from cobot_joint.cosim.instances import SimulationError, UnfitError
from cobot_joint.cosim.plan import Plan, PlannedUnit, Wire
from cobot_joint.cosim.schemes import Scheme
from cobot_joint.system.model import Inputs

_UNFIT = 1  # cosim.h


class _Wire(ctypes.Structure):
    _fields_ = [("signal", c_int32), ("factor", c_double), ("offset", c_double)]


class Variables(ctypes.Structure):
    _fields_ = [("n", c_size_t), ("refs", POINTER(c_uint32))]


_FUNCTIONS = {
    "set_real": "fmi2SetReal",
    "set_integer": "fmi2SetInteger",
    "set_boolean": "fmi2SetBoolean",
    "get_real": "fmi2GetReal",
    "get_integer": "fmi2GetInteger",
    "get_boolean": "fmi2GetBoolean",
    "set_real_input_derivatives": "fmi2SetRealInputDerivatives",
    "get_real_output_derivatives": "fmi2GetRealOutputDerivatives",
    "do_step": "fmi2DoStep",
    "get_state": "fmi2GetFMUstate",
    "set_state": "fmi2SetFMUstate",
    "free_state": "fmi2FreeFMUstate",
}
_VARIABLES = [f"{kind}_{role}" for role in ("inputs", "outputs", "watched") for kind in ("real", "integer", "boolean")]


class _Unit(ctypes.Structure):
    _fields_ = [
        ("name", c_char_p),
        ("component", c_void_p),
        *((field, c_void_p) for field in _FUNCTIONS),
        *((field, Variables) for field in _VARIABLES[:3]),
        ("wires", POINTER(_Wire)),
        *((field, Variables) for field in _VARIABLES[3:]),
        ("first_signal", c_int32),
        ("input_order", c_int32),
        ("holds_end", c_int32),
        ("stairs", c_int32),
        ("output_derivatives", c_int32),
        ("field", c_void_p),
        ("is_sink", c_int32),
    ]


class _Flow(ctypes.Structure):
    _fields_ = [("given", c_int32), ("taken", c_int32), ("power", c_double)]


class _Port(ctypes.Structure):
    _fields_ = [("unit", c_int32), ("input", c_int32), ("output", c_int32)]


class _Scheme(ctypes.Structure):
    _fields_ = [
        *((field, c_int32) for field in ("sequential", "extrapolation", "interpolation", "sweeps", "adaptive")),
        ("tolerance", c_double),
        ("pace", c_double),
    ]


class _Plan(ctypes.Structure):
    _fields_ = [
        ("n_units", c_size_t),
        ("units", POINTER(_Unit)),
        ("n_outputs", c_size_t),
        ("n_inputs", c_size_t),
        ("nominal", POINTER(c_double)),
        ("judged", POINTER(c_int32)),
        ("n_flows", c_size_t),
        ("flows", POINTER(_Flow)),
        ("n_ports", c_size_t),
        ("ports", POINTER(_Port)),
        ("n_samples", c_size_t),
        ("sample_time", c_void_p),
        ("samples", c_void_p),
        ("held", c_void_p),
        ("n_recorded", c_size_t),
        ("recorded", POINTER(_Wire)),
        ("limits", c_void_p),
        ("start_time", c_double),
        ("step", c_double),
        ("ticks_per_record", c_int64),
        ("max_stride", c_int64),
        ("n_breaks", c_size_t),
        ("breaks", c_void_p),
        ("n_ordered", c_size_t),
        ("order", POINTER(c_int32)),
        ("scheme", _Scheme),
    ]


_COUNTERS = ("steps", "rejected", "sweeps", "warnings")


class _Counters(ctypes.Structure):
    _fields_ = [(field, c_int64) for field in _COUNTERS]


class Tables:
    """A plan in the form that native code reads; made once for all runs of the plan."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._alive: list[object] = []  # arrays that the structures point into
        self.units = (_Unit * len(plan.units))(*(self._unit(unit) for unit in plan.units))
        self.nominal = (c_double * len(plan.nominal))(*plan.nominal)
        self.judged = (c_int32 * len(plan.judged))(*plan.judged)
        self.flows = (_Flow * len(plan.flows))(*(_Flow(f.given, f.taken, f.power) for f in plan.flows))
        self.ports = (_Port * len(plan.ports))(*(_Port(p.unit, p.input, p.output) for p in plan.ports))
        self.recorded = _wires(plan.recorded)
        self.order = (c_int32 * len(plan.order))(*plan.order)

    def _unit(self, planned: PlannedUnit) -> _Unit:
        unit = _Unit(name=planned.instance.name.encode())
        for field, function in _FUNCTIONS.items():
            setattr(unit, field, planned.instance.address(function))
        columns = (*planned.inputs, *planned.outputs, *planned.watched)
        for field, refs in zip(_VARIABLES, columns, strict=True):
            array = (c_uint32 * len(refs))(*refs)
            self._alive.append(array)
            setattr(unit, field, Variables(len(refs), array))
        wires = _wires(planned.wires)
        self._alive.append(wires)
        unit.wires = wires
        unit.first_signal = planned.first_signal
        unit.input_order = planned.input_order
        unit.holds_end = planned.holds_end
        unit.stairs = planned.stairs
        unit.output_derivatives = planned.output_derivatives
        unit.field = planned.instance.field
        unit.is_sink = planned.is_sink
        return unit


class Master:
    """master.c over one plan. `inputs`: those of the plan, in its order; `breaks`: int64[n], ticks; see cosim.h."""

    def __init__(
        self,
        tables: Tables,
        scheme: Scheme,
        inputs: Inputs,
        clock: Clock,
        breaks: NDArray[np.int64],
    ) -> None:
        self._library = _typed_library()
        self._tables = tables
        time = np.ascontiguousarray(inputs.time, dtype=np.float64)
        samples = np.array(list(inputs.values.values()), dtype=np.float64).reshape(len(inputs.values), len(time))
        held = np.array([name in inputs.held for name in inputs.values], dtype=np.int32)
        self._arrays = (time, samples, held, breaks)
        for unit, planned in zip(tables.units, tables.plan.units, strict=True):
            unit.component = planned.instance.fmu.component
        plan = _Plan(
            n_units=len(tables.units),
            units=tables.units,
            n_outputs=tables.plan.n_outputs,
            n_inputs=len(tables.plan.inputs),
            nominal=tables.nominal,
            judged=tables.judged,
            n_flows=len(tables.flows),
            flows=tables.flows,
            n_ports=len(tables.ports),
            ports=tables.ports,
            n_samples=len(time),
            sample_time=time.ctypes.data,
            samples=samples.ctypes.data,
            held=held.ctypes.data,
            n_recorded=len(tables.recorded),
            recorded=tables.recorded,
            start_time=clock.start,
            step=clock.step,
            ticks_per_record=clock.per_row,
            max_stride=clock.stride,
            n_breaks=len(breaks),
            breaks=breaks.ctypes.data,
            n_ordered=len(tables.order),
            order=tables.order,
            scheme=_Scheme(
                scheme.sequential,
                scheme.extrapolation,
                scheme.interpolation,
                scheme.sweeps,
                scheme.adaptive,
                scheme.tolerance,
                scheme.pace,
            ),
        )
        self._master: c_void_p | None = self._library.cosim_create(ctypes.byref(plan))
        if not self._master:
            raise MemoryError("the co-simulation master")

    def begin(self) -> None:
        """Tick 0, from the units' present state."""
        self._check(self._library.cosim_begin(self._master, 0))

    def resume(self) -> None:
        """After values were set in units from outside: signals that jumped take their past with them."""
        self._check(self._library.cosim_resume(self._master))

    def advance(self, tick: int, rows: NDArray[np.float64]) -> None:
        """On to `tick`; `rows`: float64[recorded points passed, recorded signals], filled."""
        self._check(self._library.cosim_advance(self._master, tick, rows.ctypes.data))

    def record(self, row: NDArray[np.float64]) -> None:
        """The present point; `row`: float64[recorded signals], filled."""
        self._check(self._library.cosim_record(self._master, row.ctypes.data))

    def rows(self) -> int:
        """Recorded since tick 0: what is there when a unit fails."""
        return int(self._library.cosim_rows(self._master))

    def counters(self) -> dict[str, int]:
        """Steps taken, steps rejected, sweeps over the units, warnings that units returned."""
        counters = _Counters()
        self._library.cosim_counters(self._master, ctypes.byref(counters))
        return {field: getattr(counters, field) for field in _COUNTERS}

    @property
    def tick(self) -> int:
        """Communication point that the last whole step ended at."""
        return int(self._library.cosim_tick(self._master))

    def works(self) -> list[tuple[float, float]]:
        """Per port of the plan: work since the start, integral of its power's absolute value; variables' units."""
        n = len(self._tables.ports)
        work, absolute = (c_double * n)(), (c_double * n)()
        self._library.cosim_works(self._master, work, absolute)
        return list(zip(work, absolute, strict=True))

    def close(self) -> None:
        """Free what the master holds, saved FMU states too. Before the instances go."""
        if self._master:
            self._library.cosim_destroy(self._master)
            self._master = None

    def _check(self, status: int) -> None:
        if status == 0:
            return
        message = self._library.cosim_message(self._master).decode("utf-8", "replace")
        failed = next((u.instance for u in self._tables.plan.units if message.startswith(f"{u.instance.name}:")), None)
        if failed:
            raise failed.failure(message.removeprefix(f"{failed.name}: "))
        raise UnfitError(message) if status == _UNFIT else SimulationError(message)


def _wires(wires: tuple[Wire, ...]) -> ctypes.Array[_Wire]:
    return (_Wire * len(wires))(*(_Wire(w.signal, w.factor, w.offset) for w in wires))


@cache
def _typed_library() -> ctypes.CDLL:
    loaded = library.load()
    loaded.cosim_create.argtypes = [POINTER(_Plan)]
    loaded.cosim_create.restype = c_void_p
    loaded.cosim_destroy.argtypes = [c_void_p]
    loaded.cosim_destroy.restype = None
    loaded.cosim_begin.argtypes = [c_void_p, c_int64]
    loaded.cosim_resume.argtypes = [c_void_p]
    loaded.cosim_advance.argtypes = [c_void_p, c_int64, c_void_p]
    loaded.cosim_record.argtypes = [c_void_p, c_void_p]
    loaded.cosim_rows.argtypes = [c_void_p]
    loaded.cosim_rows.restype = c_int64
    loaded.cosim_message.argtypes = [c_void_p]
    loaded.cosim_message.restype = c_char_p
    loaded.cosim_tick.argtypes = [c_void_p]
    loaded.cosim_tick.restype = c_int64
    loaded.cosim_works.argtypes = [c_void_p, POINTER(c_double), POINTER(c_double)]
    loaded.cosim_works.restype = None
    loaded.cosim_counters.argtypes = [c_void_p, POINTER(_Counters)]
    loaded.cosim_counters.restype = None
    return loaded
