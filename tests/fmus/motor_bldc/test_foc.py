"""The motor with sinusoidal back-EMFs under field-oriented control: closed forms, limits, phases, energy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson

Make = Callable[..., Any]

AVERAGED, SIMSCAPE, FOC = 1, 2, 4
R, L, K, J, V_BUS = 0.209, 84.3e-6, 0.0232, 5.38e-6, 24.0
HELD = {"rotor.J": 1e3}
LEVEL = {"motor.level": FOC}
CURRENT_MODE = {**LEVEL, "drive.mode": 2}
NO_LIMITS = {"drive.i_peak": 0.0, "drive.v_max": 0.0, "drive.w_max": 0.0}
NO_FRICTION = {"friction.tau_C": 0.0, "friction.d": 0.0}
FED_FORWARD = {"drive.decoupling": 1.0}
THIRD = 2 * np.pi / 3


@pytest.mark.parametrize("p", [1, 7])
@pytest.mark.parametrize(("v", "tau"), [(12.0, 0.0), (12.0, 0.0765), (-6.0, -0.03)])
def test_same_voltage_gives_the_averaged_levels_current_and_speed(make: Make, v: float, tau: float, p: int) -> None:
    settled = []
    for level in (AVERAGED, FOC):
        motor = make("motor_bldc", {"motor.level": level, "set_value": v, "tau": tau, "winding.p": p}, tolerance=1e-8)
        motor.step(2.0)
        settled.append((motor["i"], motor["w"], motor["v"], motor["tau_e"]))
    assert settled[1] == pytest.approx(settled[0], rel=1e-5)


def test_same_voltage_at_standstill_gives_the_averaged_levels_current_at_any_time(make: Make) -> None:
    out = make("motor_bldc", {**LEVEL, **HELD, "set_value": 0.5}, tolerance=1e-8).run(2e-3, 1e-4, ["i", "tau_e"])
    np.testing.assert_allclose(out["i"], 0.5 / R * (1 - np.exp(-R / L * out["time"])), atol=1e-5)
    np.testing.assert_allclose(out["tau_e"], K * out["i"], rtol=1e-12)


def test_torque_has_no_ripple_at_constant_speed(make: Make) -> None:
    """where six steps have some"""
    ripple = {}
    for level in (SIMSCAPE, FOC):
        start = {"motor.level": level, "drive.mode": 2, "set_value": 2.0, "w": 200.0, **HELD}
        motor = make("motor_bldc", start)
        motor.step(0.05)
        out = motor.run(0.05 + 2 * np.pi / 200, 1e-4, ["tau_e"])
        ripple[level] = np.ptp(out["tau_e"]) / np.mean(out["tau_e"])
    assert ripple[FOC] < 1e-5
    assert ripple[SIMSCAPE] > 0.01


@pytest.mark.parametrize("w", [0.0, 300.0])
@pytest.mark.parametrize("w_c", [2000.0, 6000.0])
def test_q_current_follows_its_set_value_with_the_loops_bandwidth(make: Make, w_c: float, w: float) -> None:
    """at speed where back-EMF and the other axis are fed forward"""
    start = {**CURRENT_MODE, **HELD, **FED_FORWARD, "drive.w_c": w_c, "winding.p": 4, "w": w}
    motor = make("motor_bldc", {**start, "set_value": 2.0}, tolerance=1e-8)
    out = motor.run(5e-3, 1e-4, ["i", "x_d"])
    np.testing.assert_allclose(out["i"], 2.0 * (1 - np.exp(-w_c * out["time"])), atol=1e-4)
    np.testing.assert_allclose(out["x_d"], 0, atol=1e-6)


def test_d_current_goes_with_the_poles_of_loop_and_winding(make: Make) -> None:
    """L di_d/dt = -R i_d - w_c (L i_d + R integral(i_d)): poles at -w_c and -R/L"""
    w_c, a = 6000.0, R / L
    out = make("motor_bldc", {**LEVEL, **HELD, "x_d": 3.0}, tolerance=1e-8).run(2e-3, 1e-4, ["x_d", "i"])
    closed = 3.0 * (w_c * np.exp(-w_c * out["time"]) - a * np.exp(-a * out["time"])) / (w_c - a)
    np.testing.assert_allclose(out["x_d"], closed, atol=1e-4)
    assert np.all(out["i"] == 0)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_cross_coupling_that_is_not_fed_forward_leaves_a_d_current_while_the_speed_changes(
    make: Make, share: float
) -> None:
    """w_c R (0 - i_d) = (1 - share) de_d/dt in the steady ramp, e_d = -p w L i"""
    p, J_r, w_c = 4, 1e-5, 6000.0
    start = {**CURRENT_MODE, **NO_LIMITS, **NO_FRICTION, "set_value": 1.0, "rotor.J": J_r, "winding.p": p}
    motor = make("motor_bldc", {**start, "drive.decoupling": share}, tolerance=1e-9)
    motor.step(0.02)
    rate = K * motor["i"] / J_r
    assert motor["i"] == pytest.approx(1 / (1 + (1 - share) * K**2 / (J_r * w_c * R)), rel=1e-3)
    assert motor["x_d"] == pytest.approx((1 - share) * p * L * motor["i"] * rate / (w_c * R), rel=2e-2, abs=1e-8)


@pytest.mark.parametrize("mode", [1, 2])
@pytest.mark.parametrize(("v_max", "w"), [(24.0, 1000.0), (12.0, 480.0), (24.0, -1000.0)])
def test_voltage_ends_on_the_circle_of_space_vector_modulation(make: Make, mode: int, v_max: float, w: float) -> None:
    """(R i + k w)^2 + (p w L i)^2 = v_max^2: the bus is the largest amplitude between two terminals"""
    p, set_value = 8, np.copysign(30.0, w)
    start = {**LEVEL, **HELD, "drive.mode": mode, "winding.p": p, "w": w, "set_value": set_value}
    motor = make("motor_bldc", {**start, **NO_LIMITS, "drive.v_max": v_max}, tolerance=1e-8)
    motor.step(0.2)
    i = np.roots([R**2 + (p * w * L) ** 2, 2 * R * K * abs(w), (K * w) ** 2 - v_max**2]).max() * np.sign(w)
    assert np.hypot(motor["v"], motor["v_d"]) == pytest.approx(v_max, rel=1e-9)
    assert abs(motor["v_d"]) > 0.05 * v_max
    assert motor["i"] == pytest.approx(i, rel=1e-4)
    assert motor["x_d"] == pytest.approx(0, abs=1e-4)


def test_loop_does_not_wind_up_at_the_voltage_limit(make: Make) -> None:
    motor = make("motor_bldc", {**CURRENT_MODE, **HELD, "set_value": 3.0, "w": 1030.0, "drive.w_max": 0.0})
    motor.step(5.0)
    assert np.hypot(motor["v"], motor["v_d"]) == pytest.approx(24, rel=1e-9)
    motor.set({"set_value": 0.0})
    motor.step(0.01)
    assert abs(motor["i"]) < 0.05


@pytest.mark.parametrize("p", [1, 3])
def test_phases_are_sinusoids_with_the_currents_in_phase_with_the_back_emfs(make: Make, p: int) -> None:
    """amplitudes k w/sqrt(3) and 2 i/sqrt(3): between two terminals the back-EMF has k w"""
    w, i = 20.0, 2.0
    names = [f"{quantity}_{x}" for quantity in "ie" for x in "abc"]
    motor = make("motor_bldc", {**CURRENT_MODE, **HELD, "winding.p": p, "set_value": i, "w": w}, tolerance=1e-8)
    motor.step(0.01)
    out = motor.run(0.4, 1e-3, [*names, "phi"])
    for x, lag in zip("abc", (0, THIRD, 2 * THIRD), strict=True):
        wave = np.sin(p * out["phi"] - lag)
        np.testing.assert_allclose(out[f"e_{x}"], K * w / np.sqrt(3) * wave, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(out[f"i_{x}"], 2 / np.sqrt(3) * i * wave, atol=1e-4)
    np.testing.assert_allclose(np.ptp(out["e_a"] - out["e_b"]), 2 * K * w, rtol=1e-3)


def test_phase_currents_add_up_to_nothing_and_have_the_amplitude_of_both_axes(make: Make) -> None:
    start = {**LEVEL, "set_value": 12.0, "winding.p": 4, "x_d": 2.0, "tau": 0.05}
    out = make("motor_bldc", start).run(0.05, 3.7e-5, ["i_a", "i_b", "i_c", "i", "x_d"])
    i = np.array([out[f"i_{x}"] for x in "abc"])
    np.testing.assert_allclose(i.sum(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose((i**2).sum(axis=0), 2 * (out["i"] ** 2 + out["x_d"] ** 2), rtol=1e-12)


def test_directional_derivatives_of_phases_are_those_of_sinusoids(make: Make) -> None:
    p, phi, i, w = 3, 0.4, 2.0, 50.0
    motor = make("motor_bldc", {**LEVEL, "winding.p": p, "phi": phi, "x_i": i, "w": w})
    by_phi = motor.fmu.getDirectionalDerivative(motor.vr("i_a", "e_a"), motor.vr("phi"), [1.0])
    slope = p * np.cos(p * phi) / np.sqrt(3)
    assert by_phi == pytest.approx([2 * i * slope, K * w * slope], rel=1e-6)


@pytest.mark.parametrize("decoupling", [0.0, 1.0])
def test_electrical_power_is_copper_loss_mechanical_power_and_what_is_stored(make: Make, decoupling: float) -> None:
    """over a run-up under load, the d axis in use"""
    start = {**LEVEL, **NO_FRICTION, **NO_LIMITS, "set_value": 12.0, "winding.p": 6, "x_d": 4.0, "tau": 0.02}
    motor = make("motor_bldc", {**start, "drive.decoupling": decoupling}, tolerance=1e-9)
    out = motor.run(0.02, 1e-5, ["v", "v_d", "i", "x_d", "w", "W", "i_a", "i_b", "i_c"])
    given = simpson(out["v"] * out["i"] + out["v_d"] * out["x_d"], x=out["time"])
    copper = simpson(R / 2 * sum(out[f"i_{x}"] ** 2 for x in "abc"), x=out["time"])
    magnetic, kinetic = L / 2 * (out["i"] ** 2 + out["x_d"] ** 2), J / 2 * out["w"] ** 2
    stored = magnetic[-1] - magnetic[0] + kinetic[-1] - kinetic[0]
    assert min(copper, out["W"][-1], kinetic[-1]) > 0.01
    assert given == pytest.approx(copper + out["W"][-1] + stored, rel=1e-4)


def test_switches_are_in_series_with_both_axes(make: Make) -> None:
    start = {**LEVEL, "x_i": 2.0, "x_d": 3.0, "w": 100.0}
    off, on = (make("motor_bldc", {**start, "mosfet.R_on": R_on}) for R_on in (0.0, 0.02))
    assert on.rate("x_i") - off.rate("x_i") == pytest.approx(-0.04 * 2.0 / L)
    assert on.rate("x_d") - off.rate("x_d") == pytest.approx(-0.04 * 3.0 / L)


def test_both_axes_heat_the_winding(make: Make) -> None:
    motor = make("motor_bldc", {**LEVEL, "x_i": 2.0, "x_d": 3.0, "winding_heating.T": 20.0})
    assert motor.rate("rise") == pytest.approx(4.0 * R * (2.0**2 + 3.0**2) / 20.0)


def test_bridge_that_is_switched_off_takes_the_d_current_with_it_and_gives_nothing(make: Make) -> None:
    """the rotor coasts against friction as soon as q's current has gone through the diodes"""
    motor = make("motor_bldc", {**LEVEL, "set_value": 12.0, "winding.p": 4, "tau": 0.05})
    motor.step(0.5)
    motor.set({"enable": False, "tau": 0.0})
    out = motor.run(0.6, 1e-4, ["i", "x_d", "tau_e", "w", "i_a", "v_d"])
    assert out["i"][0] > 1
    assert np.all(out["x_d"][1:] == 0)
    assert np.all(out["i"][5:] == 0)
    assert np.all(out["i_a"][5:] == 0)
    assert np.all(out["tau_e"][5:] == 0)
    assert np.all(np.diff(out["w"][5:]) < 0)


def test_no_event_comes_with_commutation(instantiate: Make) -> None:
    """a turn that six steps take in six events"""
    events = {}
    for level in (SIMSCAPE, FOC):
        motor = instantiate("motor_bldc")
        motor.fmu.setDebugLogging(True, ["logEvents"])
        motor.initialise({"motor.level": level, "set_value": 12.0, "w": 400.0, **HELD})
        motor.step(2 * np.pi / 400)
        events[level] = [line for line in motor.log if "sector" in line]
    assert events[SIMSCAPE]
    assert not events[FOC]
