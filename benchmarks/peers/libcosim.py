"""libcosim (Open Simulation Platform) through libcosimpy: its fixed-step algorithm, a time series observer."""

from pathlib import Path

import numpy as np

from benchmarks.measure import stopwatch
from benchmarks.peers import JACOBI, Absent, Run, Wiring

try:
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave
except ImportError as error:
    raise Absent(f"libcosimpy: {error}") from error

SCHEMES = [JACOBI]


def run(wiring: Wiring, folder: Path) -> Run:
    execution = CosimExecution.from_step_size(round(wiring.step * 1e9))
    slaves = [CosimLocalSlave(fmu_path=path, instance_name=name) for name, path in wiring.units.items()]
    index = {name: execution.add_local_slave(slave) for name, slave in zip(wiring.units, slaves, strict=True)}
    references = {
        name: {variable.name.decode(): variable.reference for variable in execution.slave_variables(index[name])}
        for name in wiring.units
    }
    for source, output, sink, variable in wiring.connections:
        execution.connect_real_variables(
            index[source], references[source][output], index[sink], references[sink][variable]
        )
    observer = CosimObserver.create_time_series(wiring.steps + 1)
    execution.add_observer(observer)
    for unit, output in wiring.outputs.values():
        observer.start_time_series(index[unit], references[unit][output], CosimVariableType.REAL)
    execution.step(1)  # initialises the units

    with stopwatch() as seconds:
        if not execution.step(wiring.steps - 1):
            raise RuntimeError("libcosim: stepping failed")
    whole = seconds[0] * wiring.steps / (wiring.steps - 1)

    columns = {}
    for column, (unit, output) in wiring.outputs.items():
        _, _, samples = observer.time_series_real_samples(index[unit], references[unit][output], 1, wiring.steps)
        columns[column] = np.array(samples)
    return Run(whole, columns)
