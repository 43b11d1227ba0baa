"""The units of a system as FMI instances: loaded once, reset, parametrised and initialised before every run."""

from __future__ import annotations

import ctypes
import re
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from fmpy import calloc, free
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)

from cobot_joint.cosim import isolation, library
from cobot_joint.errors import UserError
from cobot_joint.system.model import Component, System, Value
from cobot_joint.system.parameters import checked, split

TERMINATED = 3  # fmi2StatusKind


class SimulationError(RuntimeError):
    """A run failed: which unit, which call, at what time, and what the unit logged last."""


class UnfitError(SimulationError):
    """A scheme is not for this run: it takes too many steps, or a unit's output follows from no state and no input."""


class UnitEndedError(SimulationError):
    """The process of an isolated unit ended: a crash, an exit, or a call that took too long.

    `component`: whose unit; `how`: the call and what became of it, without the time and what was set last.
    """

    def __init__(self, component: str, words: str) -> None:
        super().__init__(f"{component}: {words}")
        self.component = component
        self.how = re.sub(r" at t = \S+ s", "", words.split("; ")[0])


class _Log(ctypes.Structure):
    _fields_ = [("last", ctypes.c_char * 1024)]


_LOADING = threading.Lock()  # FMPy changes the working directory while it loads a library, for all threads


