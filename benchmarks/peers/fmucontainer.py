"""fmucontainer (fmu-manipulation-toolbox): the units packed into one FMU that steps them in C, run by FMPy."""

import json
import logging
import shutil
from pathlib import Path

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

from benchmarks.measure import stopwatch
from benchmarks.peers import GAUSS_SEIDEL, JACOBI, Absent, Run, Wiring

try:
    from fmu_manipulation_toolbox.assembly import Assembly
except ImportError as error:
    raise Absent(f"fmu-manipulation-toolbox: {error}") from error

SCHEMES = [JACOBI, GAUSS_SEIDEL]


def run(wiring: Wiring, folder: Path) -> Run:
    logging.getLogger("fmu_manipulation_toolbox").setLevel(logging.ERROR)
    for name, path in wiring.units.items():
        shutil.copy(path, folder / f"{name}.fmu")
    assembly = {
        "name": "container.fmu",
        "step_size": wiring.step,
        "sequential": wiring.scheme == GAUSS_SEIDEL,
        "auto_link": False,
        "auto_input": False,
        "auto_output": False,
        "fmu": [f"{name}.fmu" for name in wiring.units],
        "link": [[f"{a}.fmu", output, f"{b}.fmu", variable] for a, output, b, variable in wiring.connections],
        "output": [[f"{unit}.fmu", output, column] for column, (unit, output) in wiring.outputs.items()],
    }
    (folder / "container.json").write_text(json.dumps(assembly))
    Assembly("container.json", fmu_directory=folder).make_fmu()

    description = fmpy.read_model_description(str(folder / "container.fmu"))
    references = {variable.name: variable.valueReference for variable in description.modelVariables}
    container = FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(str(folder / "container.fmu"), str(folder / "container")),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="container",
    )
    container.instantiate()
    container.setupExperiment(startTime=0.0)
    container.enterInitializationMode()
    container.exitInitializationMode()
    wanted = [references[column] for column in wiring.outputs]
    table = np.zeros((wiring.steps, len(wanted)))
    with stopwatch() as seconds:
        for step in range(wiring.steps):
            container.doStep(currentCommunicationPoint=step * wiring.step, communicationStepSize=wiring.step)
            table[step] = container.getReal(wanted)
    container.terminate()
    container.freeInstance()
    return Run(seconds[0], dict(zip(wiring.outputs, table.T, strict=True)))
