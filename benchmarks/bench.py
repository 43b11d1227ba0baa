"""The bench as every contestant gets it: inputs at 1 kHz, the right answer, and the wires for other masters."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks import units
from benchmarks.measure import rms
from benchmarks.monolith import INPUTS, SAMPLE, Table, averaged, three_phase
from benchmarks.peers import JACOBI, Wiring
from cobot_joint.scenario.model import TimeScenario, load_scenario
from cobot_joint.system import Component, Connection, Connector, DefaultExperiment, Inputs, System
from cobot_joint.system.read import load_system
from cobot_joint.units import load_unit

SCENARIO = "load_mr_brake"
DURATION = 20.0  # s
ACCURACY = {"i_motor": 4e-4, "w_motor": 0.03, "tau_sensor": 5e-4}  # rms that the bench's default scheme has to meet


def table_of(inputs: Inputs, duration: float = DURATION) -> Table:
    """(rows, 3) at 1 kHz: v_command, i_brake, tau_hold, as the monolithic loops take them."""
    time = np.arange(round(duration / SAMPLE) + 1) * SAMPLE
    return np.stack([np.interp(time, inputs.time, inputs.values[name]) for name in INPUTS], axis=1)


@cache
def _answer(kind: str, table: bytes) -> dict[str, Table]:
    inputs = np.frombuffer(table).reshape(-1, len(INPUTS))
    if kind == "three_phase":
        return three_phase(inputs, 1e-5, locate=True)
    return averaged(inputs, 1e-5)


def answer(table: Table, kind: str = "averaged") -> dict[str, Table]:
    """The monolithic loop at 10 us: 1e-7 A from the reference solution; three-phase with located events."""
    return _answer(kind, table.tobytes())


def errors(columns: Mapping[str, Table], step: float, table: Table) -> dict[str, float]:
    """rms error of each column that meets 1 kHz points; `columns` hold the ends of the steps, (steps,)."""
    right = answer(table)
    every = max(1, round(SAMPLE / step))
    stride = max(1, round(step / SAMPLE))
    return {
        name: rms(values[every - 1 :: every] - right[name][stride::stride][: len(values[every - 1 :: every])])
        for name, values in columns.items()
        if name in right
    }


def joint() -> System:
    """The loaded bench."""
    return load_system("joint")


def inputs() -> Inputs:
    """Of the scenario that everybody runs."""
    scenario = load_scenario(SCENARIO)
    assert isinstance(scenario, TimeScenario)
    return scenario.signals(joint())


def wiring(system: System, folder: Path, step: float, table: Table | None = None, scheme: str = JACOBI) -> Wiring:
    """`system` for another master; inputs, where there is a `table` of them, played by a unit that is stepped first."""
    player = "signals"
    connections, outputs = [], {}
    for c in system.connections:
        if (c.factor, c.offset) != (1.0, 0.0):
            raise ValueError(f"{c.name}: other masters convert no units; allowed are wires of one unit")
        if c.sink_component is None:
            assert c.source_component is not None
            outputs[c.sink] = (c.source_component, c.source)
        else:
            connections.append((c.source_component or player, c.source, c.sink_component, c.sink))
    paths = {} if table is None else {player: str(units.signals(folder, table, step))}
    paths |= {component.name: str(component.unit.path) for component in system.components}
    stop = system.default_experiment.stop_time if table is None else (len(table) - 1) * SAMPLE
    return Wiring(paths, connections, outputs, step, stop, scheme)


def ring(folder: Path, size: int, stop: float) -> System:
    """`size` trivial units in a ring, every output recorded."""
    path = units.trivial(folder)
    unit = load_unit(path)
    names = [f"unit_{n}" for n in range(size)]
    wires = [Connection(name, "y", names[(n + 1) % size], "u") for n, name in enumerate(names)]
    taps = [Connection(name, "y", None, f"y_{name}") for name in names]
    outputs = {tap.sink: Connector(tap.sink, "output") for tap in taps}
    components = tuple(Component(name, str(path), unit) for name in names)
    return System("ring", components, (*wires, *taps), {}, outputs, DefaultExperiment(0.0, stop))
