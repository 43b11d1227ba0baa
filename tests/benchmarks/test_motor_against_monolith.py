"""The motor unit against the monolithic loops, two implementations of one specification written apart."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.monolith import Setup, Table, averaged, three_phase
from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.system import Component, Connection, Connector, Inputs, System
from cobot_joint.units import load_unit

DURATION = 2.0
OUTPUTS = ("i", "w", "phi", "i_a", "i_b", "i_c")


def run_unit(path: Path, inputs: Table, level: int) -> dict[str, Table]:
    names = ("set_value", "tau")
    wires = [Connection(None, name, "motor", name) for name in names]
    wires += [Connection("motor", name, None, name) for name in OUTPUTS]
    ends = {name: Connector(name, "input") for name in names}, {name: Connector(name, "output") for name in OUTPUTS}
    system = System("motor", (Component("motor", str(path), load_unit(path)),), tuple(wires), *ends)
    time = np.arange(len(inputs)) * 1e-3
    with Simulation(system) as simulation:
        driven = Inputs(time, {"set_value": inputs[:, 0], "tau": inputs[:, 2]})
        return simulation.run(Experiment(driven, DURATION, parameters={"motor.motor.level": level})).signals


@pytest.fixture(scope="module")
def loaded() -> Table:
    """12 V within half a second, then 0.05 N.m within another half, then both."""
    time = np.arange(round(DURATION * 1e3) + 1) * 1e-3
    return np.stack([12 * np.clip(2 * time, 0, 1), 0 * time, 0.05 * np.clip(2 * time - 1, 0, 1)], axis=1)


def rms(difference: Table) -> float:
    return float(np.sqrt(np.mean(difference**2)))


def test_averaged_motor_agrees_with_the_loop(fmu: Callable[[str], Path], loaded: Table) -> None:
    unit = run_unit(fmu("motor_bldc"), loaded, level=1)
    loop = averaged(loaded, 20e-6, Setup.MOTOR_ALONE)
    assert rms(unit["i"] - loop["i_motor"]) < 2e-6
    assert rms(unit["w"] - loop["w_motor"]) < 1e-5


def test_three_phase_motor_agrees_with_the_loop_ten_times_closer_than_rk4_at_1_us(
    fmu: Callable[[str], Path], loaded: Table
) -> None:
    unit = run_unit(fmu("motor_bldc"), loaded, level=2)
    loop = three_phase(loaded, 10e-6, Setup.MOTOR_ALONE, locate=True)
    crawl = three_phase(loaded, 1e-6, Setup.MOTOR_ALONE)
    for phase in ("i_a", "i_b", "i_c"):
        assert rms(unit[phase] - loop[phase]) < 0.1 * rms(crawl[phase] - loop[phase])
    assert rms(unit["w"] - loop["w_motor"]) < 1e-4
