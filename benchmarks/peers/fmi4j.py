"""FMI4j, a library for Java: the loop of `Fmi4jLoop.java` and the integration of `Fmi4jExchange.java`, compiled as they
start; their jars are in COBOT_JOINT_JARS.
"""

import os
import shutil
import subprocess
from pathlib import Path

import fmpy
import numpy as np

from benchmarks.peers import GAUSS_SEIDEL, JACOBI, Absent, Run, Wiring
from benchmarks.peers.alone import Table, Task

JARS = Path(os.environ.get("COBOT_JOINT_JARS", "")).absolute()
LOOP, EXCHANGE = (Path(__file__).with_name(f"Fmi4j{name}.java") for name in ("Loop", "Exchange"))
if shutil.which("javac") is None:
    raise Absent("Java's compiler")
if not (JARS / "compile/fmi-import.jar").is_file():
    raise Absent("COBOT_JOINT_JARS=folder with compile/fmi-import.jar, which benchmarks/pom.xml names")

SCHEMES = [JACOBI, GAUSS_SEIDEL]


def run(wiring: Wiring, folder: Path) -> Run:
    references = {
        name: {variable.name: variable.valueReference for variable in fmpy.read_model_description(path).modelVariables}
        for name, path in wiring.units.items()
    }
    lines: list[tuple[object, ...]] = [("unit", name, path) for name, path in wiring.units.items()]
    lines += [
        ("wire", source, references[source][output], sink, references[sink][variable])
        for source, output, sink, variable in wiring.connections
    ]
    lines += [("record", unit, references[unit][output]) for unit, output in wiring.outputs.values()]
    lines.append(("run", wiring.step, wiring.steps, wiring.scheme))
    said, results = _java(LOOP, lines, folder)
    table = np.fromfile(results, dtype=">f8").astype(float).reshape(wiring.steps, len(wiring.outputs))
    return Run(float(said.split()[-1]), dict(zip(wiring.outputs, table.T, strict=True)))


def alone(task: Task) -> Table:
    if task.kind != "ModelExchange":
        raise ValueError(f"{task.kind}: ModelExchange is allowed, {LOOP.name} steps units")
    _, results = _java(EXCHANGE, task.lines(), task.folder)
    return np.fromfile(results, dtype="<f8").astype(float).reshape(task.steps + 1, -1)


def _java(program: Path, lines: list[tuple[object, ...]], folder: Path) -> tuple[str, Path]:
    """What it prints, and its file of results."""
    given, results = folder / "fmi4j.txt", folder / "fmi4j.bin"
    given.write_text("".join("\t".join(map(str, line)) + "\n" for line in lines))
    call = ["java", "-cp", f"{JARS}/compile/*:{JARS}/runtime/*", str(program), str(given), str(results)]
    done = subprocess.run(call, capture_output=True, text=True, cwd=folder)
    if done.returncode:
        raise RuntimeError(f"FMI4j: {(done.stderr or done.stdout)[-2000:]}")
    return done.stdout, results
