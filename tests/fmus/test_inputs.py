"""Inputs that move within a step: their derivatives are followed, exactly where the unit itself is exact."""

from __future__ import annotations

from collections.abc import Callable
from math import factorial
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

C_S = 955.0
COEFFICIENTS = (0.01, 0.3, -40.0, 5e4)  # value, first, second, third derivative


def polynomial(t: float, order: int) -> float:
    return sum(c * t**k / factorial(k) for k, c in enumerate(COEFFICIENTS[: order + 1]))


@pytest.mark.parametrize("order", [0, 1, 2, 3])
@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_input_ends_its_step_on_the_polynomial(make: Make, order: int, h: float) -> None:
    sensor = make("torque_sensor")
    sensor.set({"phi_o": COEFFICIENTS[0]})
    if order:
        sensor.slope("phi_o", *COEFFICIENTS[1 : order + 1])
    sensor.step(h)
    assert sensor["phi_o"] == pytest.approx(polynomial(h, order), rel=1e-14)
    assert sensor["tau_s"] == pytest.approx(C_S * polynomial(h, order), rel=1e-14)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_polynomial_inputs_integrate_to_their_integrals(make: Make, order: int) -> None:
    """a pulley without its belt: J_p dw_p/dt = tau_add"""
    h, J_p = 0.02, 2e-3
    brake = make("mr_brake_belt", {"belt.r": 0.0}, tolerance=1e-10)
    brake.set({"tau_add": COEFFICIENTS[0]})
    if order:
        brake.slope("tau_add", *COEFFICIENTS[1 : order + 1])
    brake.step(h)
    integral = sum(c * h ** (k + 1) / factorial(k + 1) for k, c in enumerate(COEFFICIENTS[: order + 1]))
    twice = sum(c * h ** (k + 2) / factorial(k + 2) for k, c in enumerate(COEFFICIENTS[: order + 1]))
    assert brake["w_p"] == pytest.approx(integral / J_p, rel=1e-8)
    assert brake["phi_p"] == pytest.approx(twice / J_p, rel=1e-7)


def test_derivatives_last_for_one_step_only(make: Make) -> None:
    sensor = make("torque_sensor")
    sensor.slope("phi_o", 1.0)
    sensor.step(1e-3)
    sensor.step(1e-3)
    assert sensor["phi_o"] == pytest.approx(1e-3, rel=1e-12)


def test_derivatives_alone_go_on_from_where_the_input_got_to(make: Make) -> None:
    sensor = make("torque_sensor")
    for slope in (1.0, 1.0, -0.5):
        sensor.slope("phi_o", slope)
        sensor.step(1e-3)
    assert sensor["phi_o"] == pytest.approx(1.5e-3, rel=1e-12)


def test_new_value_forgets_the_derivatives(make: Make) -> None:
    sensor = make("torque_sensor")
    sensor.slope("phi_o", 1.0, 100.0)
    sensor.set({"phi_o": 0.5})
    sensor.step(1e-3)
    assert sensor["phi_o"] == 0.5
    sensor.set({"phi_o": 0.5})
    sensor.slope("phi_o", 1.0)
    sensor.step(1e-3)
    assert sensor["phi_o"] == pytest.approx(0.501, rel=1e-14)


def test_each_input_keeps_its_own_polynomial(make: Make) -> None:
    sensor = make("torque_sensor")
    sensor.slope("phi_o", 1.0)
    sensor.slope("phi_p", 0.0, 200.0)
    sensor.step(1e-2)
    assert sensor["phi_o"] == pytest.approx(1e-2, rel=1e-12)
    assert sensor["phi_p"] == pytest.approx(200 * 1e-4 / 2, rel=1e-12)
    assert sensor["w_o"] == 0


def test_roll_back_returns_the_polynomial_too(make: Make) -> None:
    sensor = make("torque_sensor")
    sensor.slope("phi_o", 1.0, 50.0)
    state = sensor.fmu.getFMUstate()
    sensor.step(1e-3)
    first = sensor["tau_s"]
    sensor.fmu.setFMUstate(state)
    sensor.time = 0.0
    sensor.step(1e-3)
    sensor.fmu.freeFMUstate(state)
    assert sensor["tau_s"] == first
    np.testing.assert_allclose(first, C_S * (1e-3 + 50e-6 / 2), rtol=1e-12)
