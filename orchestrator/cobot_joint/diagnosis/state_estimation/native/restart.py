"""Runs of a system along one clock from any of its rows, again and again: restart.c, without Python's lock."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import POINTER, c_char, c_double, c_int32, c_int64, c_size_t, c_uint32, c_void_p
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import Experiment, Simulation, SimulationError, isolation, library, native
from cobot_joint.cosim.instances import check_parameters
from cobot_joint.system.model import Connection, Inputs

Array = NDArray[np.float64]
_BEYOND, _STUCK = -3, 2  # restart.h, cosim.h
TYPES = {"Real": 0, "Integer": 1, "Enumeration": 1, "Boolean": 2}
_FUNCTIONS = ("Reset", "SetupExperiment", "EnterInitializationMode", "ExitInitializationMode", "SetReal", "SetInteger",
              "SetBoolean", "GetReal", "GetInteger", "GetBoolean")  # fmt: skip


class LostError(SimulationError):
    """A run from an estimated state goes far beyond all that was recorded: the estimate is lost."""

    def __init__(self) -> None:
        super().__init__("a run from an estimated state goes far beyond what was recorded")


class _Unit(ctypes.Structure):
    _fields_ = [("component", c_void_p), *((f, c_void_p) for f in _FUNCTIONS)]


class _Place(ctypes.Structure):
    _fields_ = [("unit", c_int32), ("type", c_int32), ("ref", c_uint32)]


class _Setting(ctypes.Structure):
    _fields_ = [("place", _Place), ("state", c_int32), ("value", c_double)]


class _Event(ctypes.Structure):
    _fields_ = [("tick", c_int64), ("place", _Place), ("value", c_double)]


class _Pass(ctypes.Structure):
    _fields_ = [("source", _Place), ("sink", _Place), ("factor", c_double), ("offset", c_double)]


class _Restart(ctypes.Structure):
    _fields_ = [
        *((f, c_size_t) for f in ("n_units", "n_settings", "n_events", "n_passes", "n_groups")),
        ("units", POINTER(_Unit)),
        ("settings", POINTER(_Setting)),
        ("events", POINTER(_Event)),
        ("passes", POINTER(_Pass)),
        *((f, POINTER(c_int32)) for f in ("groups", "loops")),
        ("stop_time", c_double),
        ("failed", c_int32),
        ("message", c_char * 256),
    ]


class _Run(ctypes.Structure):
    _fields_ = [
        *((f, c_int64) for f in ("first", "rows")),
        *((f, c_void_p) for f in ("x", "u", "samples", "breaks")),
        ("n_breaks", c_size_t),
        ("limits", c_void_p),
    ]


def restarts(simulation: Simulation) -> bool:
    """Whether all units are those of this package, in this process: of others, only a whole run knows how to begin."""
    units = [component.unit for component in simulation.system.components]
    return simulation.engine == "native" and all(
        isolation.is_shipped(u) and not isolation.is_isolated(u) for u in units
    )


class Restarts:
    """Of an experiment, from other states than those among its parameters and with other values of some inputs. A
    context manager; meanwhile the simulation may make other runs.

    states: `component.variable`, in order; limits: (recorded signals,), absolute values at which a run is given up: a
    gear that is set far outside of its gap takes millions of steps. SimulationError, UserError: the experiment cannot
    be begun.
    """

    def __init__(self, simulation: Simulation, experiment: Experiment, states: Sequence[str], limits: Array) -> None:
        self._limits = np.ascontiguousarray(limits, dtype=np.float64)
        self._simulation, self._inputs = simulation, experiment.inputs
        self._instances = list(simulation.instances.values())
        self._numbers = {instance.name: k for k, instance in enumerate(self._instances)}
        self._context = simulation._prepared(simulation._coupled(experiment))  # chooses scheme, step and tables
        self._run = self._context.__enter__()
        self.samples = np.array(list(experiment.inputs.values.values())).reshape(-1, len(experiment.inputs.time))
        self._restart = self._described(experiment, list(states))

    def __enter__(self) -> Restarts:
        return self

    def __exit__(self, *why: Any) -> None:
        self._context.__exit__(*why)

    def run(self, x: Array, first: int, rows: int) -> Array:
        """(rows, recorded), from the row `first` on, as `samples` has the inputs then. SimulationError: a unit fails;
        LostError: it is given up."""
        master = self._run.master
        assert isinstance(master, native.Master)
        table = np.empty((rows, len(self._run.names)))
        x, u = np.ascontiguousarray(x, dtype=np.float64), np.ascontiguousarray(self.samples[:, first])
        there = slice(first, first + rows)
        samples = dict(zip(self._inputs.values, self.samples[:, there], strict=True))
        inputs = Inputs(self._inputs.time[there], samples, self._inputs.held)
        breaks = self._simulation._breaks(self._run.scheme, inputs, self._run.clock)
        run = _Run(first, rows, x.ctypes.data, u.ctypes.data, self.samples.ctypes.data, breaks.ctypes.data,
                   len(breaks), self._limits.ctypes.data)  # fmt: skip
        for unit, instance in zip(self._units, self._instances, strict=True):
            unit.component = instance.fmu.component
        status = _typed_library().restart_run(
            ctypes.byref(self._restart), master._master, ctypes.byref(run), table.ctypes.data
        )
        if status == -2:
            raise MemoryError("a run")
        if status in (_BEYOND, _STUCK):
            raise LostError
        if status and self._restart.failed < 0:
            master._check(status)
        if status:
            raise self._instances[self._restart.failed].failure(self._restart.message.decode())
        return table

    def _described(self, experiment: Experiment, states: list[str]) -> _Restart:
        order = self._simulation._order
        passes = [[p for wire in group if (p := self._pass(wire)) is not None] for group in order]
        loops = [len(g) > 1 or g[0].source_component == g[0].sink_component for g in order]
        settings = self._settings(experiment, states)
        events = [
            _Event(tick, self._place(component, variable), float(value))  # type: ignore[arg-type]  # no Feedback here
            for tick, changes in self._run.events
            for component, values in changes.items()
            for variable, value in values.items()
        ]
        self._units = (_Unit * len(self._instances))(*(
            _Unit(i.fmu.component, *(i.address(f"fmi2{f}") for f in _FUNCTIONS)) for i in self._instances
        ))  # fmt: skip
        flat = [p for group in passes for p in group]
        return _Restart(
            len(self._instances), len(settings), len(events), len(flat), len(passes), self._units,
            (_Setting * len(settings))(*settings), (_Event * len(events))(*events), (_Pass * len(flat))(*flat),
            (c_int32 * len(passes))(*map(len, passes)), (c_int32 * len(loops))(*loops), experiment.stop_time,
        )  # fmt: skip

    def _settings(self, experiment: Experiment, states: list[str]) -> list[_Setting]:
        given = check_parameters(self._simulation.system, experiment.parameters)
        found = []
        for i in self._instances:
            for name, value in {**i.component.parameters, **given.get(i.name, {})}.items():
                full = f"{i.name}.{name}"
                number = states.index(full) if full in states else -1
                found.append(_Setting(self._place(i.name, name), number, float(value)))
        return found

    def _pass(self, wire: Connection) -> _Pass | None:
        """None: an input of the system that nothing drives."""
        to = self._place(str(wire.sink_component), wire.sink)
        if wire.source_component is not None:
            return _Pass(self._place(wire.source_component, wire.source), to, wire.factor, wire.offset)
        names = list(self._inputs.values)
        if wire.source not in names:
            return None
        return _Pass(_Place(-1, 0, names.index(wire.source)), to, wire.factor, wire.offset)

    def _place(self, component: str, name: str) -> _Place:
        number = self._numbers[component]
        variable = self._instances[number].variables[name]
        return _Place(number, TYPES[variable.type], variable.valueReference)


@cache
def _typed_library() -> ctypes.CDLL:
    loaded = library.load()
    loaded.restart_run.argtypes = [POINTER(_Restart), c_void_p, POINTER(_Run), c_void_p]
    return loaded
