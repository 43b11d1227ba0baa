"""One unit alone in a test's hands: FMPy's functions under variable names, and every message that it logs."""

from __future__ import annotations

import ctypes
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import calloc, free
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.logging import addLoggerProxy

from cobot_joint.units import Unit, find_fmu, load_unit

UNITS = sorted(table.parent.name for table in (Path(__file__).parents[2] / "fmus").glob("*/model.def"))

OTHER_GUID = "{12345678-0000-0000-0000-000000000000}"

Values = Mapping[str, float]
Signals = dict[str, np.ndarray]
Signal = Callable[[float], float]

LOGGERS: list[fmi2CallbackFunctions] = []  # FMPy's proxy goes on calling the last one given to it, for any FMU


class Slave:
    """An instantiated FMU. Names of variables in place of references; `log` holds what it said."""

    def __init__(self, unit: Unit) -> None:
        self.unit = unit
        self.log: list[str] = []
        self.time = 0.0
        self.fmu = FMU2Slave(
            guid=unit.description.guid,
            modelIdentifier=unit.description.coSimulation.modelIdentifier,
            unzipDirectory=str(unit.directory),
            instanceName=unit.name,
        )
        self.callbacks = self._callbacks()
        self.fmu.instantiate(callbacks=self.callbacks)

    def _callbacks(self) -> fmi2CallbackFunctions:
        def logger(_environment: int, _name: bytes, _status: int, _category: bytes, message: bytes) -> None:
            self.log.append(message.decode())

        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(logger)
        callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        addLoggerProxy(ctypes.byref(callbacks))
        LOGGERS.append(callbacks)
        return callbacks

    def initialise(self, start: Values | None = None, tolerance: float | None = None) -> Slave:
        self.fmu.setupExperiment(tolerance=tolerance)
        self.fmu.enterInitializationMode()
        self.set(start or {})
        self.fmu.exitInitializationMode()
        self.time = 0.0
        return self

    def vr(self, *names: str) -> list[int]:
        return [self.unit.variables[name].valueReference for name in names]

    def set(self, values: Values) -> None:
        for name, value in values.items():
            kind = self.unit.variables[name].type
            if kind == "Real":
                self.fmu.setReal(self.vr(name), [value])
            elif kind == "Boolean":
                self.fmu.setBoolean(self.vr(name), [bool(value)])
            else:
                self.fmu.setInteger(self.vr(name), [int(value)])

    def slope(self, name: str, *derivatives: float) -> None:
        """First, second and third derivative of an input, from now on."""
        orders = list(range(1, len(derivatives) + 1))
        self.fmu.setRealInputDerivatives(self.vr(name) * len(orders), orders, list(derivatives))

    def rate(self, name: str) -> float:
        """Time derivative of a state or an output, as the unit gives it."""
        return float(self.fmu.getRealOutputDerivatives(self.vr(name), [1])[0])

    def __getitem__(self, name: str) -> float:
        kind = self.unit.variables[name].type
        if kind == "Real":
            return float(self.fmu.getReal(self.vr(name))[0])
        if kind == "Boolean":
            return float(self.fmu.getBoolean(self.vr(name))[0])
        return float(self.fmu.getInteger(self.vr(name))[0])

    def reals(self, names: Sequence[str]) -> np.ndarray:
        return np.array(self.fmu.getReal(self.vr(*names)))

    def step(self, h: float) -> None:
        self.fmu.doStep(self.time, h)
        self.time += h

    def run(
        self, end: float, h: float, record: Sequence[str] = (), inputs: Mapping[str, Signal] | None = None
    ) -> Signals:
        """Step to `end` with inputs linear over each step; what was recorded, start included, and `time`."""
        inputs = inputs or {}
        times, rows = [self.time], []
        self.set({name: signal(self.time) for name, signal in inputs.items()})
        rows.append([self[name] for name in record])
        start, count = self.time, round((end - self.time) / h)
        for k in range(count):
            for name, signal in inputs.items():
                now, then = signal(start + k * h), signal(start + (k + 1) * h)
                self.set({name: now})
                self.slope(name, (then - now) / h)
            self.step(start + (k + 1) * h - self.time)
            times.append(self.time)
            rows.append([self[name] for name in record])
        columns = np.array(rows).reshape(len(rows), len(record)).T
        return {"time": np.array(times), **dict(zip(record, columns, strict=True))}

    def outputs(self) -> list[str]:
        """Real outputs."""
        return [n for n, v in self.unit.variables.items() if v.causality == "output" and v.type == "Real"]

    def inputs(self) -> list[str]:
        """Real inputs."""
        return [n for n, v in self.unit.variables.items() if v.causality == "input" and v.type == "Real"]

    def close(self) -> None:
        self.fmu.fmi2FreeInstance(self.fmu.component)


@pytest.fixture(params=UNITS)
def name(request: pytest.FixtureRequest) -> str:
    """Each unit in turn."""
    return str(request.param)


@pytest.fixture(scope="session")
def load() -> Callable[[str], Unit]:
    """load("motor_bldc"): the built unit, unpacked. A unit that is not built fails the test."""
    return lambda name: load_unit(find_fmu(f"{name}.fmu"))


@pytest.fixture
def instantiate(load: Callable[[str], Unit]) -> Iterator[Callable[[str], Slave]]:
    """instantiate("motor_bldc"): before initialization."""
    slaves: list[Slave] = []

    def instantiate(name: str | Path) -> Slave:
        slaves.append(Slave(load_unit(name) if isinstance(name, Path) else load(name)))
        return slaves[-1]

    yield instantiate
    for slave in slaves:
        slave.close()


@pytest.fixture
def make(instantiate: Callable[[str], Slave]) -> Callable[..., Slave]:
    """make("motor_bldc", {"winding.R": 1.0}, tolerance=1e-9): initialised and ready to step."""

    def make(name: str, start: Values | None = None, **setup: Any) -> Slave:
        return instantiate(name).initialise(start, **setup)

    return make


@pytest.fixture
def repaired(load: Callable[[str], Unit], tmp_path: Path) -> Callable[..., Path]:
    """repaired("a = 1", ...): the brake, unpacked, with another GUID and these lines in resources/start_values.txt."""

    def repaired(*lines: str, guid: str = OTHER_GUID) -> Path:
        brake = load("mr_brake_belt")
        copy = tmp_path / "a path with spaces" / "brake"
        shutil.copytree(brake.directory, copy)
        xml = copy / "modelDescription.xml"
        text = xml.read_text(encoding="utf-8")
        assert brake.description.guid in text
        xml.write_text(text.replace(brake.description.guid, OTHER_GUID), encoding="utf-8")
        (copy / "resources").mkdir(exist_ok=True)
        (copy / "resources" / "start_values.txt").write_text(
            "\n".join([f"guid = {guid}", *lines, ""]), encoding="utf-8"
        )
        return copy

    return repaired


@pytest.fixture(scope="session")
def compiler() -> str:
    """Skips where there is none: the FMUs themselves come built."""
    found = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
    if found is None:
        pytest.skip("no C compiler on this machine")
    return found
