"""CoFmuPy (package cofmpy, later cofmupy): its coordinator, which records every output."""

import contextlib
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.measure import stopwatch
from benchmarks.peers import GAUSS_SEIDEL, JACOBI, Absent, Run, Wiring

try:
    from cofmupy import Coordinator
    from cofmupy.wrappers import Fmu2Handler
    from fmpy import read_model_description
except ImportError as error:
    raise Absent(f"cofmpy: {error}") from error

SCHEMES = [JACOBI, GAUSS_SEIDEL]


def _reals(causality: str) -> Callable[[Fmu2Handler], list[str]]:
    def names(handler: Fmu2Handler) -> list[str]:
        variables = handler.description.modelVariables
        return [v.name for v in variables if v.causality == causality and v.type == "Real"]

    return names


# of FMI 2.0 units it sets and gets every input and output as a Real, which others refuse: it is shown the Reals only
Fmu2Handler.get_input_names = _reals("input")
Fmu2Handler.get_output_names = _reals("output")


def run(wiring: Wiring, folder: Path) -> Run:
    wired = {(sink, variable) for _, _, sink, variable in wiring.connections}
    fmus = []
    for name, path in wiring.units.items():
        starts = {}  # it sets every input at every step, to zero if it is not told
        for variable in read_model_description(path).modelVariables:
            if variable.causality == "input" and variable.type == "Real" and (name, variable.name) not in wired:
                starts[variable.name] = float(variable.start)
        fmus.append({"id": name, "path": path, "initialization": starts})
    ends = [
        {"source": {"id": source, "variable": output}, "target": {"id": sink, "variable": variable}}
        for source, output, sink, variable in wiring.connections
    ]
    coordinator = Coordinator()
    with contextlib.redirect_stdout(io.StringIO()):
        method = "gauss_seidel" if wiring.scheme == GAUSS_SEIDEL else "jacobi"
        coordinator.start({"fmus": fmus, "connections": ends, "cosim_method": method, "iterative": False})
        with stopwatch() as seconds:
            for _ in range(wiring.steps):
                coordinator.do_step(wiring.step)
    results = coordinator.get_results()
    return Run(seconds[0], {column: np.array(results[tuple(place)]) for column, place in wiring.outputs.items()})
