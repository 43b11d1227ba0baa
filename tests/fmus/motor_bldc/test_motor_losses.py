"""What bridge, supply, magnet and iron do beyond the base model: closed forms and energy; off at zero."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson

Make = Callable[..., Any]

AVERAGED, SIMSCAPE, FOC, SWITCHING = 1, 2, 4, 5
R, L, K, J, V_BUS = 0.209, 84.3e-6, 0.0232, 5.38e-6, 24.0
HELD = {"rotor.J": 1e3}
NO_FRICTION = {"friction.tau_C": 0.0, "friction.d": 0.0}


def test_warm_magnet_gives_less_torque_and_back_emf_alike(make: Make) -> None:
    start = {"x_i": 3.0, "w": 200.0, "rise_m": 80.0, "magnet.beta": 1.1e-3}
    motor = make("motor_bldc", start)
    k = K * (1 - 1.1e-3 * 80)
    assert motor["tau_e"] == pytest.approx(k * 3.0)
    assert motor.rate("x_i") == pytest.approx((motor["v"] - R * 3.0 - k * 200.0) / L, rel=1e-9)


def test_magnet_takes_the_temperature_of_the_winding(make: Make) -> None:
    """the winding kept 60 K warm by its own time constant"""
    start = {"rise": 60.0, "winding_heating.T": 1e4, "winding_heating.R_th": 0.0, "magnet.T": 5.0, "magnet.beta": 1e-9}
    motor = make("motor_bldc", start)
    out = motor.run(10.0, 0.1, ["rise_m"])
    lag = (np.exp(-out["time"] / 1e4) - np.exp(-out["time"] / 5.0)) / (1 - 5.0 / 1e4)
    np.testing.assert_allclose(out["rise_m"], 60 * lag, atol=1e-3)


@pytest.mark.parametrize(("h", "a", "exponent"), [(1.0, 0.0, 1.0), (0.0, 1.0, 1.5), (0.0, 0.0, 2.0)])
@pytest.mark.parametrize("w", [1000.0, 250.0, -250.0])
def test_iron_loses_hysteresis_excess_and_eddy_currents_with_their_powers_of_speed(
    make: Make, h: float, a: float, exponent: float, w: float
) -> None:
    term = {"iron_loss.P": 3.0, "iron_loss.h": h, "iron_loss.a": a}
    off, on = make("motor_bldc", {"w": w}), make("motor_bldc", {"w": w, **term})
    lost = -J * w * (on.rate("w") - off.rate("w"))
    assert lost == pytest.approx(3.0 * (abs(w) / 1000) ** exponent, rel=1e-9)


def test_heat_of_the_iron_warms_the_housing(make: Make) -> None:
    start = {"w": 1000.0, "winding_heating.R_h": 2.0, "winding_heating.T_h": 50.0, "iron_loss.P": 3.0, **HELD}
    assert make("motor_bldc", start).rate("rise_h") == pytest.approx(2.0 * 3.0 / 50.0)


def test_switches_are_in_series_with_the_winding(make: Make) -> None:
    motor = make("motor_bldc", {"set_value": 0.5, "mosfet.R_on": 0.02, **HELD})
    motor.step(0.02)
    assert motor["i"] == pytest.approx(0.5 / (R + 0.04), rel=1e-4)


@pytest.mark.parametrize(("v", "i"), [(6.0, 5.0), (6.0, -5.0), (24.0, 5.0)])
def test_diode_takes_its_voltage_while_the_chopper_is_off(make: Make, v: float, i: float) -> None:
    motor = make("motor_bldc", {"set_value": v, "x_i": i, "w": v / K, "diode_drop.V_d": 0.7})
    assert motor["v"] == pytest.approx(v - 0.7 * (1 - v / V_BUS) * np.sign(i), rel=1e-9)


def test_current_of_the_open_bridge_flows_against_supply_and_two_diodes(make: Make) -> None:
    motor = make("motor_bldc", {"x_i": 5.0, "enable": False, "diode_drop.V_d": 0.7, **HELD})
    out = motor.run(1.2e-5, 1e-6, ["i", "v"])
    v, tau = -(V_BUS + 1.4), L / R
    np.testing.assert_allclose(out["v"], v)
    np.testing.assert_allclose(out["i"], (5.0 - v / R) * np.exp(-out["time"] / tau) + v / R, rtol=1e-4)


def test_floating_phase_conducts_at_half_the_supply_and_a_diode(make: Make) -> None:
    """the phase that opens at 90 degrees, as in test_current_of_the_opening_phase_freewheels_to_zero"""
    slopes = []
    for V_d in (0.0, 0.9):
        start = {"motor.level": SIMSCAPE, "set_value": 3.0, "w": 100.0, "phi": np.radians(89.9), "diode_drop.V_d": V_d}
        motor = make("motor_bldc", {**start, "x_ia": 3.0, "x_ib": -3.0, **HELD})
        out = motor.run(2.4e-5, 1e-6, ["i_b"])
        slopes.append((out["i_b"][-1] - out["i_b"][-4]) / 3e-6)
    share = 2 / 3  # of the phase's own voltage, beside those of the star
    assert slopes[1] - slopes[0] == pytest.approx(share * 0.9 / (L / 2), rel=0.05)


@pytest.mark.parametrize("duty", [0.5, 0.2, 1.0])
def test_ripple_of_the_current_heats_the_winding(make: Make, duty: float) -> None:
    """no mean current: the speed is that of the voltage"""
    v = duty * V_BUS
    start = {"set_value": v, "w": v / K, "pwm.T": 1 / 53.6e3, "drive.w_max": 0.0}
    i_pp = V_BUS * duty * (1 - duty) / 53.6e3 / L
    assert make("motor_bldc", start).rate("rise") == pytest.approx(4.0 * R * i_pp**2 / 12 / 20.0, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("level", [AVERAGED, SIMSCAPE, FOC, SWITCHING])
@pytest.mark.parametrize("enable", [True, False])
def test_what_a_braked_rotor_gives_is_in_the_bus_capacitor_or_heat(make: Make, level: int, enable: bool) -> None:
    """the bridge on: against a lower voltage; off: by its diodes, from above the supply's voltage"""
    start = {"motor.level": level, "w": 1600.0, "set_value": 20.0, "enable": enable, "drive.w_max": 0.0}
    start |= {"bus.C": 0.01, "bus.R_ch": 0.0, "bias.i_0": 0.0, "viscous_dynamic.D": 0.0, "J_coupled": 1e-4}
    motor = make("motor_bldc", {**start, **NO_FRICTION}, tolerance=1e-8)
    out = motor.run(0.1, 1e-5, ["w", "v_dc", "i_a", "i_b", "i_c"])
    J_all, i = 1e-4 + J, np.array([out[f"i_{x}"] for x in "abc"])
    kinetic = J_all / 2 * (out["w"][0] ** 2 - out["w"][-1] ** 2)
    heat = simpson(R / 2 * np.sum(i**2, axis=0), x=out["time"]) + L / 4 * np.sum(i[:, -1] ** 2)
    stored = 0.01 / 2 * (out["v_dc"][-1] ** 2 - V_BUS**2)
    assert stored > 1.0
    assert kinetic == pytest.approx(heat + stored, rel=5e-3)


def test_chopper_takes_what_exceeds_its_voltage(make: Make) -> None:
    motor = make("motor_bldc", {"surge": 8.0, "bus.C": 1e-3, "bus.v_ch": 27.0, "bus.R_ch": 5.0})
    out = motor.run(0.02, 1e-3, ["v_dc"])
    np.testing.assert_allclose(out["v_dc"], 27 + 5 * np.exp(-out["time"] / 5e-3), rtol=1e-5)


def test_supply_holds_its_voltage_while_the_motor_drives(make: Make) -> None:
    motor = make("motor_bldc", {"set_value": 12.0, "tau": 0.05, "bus.C": 1e-3})
    out = motor.run(0.2, 1e-3, ["v_dc", "i"])
    assert np.all(out["i"][1:] > 0)
    np.testing.assert_array_equal(out["v_dc"], V_BUS)
