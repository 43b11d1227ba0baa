"""fmuloader, a loader for Python without a master: the loop that its users write, over units of FMI 2.0 and FMI 3.0."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np

from benchmarks.measure import stopwatch
from benchmarks.peers import GAUSS_SEIDEL, JACOBI, Absent, Run, Wiring
from benchmarks.peers.alone import counts, reals

try:
    from fmuloader.fmi2 import Fmi2Slave, Fmi2Type
    from fmuloader.fmi3 import Fmi3Slave
except ImportError as error:
    raise Absent(f"fmuloader: {error}") from error

SCHEMES = [JACOBI, GAUSS_SEIDEL]


class Unit:
    """An instance in initialization mode. `kind`: as in FMI's XML; `references`: of Reals."""

    def __init__(self, path: str | Path, name: str, folder: Path, kind: str = "CoSimulation") -> None:
        with ZipFile(path) as archive:
            self.xml = ElementTree.fromstring(archive.read("modelDescription.xml"))
        self.three = self.xml.attrib["fmiVersion"] == "3.0"
        interface = self.xml.find(kind)
        if interface is None:
            raise ValueError(f"{path}: no {kind}")
        slave = Fmi3Slave if self.three else Fmi2Slave
        identifier = interface.attrib["modelIdentifier"]
        self.fmu: Any = slave(path, model_identifier=identifier, unpack_dir=folder / name)
        self.references = {v.attrib["name"]: int(v.attrib["valueReference"]) for v in reals(self.xml)}
        self.outputs: list[int] = []  # what is read, and `values` as last read
        self.values: list[float] = []
        self._begin(name, kind == "ModelExchange")

    def _begin(self, name: str, exchange: bool) -> None:
        if self.three:
            begin = self.fmu.instantiate_model_exchange if exchange else self.fmu.instantiate_co_simulation
            begin(name, instantiation_token=self.xml.attrib["instantiationToken"])
        else:
            kind = Fmi2Type.MODEL_EXCHANGE if exchange else Fmi2Type.CO_SIMULATION
            self.fmu.instantiate(name, kind, guid=self.xml.attrib["guid"])
            self.fmu.setup_experiment(start_time=0.0)
        self.fmu.enter_initialization_mode()

    def reads(self, name: str) -> int:
        """The place of this output among `values`."""
        self.outputs.append(self.references[name])
        return len(self.outputs) - 1

    def read(self) -> None:
        if self.outputs:
            self.values = self.fmu.get_float64(self.outputs) if self.three else self.fmu.get_real(self.outputs)

    def set(self, references: Sequence[int], values: Sequence[float]) -> None:
        if references:
            (self.fmu.set_float64 if self.three else self.fmu.set_real)(references, values)

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.free_instance()

    def counts(self) -> tuple[int, int]:
        """Continuous states, event indicators."""
        if self.three:
            return self.fmu.get_number_of_continuous_states(), self.fmu.get_number_of_event_indicators()
        return counts(self.xml)

    def derivatives(self, n: int) -> list[float]:
        """Of the continuous states."""
        return list((self.fmu.get_continuous_state_derivatives if self.three else self.fmu.get_derivatives)(n))

    def discrete_states(self) -> tuple[bool, bool, float]:
        """In event mode: whether once more, whether there is a next time event, and when."""
        if self.three:
            info = self.fmu.update_discrete_states()
            return info.discrete_states_need_update, info.next_event_time_defined, info.next_event_time
        info = self.fmu.new_discrete_states()
        return bool(info.newDiscreteStatesNeeded), bool(info.nextEventTimeDefined), float(info.nextEventTime)


def run(wiring: Wiring, folder: Path) -> Run:
    units = {name: Unit(path, name, folder) for name, path in wiring.units.items()}
    routes: dict[str, list[tuple[Unit, int]]] = {name: [] for name in units}
    wanted: dict[str, list[int]] = {name: [] for name in units}
    for source, output, sink, variable in wiring.connections:
        routes[sink].append((units[source], units[source].reads(output)))
        wanted[sink].append(units[sink].references[variable])
    records = [(units[unit], units[unit].reads(output)) for unit, output in wiring.outputs.values()]

    def take(name: str) -> None:
        units[name].set(wanted[name], [source.values[place] for source, place in routes[name]])

    for _ in range(len(units) + 1):  # initial values reach the end of the longest chain
        for unit in units.values():
            unit.read()
        for name in units:
            take(name)
    for unit in units.values():
        unit.fmu.exit_initialization_mode()

    table = np.zeros((wiring.steps, len(records)))
    with stopwatch() as seconds:
        for step in range(wiring.steps):
            for name in units if wiring.scheme == JACOBI else ():
                take(name)
            for name, unit in units.items():
                if wiring.scheme == GAUSS_SEIDEL:
                    take(name)
                unit.fmu.do_step(step * wiring.step, wiring.step)
                if wiring.scheme == GAUSS_SEIDEL:
                    unit.read()
            for unit in units.values() if wiring.scheme == JACOBI else ():
                unit.read()
            table[step] = [unit.values[place] for unit, place in records]

    for unit in units.values():
        unit.close()
    return Run(seconds[0], dict(zip(wiring.outputs, table.T, strict=True)))
