"""The motor alone, averaged level, base model: closed forms and Table 3.1 of the thesis."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

R, L, K, J, TAU_C, D = 0.209, 84.3e-6, 0.0232, 5.38e-6, 1.2e-3, 7.5e-6
RPM = 2 * np.pi / 60
NO_LIMITS = {"drive.i_peak": 0.0, "drive.v_max": 0.0, "drive.w_max": 0.0}
HELD = {"rotor.J": 1e3}  # an immense inertia holds the rotor
FRICTIONLESS = {"friction.tau_C": 0.0, "friction.d": 0.0}


def test_current_rises_with_the_electrical_time_constant(make: Make) -> None:
    out = make("motor_bldc", {"set_value": 2.0, **HELD, **NO_LIMITS}, tolerance=1e-8).run(3e-3, 1e-4, ["i"])
    np.testing.assert_allclose(out["i"], 2.0 / R * (1 - np.exp(-R / L * out["time"])), atol=1e-5)


def test_torque_is_k_times_current(make: Make) -> None:
    motor = make("motor_bldc", {"set_value": 1.0, **HELD})
    motor.step(0.01)
    assert motor["tau_e"] == pytest.approx(K * motor["i"], rel=1e-12)


def test_rotor_speeds_up_with_the_electromechanical_time_constant(make: Make) -> None:
    """L of 1 nH: dw/dt = (v - k w) k/(R J)"""
    start = {"set_value": 1.0, "winding.L": 1e-9, "tau": 0.0, **FRICTIONLESS, **NO_LIMITS}
    out = make("motor_bldc", start).run(0.01, 1e-3, ["w"])
    T = R * J / K**2
    np.testing.assert_allclose(out["w"], 1.0 / K * (1 - np.exp(-out["time"] / T)), atol=2e-3)


def test_mechanical_time_constant_is_that_of_the_data_sheet(make: Make) -> None:
    """Table 3.1 row 15: 2.09 ms, the winding's inductance aside"""
    start = {"set_value": 1.0, "winding.L": 1e-9, **FRICTIONLESS, **NO_LIMITS}
    motor = make("motor_bldc", start)
    motor.step(2.09e-3)
    assert motor["w"] * K / 1.0 == pytest.approx(1 - np.exp(-1), rel=0.01)


def test_coupled_inertia_slows_the_rotor(make: Make) -> None:
    motor = make("motor_bldc", {"tau": -0.01, "J_coupled": 9.3e-7, "enable": False, **FRICTIONLESS})
    assert motor.rate("w") == pytest.approx(0.01 / (J + 9.3e-7), rel=1e-12)


@pytest.fixture
def no_load(make: Make) -> Any:
    motor = make("motor_bldc", {"set_value": 24.0, **NO_LIMITS})
    motor.step(3.0)
    return motor


def test_no_load_speed_and_current_at_24_volts_are_those_of_the_data_sheet(no_load: Any) -> None:
    assert no_load["w"] == pytest.approx(9840 * RPM, rel=0.01)
    assert no_load["i"] == pytest.approx(0.386, rel=0.01)


def test_no_load_deviation_lies_within_the_data_sheets_rounding(make: Make) -> None:
    """the torque constant is printed as 23.2: anything from 23.15 to 23.25 mN.m/A"""
    speeds = []
    for k in (23.15e-3, 23.25e-3):
        motor = make("motor_bldc", {"set_value": 24.0, "winding.k": k, **NO_LIMITS})
        motor.step(3.0)
        speeds.append(motor["w"])
    assert min(speeds) <= 9845 * RPM
    assert max(speeds) >= 9835 * RPM


def test_steady_state_solves_the_equations(no_load: Any) -> None:
    w, i = no_load["w"], no_load["i"]
    assert R * i + K * w == pytest.approx(24, rel=1e-7)
    assert K * i == pytest.approx(TAU_C * np.tanh(w) + D * w, rel=1e-5)


def test_stall_current_and_torque_at_24_volts_are_those_of_the_data_sheet(make: Make) -> None:
    motor = make("motor_bldc", {"set_value": 24.0, **HELD, **NO_LIMITS})
    motor.step(0.05)
    assert motor["i"] == pytest.approx(115, rel=0.01)
    assert motor["tau_e"] == pytest.approx(2.660, rel=0.01)


def test_stall_deviation_lies_within_the_data_sheets_rounding(make: Make) -> None:
    """0.209 Ohm is anything from 0.2085 to 0.2095"""
    currents = []
    for resistance in (0.2085, 0.2095):
        motor = make("motor_bldc", {"set_value": 24.0, "winding.R": resistance, **HELD, **NO_LIMITS})
        motor.step(0.05)
        currents.append(motor["i"])
    assert min(currents) <= 115 <= max(currents)


