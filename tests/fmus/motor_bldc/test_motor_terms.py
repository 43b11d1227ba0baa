"""Every term of the motor: switched on, it does what its equation says. Friction's are in test_friction.py."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

R, L, K, J = 0.209, 84.3e-6, 0.0232, 5.38e-6
HELD = {"rotor.J": 1e3}
STATE = {"phi": 0.9, "w": 40.0, "x_i": 3.0, "set_value": 2.0}


def change(make: Make, variable: str, term: dict[str, float], start: dict[str, float] | None = None) -> float:
    """By how much a term changes the derivative of a state."""
    off = make("motor_bldc", {**STATE, **(start or {})})
    on = make("motor_bldc", {**STATE, **(start or {}), **term})
    return float(on.rate(variable) - off.rate(variable))


@pytest.mark.parametrize("i", [3.0, -3.0, 40.0])
def test_torque_per_ampere_falls_with_the_square_of_the_current_and_keeps_its_sign(make: Make, i: float) -> None:
    motor = make("motor_bldc", {**STATE, "x_i": i, "torque_saturation.s": 7e-4})
    assert motor["tau_e"] == pytest.approx(K * i / (1 + 7e-4 * i**2), rel=1e-12)


def test_saturation_leaves_the_back_emf_of_a_driving_motor(make: Make) -> None:
    assert change(make, "x_i", {"torque_saturation.s": 7e-4}) == 0


def test_a_saturated_motor_that_brakes_gives_the_supply_no_more_than_the_shaft_gives_it(make: Make) -> None:
    """the back-EMF falls as the torque does: e i = tau_e w"""
    start = {**STATE, "x_i": -20.0, "set_value": 0.5, "torque_saturation.s": 2e-3}
    motor = make("motor_bldc", start)
    e = motor["v"] - R * -20.0 - L * motor.rate("x_i")
    assert e * -20.0 == pytest.approx(motor["tau_e"] * 40.0, rel=1e-9)


def test_dead_time_takes_voltage_with_the_sign_of_the_current(make: Make) -> None:
    term = {"dead_time.V": 0.07, "dead_time.i_0": 0.06}
    for i in (3.0, -3.0, 0.02):
        expected = -0.07 * np.tanh(i / 0.06) / L
        assert change(make, "x_i", term, {"x_i": i}) == pytest.approx(expected, rel=1e-9)


def test_dead_time_leaves_the_current_less_than_ohms_law(make: Make) -> None:
    start = {"set_value": 0.5, **HELD, "dead_time.V": 0.07, "dead_time.i_0": 0.01}
    motor = make("motor_bldc", start)
    motor.step(0.05)
    assert motor["i"] == pytest.approx((0.5 - 0.07) / R, rel=1e-5)


def test_supply_sags_by_duty_squared_times_current(make: Make) -> None:
    term = {"supply_sag.R_s": 0.2}
    assert change(make, "x_i", term) == pytest.approx(-0.2 * 3.0 * (2 / 24) ** 2 / L, rel=1e-9)


def test_power_that_the_motor_misses_is_lost_in_the_supply(make: Make) -> None:
    """supply current = duty times motor current, its heat R_s*(duty*i)^2 = v_lost*i"""
    motor = make("motor_bldc", {**STATE, "supply_sag.R_s": 0.2})
    duty = 2 / 24
    assert (2.0 - motor["v"]) * 3.0 == pytest.approx(0.2 * (duty * 3.0) ** 2, rel=1e-12)


@pytest.mark.parametrize("n", [1.0, 4.0, 12.0])
def test_cogging_resists_with_the_sine_of_its_order(make: Make, n: float) -> None:
    term = {"cogging.A": 1e-3, "cogging.n": n, "cogging.phi_0": 0.3}
    assert change(make, "w", term) == pytest.approx(-1e-3 * np.sin(n * 0.9 + 0.3) / J, rel=1e-6)


def test_cogging_does_no_work_over_a_turn(make: Make) -> None:
    free = {"friction.tau_C": 0.0, "friction.d": 0.0, "enable": False, "w": 100.0}
    term = {"cogging.A": 1e-3, "cogging.n": 4.0}
    motor = make("motor_bldc", {**free, **term}, tolerance=1e-9)
    out = motor.run(1.0, 1e-3, ["phi", "w"])
    potential = -1e-3 / 4 * np.cos(4 * out["phi"])
    energy = J * out["w"] ** 2 / 2 + potential
    np.testing.assert_allclose(energy, energy[0], rtol=1e-5)
    assert np.ptp(out["w"]) > 0.1


def test_torque_ripple_is_in_proportion_to_the_torque(make: Make) -> None:
    term = {"torque_ripple.A": 0.05, "torque_ripple.n": 6.0, "torque_ripple.phi_0": 0.4}
    for i in (3.0, -1.0):
        motor = make("motor_bldc", {**STATE, "x_i": i, **term})
        assert motor["tau_e"] == pytest.approx(K * i * (1 + 0.05 * np.sin(6 * 0.9 + 0.4)), rel=1e-12)


def test_back_emf_ripples_as_the_torque_does(make: Make) -> None:
    """virtual work: e i = tau_e w at every angle"""
    term = {"torque_ripple.A": 0.05, "torque_ripple.n": 6.0, "torque_ripple.phi_0": 0.4}
    expected = -K * 0.05 * np.sin(6 * 0.9 + 0.4) * 40.0 / L
    assert change(make, "x_i", term) == pytest.approx(expected, rel=1e-9)


def test_resistance_rises_with_the_windings_temperature(make: Make) -> None:
    term = {"winding_heating.alpha": 3.9e-3, "rise": 60.0}
    expected = -R * 3.9e-3 * 60 * 3.0 / L
    assert change(make, "x_i", term) == pytest.approx(expected, rel=1e-9)


def test_ambient_temperature_counts_from_25_degrees(make: Make) -> None:
    """eq. 3.1: R = R_mot (1 + alpha (T_w - 25 degC))"""
    term = {"winding_heating.alpha": 3.9e-3, "winding_heating.T_a": 308.15}
    assert change(make, "x_i", term) == pytest.approx(-R * 3.9e-3 * 10 * 3.0 / L, rel=1e-9)


def test_self_heating_settles_where_loss_and_cooling_meet(make: Make) -> None:
    """constant current: rise = R_th R i^2 (1 + alpha rise)"""
    start = {"drive.mode": 2, "set_value": 4.5, **HELD, "winding_heating.alpha": 3.9e-3, "winding_heating.T": 5.0}
    motor = make("motor_bldc", start)
    motor.step(200.0)
    base = 4.0 * R * 4.5**2
    assert motor["T_w"] - 298.15 == pytest.approx(base / (1 - 3.9e-3 * base), rel=1e-4)


def test_winding_and_housing_warm_up_as_two_bodies(make: Make) -> None:
    """C_w dT_w/dt = P - (T_w - T_h)/R_th, C_h dT_h/dt = (T_w - T_h)/R_th - T_h/R_h: closed form by eigenvalues"""
    R_th, R_h, T, T_h, i = 1.2, 3.2, 20.0, 300.0, 4.5
    heat = {
        "winding_heating.R_th": R_th,
        "winding_heating.R_h": R_h,
        "winding_heating.T": T,
        "winding_heating.T_h": T_h,
    }
    motor = make("motor_bldc", {"drive.mode": 2, "set_value": i, **HELD, **heat}, tolerance=1e-8)
    out = motor.run(600.0, 10.0, ["T_w"])
    C_w, C_h, P = T / R_th, T_h / R_h, R * i**2
    A = np.array([[-1 / (R_th * C_w), 1 / (R_th * C_w)], [1 / (R_th * C_h), -1 / (R_th * C_h) - 1 / (R_h * C_h)]])
    settled = np.array([(R_th + R_h) * P, R_h * P])
    rates, modes = np.linalg.eig(A)
    share = np.linalg.solve(modes, -settled)
    closed = settled[0] + (modes[0] * share) @ np.exp(np.outer(rates, out["time"]))
    np.testing.assert_allclose(out["T_w"] - 298.15, closed, atol=0.01)
    assert closed[-1] > 10


def test_current_at_constant_voltage_sags_as_the_winding_heats(make: Make) -> None:
    start = {"set_value": 0.8, **HELD, "winding_heating.alpha": 3.9e-3, "winding_heating.T": 5.0}
    motor = make("motor_bldc", start)
    motor.step(0.05)
    cold = motor["i"]
    motor.step(100.0)
    rise = motor["T_w"] - 298.15
    assert motor["i"] == pytest.approx(0.8 / (R * (1 + 3.9e-3 * rise)), rel=5e-4)
    assert motor["i"] < 0.97 * cold
