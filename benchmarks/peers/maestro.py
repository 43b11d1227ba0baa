"""Maestro 2 (INTO-CPS), a Java program: what it needs is Java and its jar in the folder COBOT_JOINT_JARS."""

import csv
import json
import math
import os
import re
import resource
import shutil
import subprocess
import time
import zipfile
from pathlib import Path

import numpy as np

from benchmarks.peers import JACOBI, Absent, Run, Wiring

JAR = Path(os.environ.get("COBOT_JOINT_JARS", ""), "maestro-jar-with-dependencies.jar").absolute()
if shutil.which("java") is None:
    raise Absent("Java")
if not JAR.is_file():
    raise Absent(f"COBOT_JOINT_JARS=folder of {JAR.name}, which benchmarks/pom.xml names")

SCHEMES = [JACOBI]


def _children() -> float:
    """CPU time of the processes that were waited for, s."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _without_slopes(source: str, path: Path) -> Path:
    """A copy of an FMU that declares no derivatives: of one that does, it asks for those of its states' derivatives."""
    with zipfile.ZipFile(source) as unit, zipfile.ZipFile(path, "w") as copy:
        for name in unit.namelist():
            content = unit.read(name)
            if name == "modelDescription.xml":
                content = re.sub(rb' (maxOutputDerivativeOrder|canInterpolateInputs)="\w+"', b"", content)
            copy.writestr(name, content)
    return path


def run(wiring: Wiring, folder: Path) -> Run:
    units = {name: _without_slopes(path, folder / f"{name}.fmu") for name, path in wiring.units.items()}
    model = folder / "model.json"
    experiment = folder / "experiment.json"
    place = "{{{0}}}.{0}.{1}".format
    connections: dict[str, list[str]] = {}
    for source, output, sink, variable in wiring.connections:
        connections.setdefault(place(source, output), []).append(place(sink, variable))
    logged: dict[str, list[str]] = {}
    for unit, output in wiring.outputs.values():
        logged.setdefault(f"{{{unit}}}.{unit}", []).append(output)
    model.write_text(
        json.dumps(
            {
                "fmus": {f"{{{name}}}": path.as_uri() for name, path in units.items()},
                "connections": connections,
                "logVariables": logged,
                "parameters": {},
                "algorithm": {"type": "fixed-step", "size": wiring.step},
            }
        )
    )

    def simulate(stop: float) -> float:
        experiment.write_text(json.dumps({"startTime": 0.0, "endTime": stop, "reportProgress": False, "logLevels": {}}))
        shutil.rmtree(folder / "maestro", ignore_errors=True)
        call = ["java", "-jar", str(JAR), "import", "-i", "-output=" + str(folder / "maestro"), "Sg1"]
        start, used = time.perf_counter(), _children()
        done = subprocess.run([*call, str(model), str(experiment)], capture_output=True, text=True, cwd=folder)
        if done.returncode:
            raise RuntimeError(f"Maestro: {(done.stderr or done.stdout)[:2000]}")
        return min(time.perf_counter() - start, _children() - used)

    set_up = min(simulate(2 * wiring.step) for _ in range(2))  # start of the virtual machine, loading, initialising
    seconds = simulate(wiring.stop) - set_up
    (recording,) = (folder / "maestro").rglob("outputs.csv")
    with recording.open() as file:
        reader = csv.reader(file)
        header = next(reader)
        table = np.array([[float(value) for value in row] for row in reader])
    columns = {column: table[1:, header.index(place(*where))] for column, where in wiring.outputs.items()}
    return Run(seconds if seconds > 0 else math.nan, columns)  # nan: less than the start varies by
