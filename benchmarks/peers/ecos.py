"""ecos through ecospy: its fixed-step algorithm, its CSV writer as recorder."""

import contextlib
import csv
import ctypes
import sys
from pathlib import Path

import numpy as np

from benchmarks.measure import stopwatch
from benchmarks.peers import JACOBI, Absent, Run, Wiring

try:
    with contextlib.suppress(OSError):  # the wheel `tbb` puts its library where no loader looks
        ctypes.CDLL(str(Path(sys.prefix) / "lib" / "libtbb.so.12"), mode=ctypes.RTLD_GLOBAL)
    from ecospy import EcosSimulation, EcosSimulationStructure
except (ImportError, OSError) as error:
    raise Absent(f"ecospy with tbb: {error}") from error

SCHEMES = [JACOBI]


def run(wiring: Wiring, folder: Path) -> Run:
    recording = folder / "ecos.csv"
    selection = folder / "ecos.xml"
    components: dict[str, list[str]] = {}
    for unit, output in wiring.outputs.values():
        components.setdefault(unit, []).append(output)
    rows = "".join(
        f'<ecos:component name="{unit}">'
        + "".join(f'<ecos:variable name="{output}"/>' for output in sorted(set(outputs)))
        + "</ecos:component>"
        for unit, outputs in components.items()
    )
    selection.write_text(
        '<?xml version="1.0"?><ecos:LogConfig xmlns:ecos="http://github.com/Ecos-platform/ecos/LogConfig">'
        f'<ecos:components decimationFactor="1">{rows}</ecos:components></ecos:LogConfig>'
    )
    with EcosSimulationStructure() as structure:
        for name, path in wiring.units.items():
            structure.add_model(name, path)
        for source, output, sink, variable in wiring.connections:
            structure.make_real_connection(f"{source}::{output}", f"{sink}::{variable}")
        with EcosSimulation(structure=structure, step_size=wiring.step) as simulation:
            simulation.add_csv_writer(str(recording), str(selection))
            if not simulation.init():
                raise RuntimeError("ecos: initialisation failed")
            with stopwatch() as seconds:
                simulation.step(wiring.steps)
            simulation.terminate()

    with recording.open() as file:
        reader = csv.reader(file)
        header = [name.strip() for name in next(reader)]
        table = np.array([[float(value) for value in row] for row in reader])
    columns = {}
    for column, (unit, output) in wiring.outputs.items():
        place = next(n for n, name in enumerate(header) if name.startswith(f"{unit}::{output}["))
        columns[column] = table[-wiring.steps :, place]
    return Run(seconds[0], columns)
