"""Start values that travel inside a repaired FMU, read by the unit itself whatever the importer sets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fmpy import read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.simulation import simulate_fmu

from cobot_joint.units import Unit

Load = Callable[[str], Unit]


def instance(directory: Path) -> Any:
    description = read_model_description(directory)
    slave = FMU2Slave(
        guid=description.guid,
        modelIdentifier=description.coSimulation.modelIdentifier,
        unzipDirectory=str(directory),
        instanceName="brake",
    )
    slave.instantiate()
    slave.setupExperiment()
    slave.enterInitializationMode()
    return slave


def value(slave: Any, directory: Path, name: str) -> float:
    (vr,) = [v.valueReference for v in read_model_description(directory).modelVariables if v.name == name]
    return float(slave.getReal([vr])[0])


def test_values_apply_without_the_importers_help(repaired: Callable[..., Path]) -> None:
    directory = repaired("# fitted", "brake.tau_off = 0.123", "", "imbalance.G = -4e-2", "w_p = 1.5")
    slave = instance(directory)
    assert value(slave, directory, "brake.tau_off") == 0.123
    assert value(slave, directory, "imbalance.G") == -0.04
    assert value(slave, directory, "w_p") == 1.5
    slave.freeInstance()


def test_reset_returns_to_them(repaired: Callable[..., Path]) -> None:
    directory = repaired("brake.tau_off = 0.123")
    slave = instance(directory)
    (vr,) = [v.valueReference for v in read_model_description(directory).modelVariables if v.name == "brake.tau_off"]
    slave.setReal([vr], [0.5])
    slave.reset()
    slave.setupExperiment()
    slave.enterInitializationMode()
    assert slave.getReal([vr]) == [0.123]
    slave.freeInstance()


def test_fmpy_simulates_with_them_and_no_start_values_given(repaired: Callable[..., Path], load: Load) -> None:
    torque = {"tau_s": 1.0}
    out = simulate_fmu(str(repaired("brake.tau_off = 0.2")), stop_time=5.0, start_values=torque)
    expected = simulate_fmu(
        str(load("mr_brake_belt").path), stop_time=5.0, start_values={**torque, "brake.tau_off": 0.2}
    )
    assert out["w_p"][-1] == expected["w_p"][-1]


@pytest.mark.parametrize(
    "line",
    [
        "brake.tau_of = 0.1",
        "brake.tau_off = -1",
        "tau_m = -1",
        "brake.tau_off = much",
        "brake.tau_off = 0.1 N.m",
        "brake.tau_off = 0.1x",
        "brake.tau_off = 0,1",
        "brake.tau_off = 0x1",
        "brake.tau_off",
        "brake.tau_off = nan",
        "W = 1",
    ],
)
def test_line_that_cannot_apply_refuses_the_instance(repaired: Callable[..., Path], line: str) -> None:
    directory = repaired(line)
    with pytest.raises(Exception, match="instantiate"):
        instance(directory)


def test_file_for_another_guid_refuses_the_instance(repaired: Callable[..., Path]) -> None:
    directory = repaired("brake.tau_off = 0.2", guid="{somebody-else}")
    with pytest.raises(Exception, match="instantiate"):
        instance(directory)


def stepped(directory: Path, steps: list[float], name: str = "brake.tau_off", user: float | None = None) -> float:
    """w_b after the steps under a torque; the user's value, if there is one, set after the first step."""
    slave = instance(directory)
    refs = {v.name: v.valueReference for v in read_model_description(directory).modelVariables}
    slave.setReal([refs["tau_s"]], [1.0])
    slave.exitInitializationMode()
    time = 0.0
    for h in steps:
        slave.doStep(time, h)
        time += h
        if user is not None and time == steps[0]:
            slave.setReal([refs[name]], [user])
    result = slave.getReal([refs["w_b"], refs[name]])
    slave.freeInstance()
    assert user is None or result[1] == user
    return float(result[0])


def test_late_value_comes_at_its_time_also_within_a_step(repaired: Callable[..., Path]) -> None:
    directory = repaired("brake.tau_off = 0.2 from 0.33")
    assert stepped(directory, [1.0]) == pytest.approx(stepped(directory, [0.33, 0.67]), rel=1e-5)


@pytest.mark.parametrize("first", [0.1, 0.5])
def test_late_value_never_comes_over_one_that_the_user_set(repaired: Callable[..., Path], first: float) -> None:
    stepped(repaired("brake.tau_off = 0.2 from 0.33"), [first, 0.5], user=0.15)
