"""Values of states, inputs and parameters that make no sense are refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from fmpy.fmi1 import FMICallException

Make = Callable[..., Any]

NONSENSE = [
    ("motor_bldc", "rise", -1e6),
    ("motor_bldc", "J_coupled", -1e-6),
    ("motor_bldc", "torque_saturation.s", -1e-3),
    ("motor_bldc", "dead_time.V", -0.1),
    ("mr_brake_belt", "tau_m", -1.0),
    ("mr_brake_belt", "E", -1.0),
    ("mr_brake_belt", "z_h", 1.5),
    ("mr_brake_belt", "position_friction.m", 0.5),
    ("planetary_gear", "sublinear_viscous.x", 1.1),
    ("planetary_gear", "viscous_warmup.fade", 1.1),
]


@pytest.mark.parametrize(("name", "variable", "value"), NONSENSE)
def test_nonsense_is_refused_with_both_bounds(instantiate: Make, name: str, variable: str, value: float) -> None:
    slave = instantiate(name)
    slave.fmu.setupExperiment()
    slave.fmu.enterInitializationMode()
    before = slave[variable]
    with pytest.raises(FMICallException):
        slave.set({variable: value})
    low, high = slave.unit.bounds_of(variable)
    assert f"{variable} = {value:g}" in slave.log[0]
    assert f"is outside {low:g} to {high:g}" in slave.log[0]
    assert slave[variable] == before
