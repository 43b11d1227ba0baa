"""Plain FMPy: the loop that its users write, FMU objects stepped from Python."""

import shutil
from pathlib import Path

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

from benchmarks.measure import stopwatch
from benchmarks.peers import GAUSS_SEIDEL, JACOBI, Run, Wiring

SCHEMES = [JACOBI, GAUSS_SEIDEL]


def run(wiring: Wiring, folder: Path) -> Run:
    units: dict[str, FMU2Slave] = {}
    references: dict[str, dict[str, int]] = {}
    for name, path in wiring.units.items():
        description = fmpy.read_model_description(path)
        references[name] = {variable.name: variable.valueReference for variable in description.modelVariables}
        units[name] = FMU2Slave(
            guid=description.guid,
            unzipDirectory=fmpy.extract(path, str(folder / name)),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        units[name].instantiate()
        units[name].setupExperiment(startTime=0.0)
        units[name].enterInitializationMode()

    sources: dict[str, list[int]] = {name: [] for name in units}  # what is read from each unit, and where it goes
    routes: dict[str, list[tuple[str, int, int]]] = {name: [] for name in units}
    for source, output, sink, variable in wiring.connections:
        routes[sink].append((source, len(sources[source]), references[sink][variable]))
        sources[source].append(references[source][output])
    records = []
    for unit, output in wiring.outputs.values():
        records.append((unit, len(sources[unit])))
        sources[unit].append(references[unit][output])

    def read() -> dict[str, list[float]]:
        return {name: unit.getReal(sources[name]) if sources[name] else [] for name, unit in units.items()}

    values = read()
    for _ in range(len(units)):  # initial values reach the end of the longest chain
        for name, unit in units.items():
            if routes[name]:
                unit.setReal([route[2] for route in routes[name]], [values[s][n] for s, n, _ in routes[name]])
        values = read()
    for unit in units.values():
        unit.exitInitializationMode()

    wanted = {name: [route[2] for route in routes[name]] for name in units}
    table = np.zeros((wiring.steps, len(records)))
    with stopwatch() as seconds:
        for step in range(wiring.steps):
            now = step * wiring.step
            if wiring.scheme == GAUSS_SEIDEL:
                for name, unit in units.items():
                    if wanted[name]:
                        unit.setReal(wanted[name], [values[source][n] for source, n, _ in routes[name]])
                    unit.doStep(currentCommunicationPoint=now, communicationStepSize=wiring.step)
                    if sources[name]:
                        values[name] = unit.getReal(sources[name])
            else:
                for name, unit in units.items():
                    if wanted[name]:
                        unit.setReal(wanted[name], [values[source][n] for source, n, _ in routes[name]])
                for unit in units.values():
                    unit.doStep(currentCommunicationPoint=now, communicationStepSize=wiring.step)
                values = read()
            table[step] = [values[unit][n] for unit, n in records]

    for unit in units.values():
        unit.terminate()
        unit.freeInstance()
    for name in units:
        shutil.rmtree(folder / name)
    return Run(seconds[0], dict(zip(wiring.outputs, table.T, strict=True)))