def test_speed_falls_with_torque_by_the_data_sheets_gradient(make: Make) -> None:
    """Table 3.1 row 14: 3.71 rpm per mN.m; friction's own share of the fall aside"""
    speeds = []
    for tau in (0.05, 0.15):
        motor = make("motor_bldc", {"set_value": 24.0, "tau": tau, **NO_LIMITS, **FRICTIONLESS})
        motor.step(3.0)
        speeds.append(motor["w"])
    assert (speeds[0] - speeds[1]) / RPM / 100 == pytest.approx(3.71, rel=0.01)


def test_nominal_point_is_that_of_the_data_sheet(make: Make) -> None:
    """Table 3.1 rows 4 to 6: 9120 rpm and 7.39 A at 165 mN.m"""
    motor = make("motor_bldc", {"set_value": 24.0, "tau": 0.165, **NO_LIMITS})
    motor.step(3.0)
    assert motor["w"] == pytest.approx(9120 * RPM, rel=0.015)
    assert motor["i"] == pytest.approx(7.39, rel=0.015)


def test_coast_down_under_viscous_friction_is_exponential(make: Make) -> None:
    start = {"enable": False, "w": 400.0, "friction.tau_C": 0.0}
    out = make("motor_bldc", start, tolerance=1e-8).run(2.0, 0.05, ["w", "i"])
    np.testing.assert_allclose(out["w"], 400 * np.exp(-D / J * out["time"]), rtol=1e-6)
    assert np.all(out["i"] == 0)


def test_coast_down_under_coulomb_friction_is_a_line_that_ends_at_rest(make: Make) -> None:
    start = {"enable": False, "w": 400.0, "friction.d": 0.0}
    out = make("motor_bldc", start).run(2.5, 0.05, ["w"])
    moving = out["w"] > 20
    np.testing.assert_allclose(out["w"][moving], 400 - TAU_C / J * out["time"][moving], atol=1e-3)
    assert abs(out["w"][-1]) < 1e-5


def test_work_given_is_the_shafts(make: Make) -> None:
    """speed held by an immense inertia"""
    motor = make("motor_bldc", {"tau": 0.03, "w": -50.0, "enable": False, **HELD})
    motor.step(2.0)
    assert motor["W"] == pytest.approx(-0.03 * 50 * 2, rel=1e-6)
    assert motor["W_abs"] == pytest.approx(0.03 * 50 * 2, rel=1e-6)


def test_electrical_energy_becomes_heat_and_kinetic_energy(make: Make) -> None:
    motor = make("motor_bldc", {"set_value": 3.0, **NO_LIMITS}, tolerance=1e-8)
    out = motor.run(0.05, 1e-5, ["v", "i", "w"])
    v, i, w = out["v"], out["i"], out["w"]
    power = v * i - R * i**2 - TAU_C * np.tanh(w) * w - D * w**2
    stored = J * w[-1] ** 2 / 2 + L * i[-1] ** 2 / 2
    assert stored == pytest.approx(np.trapezoid(power, out["time"]), rel=1e-4)


def test_additive_voltage_and_torque_act_at_their_places(make: Make) -> None:
    motor = make("motor_bldc")
    motor.set({"v_add": 0.5, "tau_add": 0.02})
    assert motor["v"] == 0.5
    assert motor.rate("x_i") == pytest.approx(0.5 / L)
    assert motor.rate("w") == pytest.approx(0.02 / J)


def test_winding_warms_up_by_its_losses(make: Make) -> None:
    """rise = R_th R i^2 (1 - exp(-t/T)), resistance as yet independent of temperature"""
    start = {"drive.mode": 2, "set_value": 4.0, **HELD, "winding_heating.T": 20.0, "winding_heating.R_th": 4.0}
    out = make("motor_bldc", start).run(60.0, 1.0, ["T_w"])
    rise = 4.0 * R * 16 * (1 - np.exp(-out["time"] / 20.0))
    np.testing.assert_allclose(out["T_w"], 298.15 + rise, atol=0.01)


def test_phases_hall_and_encoder_show_during_the_initialization(instantiate: Make) -> None:
    motor = instantiate("motor_bldc")
    motor.fmu.setupExperiment()
    motor.fmu.enterInitializationMode()
    motor.set({"phi": 1.0, "w": 100.0, "x_i": 2.0})  # 57 degrees: A high, B low
    assert motor["hall"] == 1
    assert (motor["H1"], motor["H2"], motor["H3"]) == (1, 0, 0)
    assert (motor["i_a"], motor["i_b"], motor["i_c"]) == (2, -2, 0)
    assert motor["e_a"] == pytest.approx(K / 2 * 100)
    assert motor["e_b"] == pytest.approx(-K / 2 * 100)
    assert motor["encoder_count"] == np.floor(2000 / (2 * np.pi))


def test_derivatives_of_phase_outputs_are_theirs(make: Make) -> None:
    motor = make("motor_bldc", {"phi": 1.0, "w": 100.0, "x_i": 2.0, "set_value": 5.0})
    assert motor.rate("i_a") == pytest.approx(motor.rate("x_i"), rel=1e-4)
    assert motor.rate("e_a") == pytest.approx(K / 2 * motor.rate("w"), rel=1e-4)
