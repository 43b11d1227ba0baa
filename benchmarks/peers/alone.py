"""One unit alone in an importer: `python -m benchmarks.peers.alone IMPORTER FMU KIND INPUTS.csv STEP END OUT.csv`.

KIND is CoSimulation, inputs held over each step, or ModelExchange, inputs linear between rows and events located. An
importer's module has `alone(Task) -> table`: (steps + 1, outputs). Leaves with 77 where the importer is not installed.
"""

import csv
import importlib
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers import Absent

IMPORTERS = {"fmuloader": "fmuloader_alone", "FMI4j": "fmi4j", "fmi-rs": "fmi_rs"}  # name -> module
ABSENT = 77
Table = NDArray[np.float64]


@dataclass(frozen=True)
class Task:
    """`inputs`: name -> (steps + 1,) values at the step's ends; `folder`: for files on the way."""

    path: Path
    kind: str
    step: float
    inputs: dict[str, Table]
    steps: int
    folder: Path

    @property
    def xml(self) -> ElementTree.Element:
        """modelDescription.xml."""
        with ZipFile(self.path) as archive:
            return ElementTree.fromstring(archive.read("modelDescription.xml"))

    def outputs(self) -> list[str]:
        """Names of the Real outputs."""
        return [v.attrib["name"] for v in reals(self.xml) if v.get("causality") == "output"]

    def lines(self) -> list[tuple[object, ...]]:
        """For programs in other languages: the unit and what is read, whether and what is integrated, inputs, steps."""
        xml = self.xml
        references = {v.attrib["name"]: v.attrib["valueReference"] for v in reals(xml)}
        read = [references[name] for name in self.outputs()]
        rows: list[tuple[object, ...]] = [("unit", "unit", self.path.absolute(), *read)]
        rows += [("record", "unit", place) for place in range(len(read))]
        rows += [("input", references[name], *map(repr, values.tolist())) for name, values in self.inputs.items()]
        return [*rows, ("alone", self.kind, *counts(xml)), ("run", self.step, self.steps, "Jacobi")]


def reals(xml: ElementTree.Element) -> list[ElementTree.Element]:
    """The Real variables of either version of FMI."""
    return xml.findall("ModelVariables/" + ("Float64" if xml.attrib["fmiVersion"] == "3.0" else "*[Real]"))


def counts(xml: ElementTree.Element) -> tuple[int, int]:
    """Continuous states, event indicators."""
    structure = xml.find("ModelStructure")
    assert structure is not None
    if xml.attrib["fmiVersion"] == "3.0":
        return len(structure.findall("ContinuousStateDerivative")), len(structure.findall("EventIndicator"))
    return len(structure.findall("Derivatives/Unknown")), int(xml.get("numberOfEventIndicators", 0))


def _inputs(path: Path, times: Table) -> dict[str, Table]:
    """A unit without inputs has no file."""
    if not path.is_file():
        return {}
    with path.open() as file:
        _, *names = next(csv.reader(file))
    time, *columns = np.loadtxt(path, delimiter=",", skiprows=1).T
    return {name: np.interp(times, time, column) for name, column in zip(names, columns, strict=True)}


def main() -> int:
    importer, path, kind, given, step, end, out = sys.argv[1:]
    try:
        module = importlib.import_module(f"benchmarks.peers.{IMPORTERS[importer]}")
    except (Absent, ImportError) as why:
        print(why)
        return ABSENT
    times: Table = np.linspace(0.0, float(end), round(float(end) / float(step)) + 1)
    with tempfile.TemporaryDirectory() as folder:
        inputs = _inputs(Path(given), times)
        task = Task(Path(path), kind, float(step), inputs, len(times) - 1, Path(folder))
        table = np.column_stack([times, module.alone(task)])
    np.savetxt(out, table, delimiter=",", header=",".join(["time", *task.outputs()]), comments="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