class Instance:
    """One component's FMU, loaded and instantiated; in a process of its own where `isolation` says so."""

    def __init__(self, component: Component) -> None:
        """UserError: the FMU cannot be loaded here or does not instantiate. SimulationError: it crashes there."""
        self.component = component
        self.name = component.name
        self.description = component.unit.description
        self.variables = component.unit.variables
        self._log = _Log()
        self._isolation = isolation.Isolation(component.unit) if isolation.is_isolated(component.unit) else None
        self._callbacks = self._make_callbacks()
        try:
            with _LOADING:
                self.fmu = FMU2Slave(
                    guid=self.description.guid,
                    modelIdentifier=self.description.coSimulation.modelIdentifier,
                    unzipDirectory=str(component.unit.directory),
                    instanceName=component.name,
                    libraryPath=str(library.path()) if self._isolation else None,
                    requireFunctions=False,
                )
        except Exception as error:  # FMPy raises bare Exceptions when a library does not load
            raise UserError(f"{self.name} ({component.source}): {error}") from error
        self._instantiate()
        self._fresh = True

    def _instantiate(self) -> None:
        if self._isolation:
            self._isolation.prepare()
        try:
            self.fmu.instantiate(callbacks=self._callbacks)
        except Exception as error:  # as above
            outcome = self._isolation.outcome if self._isolation else "refused"
            where = f"{self.name} ({self.component.source})"
            if outcome == "ended":
                raise SimulationError(f"{where}{self.last_words()}") from error
            if outcome == "no process":
                raise SimulationError(f"{where}: no process could be started for it") from error
            what = "its library cannot be opened" if outcome == "not opened" else "it does not instantiate"
            raise UserError(f"{where}: {what}{self.last_words()}") from error

    def _make_callbacks(self) -> fmi2CallbackFunctions:
        """No Python in them: units call them in the middle of native stepping."""
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = ctypes.cast(library.load().cosim_log, fmi2CallbackLoggerTYPE)
        callbacks.allocateMemory = ctypes.cast(calloc, fmi2CallbackAllocateMemoryTYPE)
        callbacks.freeMemory = ctypes.cast(free, fmi2CallbackFreeMemoryTYPE)
        callbacks.componentEnvironment = ctypes.addressof(self._log)
        return callbacks

    @property
    def interpolates(self) -> bool:
        return bool(self.description.coSimulation.canInterpolateInputs)

    @property
    def gives_slopes(self) -> bool:
        return int(self.description.coSimulation.maxOutputDerivativeOrder or 0) >= 1

    @property
    def rolls_back(self) -> bool:
        return bool(self.description.coSimulation.canGetAndSetFMUstate)

    @property
    def varies_step(self) -> bool:
        return bool(self.description.coSimulation.canHandleVariableCommunicationStepSize)

    def last_words(self) -> str:
        """What the unit logged last, to end an error message with."""
        said = " ".join(self._log.last.decode("utf-8", "replace").split())
        return f": {said}" if said else ""

    @property
    def ended(self) -> str | None:
        """How the process of an isolated unit ended; None: it runs, or it is not isolated."""
        return isolation.ended(self.fmu.component) if self._isolation and self.fmu.component else None

    def failure(self, said: str) -> SimulationError:
        """What happened to the process, or what is `said` of the call and what the unit logged last."""
        ended = self.ended
        return UnitEndedError(self.name, ended) if ended else SimulationError(f"{self.name}: {said}{self.last_words()}")

    @contextmanager
    def explained(self, what: str) -> Iterator[None]:
        """Failing FMI calls inside name the unit and say what was being done."""
        try:
            yield
        except FMICallException as error:
            status = ("ok", "warning", "discard", "error", "fatal", "pending")[error.status]
            raise self.failure(f"{error.function} returned {status} {what}") from error

    def asks_to_stop(self) -> bool:
        """After a discarded step: whether that is because the unit wants the simulation to end (FMI 2.0.4, 4.2.3)."""
        try:
            return bool(self.fmu.getBooleanStatus(TERMINATED))
        except FMICallException:  # it keeps no such status
            return False

    def address(self, function: str) -> int | None:
        """Of a function in the FMU's library; None where it has none of that name."""
        pointer = getattr(self.fmu.dll, function, None)
        return None if pointer is None else ctypes.cast(pointer, ctypes.c_void_p).value

    @property
    def field(self) -> int | None:
        """Address of the unit's vector field (fmus/core/field.h); None: it is not ours, or in a process of its own."""
        function = None if self._isolation else getattr(self.fmu.dll, "cobot_joint_field", None)
        if function is None:
            return None
        function.restype, function.argtypes = ctypes.c_void_p, []
        return function()

    def reset(self) -> None:
        """To the state after instantiation; a unit that cannot is instantiated anew."""
        self._log.last = b""
        if self._fresh:
            self._fresh = False
            return
        try:
            self.fmu.reset()
        except FMICallException:
            self.fmu.fmi2FreeInstance(self.fmu.component)
            self.fmu.component = None
            self._log.last = b""
            self._instantiate()

    def close(self) -> None:
        """Free it. SimulationError: its process ended meanwhile."""
        if self.fmu.component is None:
            return
        self.fmu.fmi2FreeInstance(self.fmu.component)
        self.fmu.component = None
        self.fmu.freeLibrary()
        if self._isolation and (words := isolation.ended(None)):
            raise UnitEndedError(self.name, words)

    def set(self, name: str, value: Value) -> None:
        """Any variable by name; the FMU judges whether the moment allows it."""
        variable = self.variables[name]
        vr = [variable.valueReference]
        if variable.type == "Real":
            self.fmu.setReal(vr, [float(value)])
        elif variable.type in ("Integer", "Enumeration"):
            self.fmu.setInteger(vr, [int(value)])
        elif variable.type == "Boolean":
            self.fmu.setBoolean(vr, [bool(value)])
        else:
            self.fmu.setString(vr, [str(value)])

    def get(self, name: str) -> float:
        """A Real, Integer or Boolean variable."""
        variable = self.variables[name]
        vr = [variable.valueReference]
        if variable.type == "Real":
            return float(self.fmu.getReal(vr)[0])
        if variable.type == "Boolean":
            return float(self.fmu.getBoolean(vr)[0])
        return float(self.fmu.getInteger(vr)[0])


def check_parameters(
    system: System, parameters: Mapping[str, Value], during: bool = False
) -> dict[str, dict[str, Value]]:
    """`component.variable` -> value, checked, by component. `during`: to be set while time runs.

    UserError: no such component or parameter, a value outside its bounds, or one that cannot change while time runs.
    """
    by_component: dict[str, dict[str, Value]] = {}
    for name, value in parameters.items():
        component, variable_name = split(system, name, "parameters")
        value = checked(component.unit, variable_name, value, f"parameters: {name}")
        variable = component.unit.variables[variable_name]
        if during and variable.causality == "parameter" and variable.variability != "tunable":
            raise UserError(f"parameters: {name} is {variable.variability}: it can only be set before a run")
        by_component.setdefault(component.name, {})[variable_name] = value
    return by_component
