"""The crate `fmi` for Rust: the program of `benchmarks/rust`, whose path is in COBOT_JOINT_FMI_RS."""

import os
import subprocess
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np

from benchmarks.peers import GAUSS_SEIDEL, JACOBI, Absent, Run, Wiring
from benchmarks.peers.alone import Table, Task, reals

PROGRAM = Path(os.environ.get("COBOT_JOINT_FMI_RS", "")).absolute()
if not PROGRAM.is_file():
    raise Absent("COBOT_JOINT_FMI_RS=the program that benchmarks/rust compiles to")

SCHEMES = [JACOBI, GAUSS_SEIDEL]


# its reader of FMI 3.0 (fmi-schema 0.8.0) refuses what it does not know: units of measure of variables and their
# nominal values, `A` and `K` in a unit, enumerations, annotations with elements in them
UNKNOWN = {"UnitDefinitions", "TypeDefinitions", "Annotations"}, {"unit", "displayUnit", "nominal"}


def _readable(path: str | Path, folder: Path) -> Path:
    """The FMU itself or, of FMI 3.0, a copy without what the crate refuses."""
    with ZipFile(path) as unit:
        xml = ElementTree.fromstring(unit.read("modelDescription.xml"))
        if xml.attrib["fmiVersion"] != "3.0":
            return Path(path).absolute()
        elements, attributes = UNKNOWN
        for element in [e for e in xml if e.tag in elements]:
            xml.remove(element)
        variables = xml.find("ModelVariables")
        assert variables is not None
        for variable in list(variables):
            for name in attributes & set(variable.attrib):
                del variable.attrib[name]
            if variable.tag == "Enumeration":
                variables.remove(variable)
        with ZipFile(folder / Path(path).name, "w") as copy:
            for name in unit.namelist():
                given = name == "modelDescription.xml"
                copy.writestr(name, ElementTree.tostring(xml, encoding="unicode") if given else unit.read(name))
    return folder / Path(path).name


def run(wiring: Wiring, folder: Path) -> Run:
    references = {name: _references(path) for name, path in wiring.units.items()}
    read: dict[str, list[int]] = {name: [] for name in wiring.units}

    def place(unit: str, output: str) -> int:
        read[unit].append(references[unit][output])
        return len(read[unit]) - 1

    lines: list[tuple[object, ...]] = [
        ("wire", source, place(source, output), sink, references[sink][variable])
        for source, output, sink, variable in wiring.connections
    ]
    lines += [("record", unit, place(unit, output)) for unit, output in wiring.outputs.values()]
    units = [("unit", name, _readable(path, folder), *read[name]) for name, path in wiring.units.items()]
    seconds, table = _program([*units, *lines, ("run", wiring.step, wiring.steps, wiring.scheme)], folder)
    return Run(seconds, dict(zip(wiring.outputs, table.reshape(wiring.steps, -1).T, strict=True)))


def alone(task: Task) -> Table:
    task = replace(task, path=_readable(task.path, task.folder))
    return _program(task.lines(), task.folder)[1].reshape(task.steps + 1, -1)


def _references(path: str) -> dict[str, int]:
    with ZipFile(path) as archive:
        xml = ElementTree.fromstring(archive.read("modelDescription.xml"))
    return {v.attrib["name"]: int(v.attrib["valueReference"]) for v in reals(xml)}


def _program(lines: list[tuple[object, ...]], folder: Path) -> tuple[float, Table]:
    """The loop's seconds, and what it recorded."""
    given, results = folder / "fmi_rs.txt", folder / "fmi_rs.bin"
    given.write_text("".join("\t".join(map(str, line)) + "\n" for line in lines))
    done = subprocess.run([PROGRAM, given, results], capture_output=True, text=True, cwd=folder)
    if done.returncode:
        raise RuntimeError(f"fmi-rs: {(done.stderr or done.stdout)[-2000:]}")
    return float(done.stdout.split()[-1]), np.fromfile(results, dtype="<f8").astype(float)
