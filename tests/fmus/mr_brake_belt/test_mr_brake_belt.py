"""Belt and brake alone, base model: closed forms and conservation of energy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.optimize import brentq

Make = Callable[..., Any]

J_P, J_B, R, C_B, D_B = 2e-3, 3e-4, 4.1, 60.0, 0.05
TAU_OFF, D_OFF, W_B0, W_H, OMEGA_M = 0.08, 1e-3, 0.5, 0.02, 62.0


def curve(i: float) -> float:
    """docs/bench.md: k_b |i| up to 2.5 N.m, then saturating towards 3.84 N.m"""
    linear, h = 2.5 * abs(i), 3.84 - 2.5
    return linear if linear <= 2.5 else 2.5 + h * (1 - np.exp(-(linear - 2.5) / h))


@pytest.mark.parametrize("i", [0.0, 0.2, -0.4, 1.0, 1.2, 2.0, -2.8])
def test_torque_follows_the_brake_curve(make: Make, i: float) -> None:
    brake = make("mr_brake_belt", {"i_b": i})
    brake.step(1.0)
    assert brake["tau_m"] == pytest.approx(curve(i), abs=1e-5)


def test_torque_saturates_at_the_rated_one(make: Make) -> None:
    brake = make("mr_brake_belt", {"i_b": 50.0, "driver.i_max": 100.0})
    brake.step(1.0)
    assert brake["tau_m"] == pytest.approx(3.84, abs=1e-5)


def test_torque_lags_with_62_rad_per_s_up_and_down(make: Make) -> None:
    brake = make("mr_brake_belt", {"i_b": 0.8})
    up = brake.run(0.1, 1e-3, ["tau_m"])
    np.testing.assert_allclose(up["tau_m"], 2.0 * (1 - np.exp(-OMEGA_M * up["time"])), atol=2e-5)
    top = brake["tau_m"]
    brake.set({"i_b": 0.0})
    down = brake.run(0.2, 1e-3, ["tau_m"])
    np.testing.assert_allclose(down["tau_m"], top * np.exp(-OMEGA_M * (down["time"] - 0.1)), atol=2e-5)


def test_run_starts_without_torque_whatever_the_current(make: Make) -> None:
    assert make("mr_brake_belt", {"i_b": 1.0})["tau_m"] == 0


def test_driver_limits_the_coil_current(make: Make) -> None:
    brake = make("mr_brake_belt", {"i_b": 10.0})
    assert brake["i_coil"] == 2.8
    brake.set({"i_b": -10.0})
    assert brake["i_coil"] == -2.8


def test_coil_current_lags_where_the_driver_has_a_time_constant(make: Make) -> None:
    brake = make("mr_brake_belt", {"i_b": 0.5, "driver.T": 0.01})
    out = brake.run(0.05, 1e-3, ["i_coil"])
    np.testing.assert_allclose(out["i_coil"], 0.5 * (1 - np.exp(-out["time"] / 0.01)), atol=2e-5)


@pytest.mark.parametrize("sign", [1, -1])
def test_steady_speed_balances_off_state_torque_and_viscous_friction(make: Make, sign: int) -> None:
    brake = make("mr_brake_belt", {"tau_s": sign * 0.4})
    brake.step(30.0)
    tau_belt = 0.4 / R
    w_b = brentq(lambda w: TAU_OFF * np.tanh(w / W_B0) + D_OFF * w - tau_belt, 0, 100)
    assert brake["w_b"] == pytest.approx(sign * w_b, rel=1e-6)
    assert brake["tau_belt"] == pytest.approx(sign * tau_belt, rel=1e-6)


def test_brake_turns_4_1_times_as_fast_as_the_pulley(make: Make) -> None:
    brake = make("mr_brake_belt", {"tau_s": 1.0})
    brake.step(30.0)
    assert brake["w_b"] == pytest.approx(4.1 * brake["w_p"], rel=1e-7)
    assert brake["phi_b"] == pytest.approx(4.1 * brake["phi_p"] - brake["tau_belt"] / C_B, rel=1e-7)


def test_pulley_swings_on_the_belt_with_its_natural_frequency(make: Make) -> None:
    """the brake held by an immense inertia: J_p phi'' = -r^2 c_b phi"""
    start = {"phi_p": 0.01, "brake.J_b": 1e3, "brake.tau_off": 0.0, "belt.d_b": 0.0}
    out = make("mr_brake_belt", start, tolerance=1e-9).run(0.05, 1e-3, ["phi_p"])
    omega = R * np.sqrt(C_B / J_P)
    np.testing.assert_allclose(out["phi_p"], 0.01 * np.cos(omega * out["time"]), atol=1e-6)


def test_added_torques_act_on_their_shafts(make: Make) -> None:
    brake = make("mr_brake_belt")
    brake.set({"tau_add": 0.3, "tau_b_add": -0.2})
    assert brake.rate("w_p") == pytest.approx(0.3 / J_P)
    assert brake.rate("w_b") == pytest.approx(-0.2 / J_B)


def test_added_angle_stretches_the_belt(make: Make) -> None:
    brake = make("mr_brake_belt")
    brake.set({"stretch_add": 0.01})
    assert brake["tau_belt"] == pytest.approx(C_B * 0.01)
    assert brake.rate("w_b") == pytest.approx(C_B * 0.01 / J_B)
    assert brake.rate("w_p") == pytest.approx(-R * C_B * 0.01 / J_P)


@pytest.mark.parametrize("tau_s", [3.0, -3.0])
def test_hand_lets_nothing_but_its_smoothed_creep_through(make: Make, tau_s: float) -> None:
    """w_p = w_h artanh(tau_s/tau_h), the belt taken off"""
    brake = make("mr_brake_belt", {"tau_s": tau_s, "tau_h": 4.0, "belt.r": 0.0})
    brake.step(1.0)
    assert brake["w_p"] == pytest.approx(W_H * np.arctanh(tau_s / 4.0), rel=1e-3)


@pytest.mark.parametrize("w", [2.0, -2.0, 0.01])
def test_hand_only_ever_takes_energy(make: Make, w: float) -> None:
    out = make("mr_brake_belt", {"w_p": w, "tau_h": 4.0, "belt.r": 0.0}).run(5e-3, 1e-4, ["w_p"])
    noise = 3e-6  # rad/s, the integrator's tolerance at rest
    assert np.all(np.diff(np.abs(out["w_p"])) < noise)
    assert np.all(out["w_p"] * np.sign(w) > -noise)
    assert abs(out["w_p"][-1]) < noise


def test_negative_grip_counts_as_none(make: Make) -> None:
    start = {"w_p": 1.0, "w_b": 4.1}
    none = make("mr_brake_belt", start).run(0.1, 1e-3, ["w_p"])
    negative = make("mr_brake_belt", {**start, "tau_h": -4.0}).run(0.1, 1e-3, ["w_p"])
    np.testing.assert_array_equal(negative["w_p"], none["w_p"])


def test_rest_under_a_firm_grip_is_stable_and_quick(make: Make) -> None:
    """sgn(w_p, 0.02) under 4 N.m is a rate of 1e5 1/s; ten seconds of it in ten steps"""
    brake = make("mr_brake_belt", {"tau_s": 3.0, "tau_h": 4.0, "i_b": 1.0})
    out = brake.run(10.0, 1.0, ["w_p"])
    assert np.ptp(out["w_p"][-3:]) < 1e-6
    assert 0 < out["w_p"][-1] < W_H


def test_work_taken_is_stored_or_lost_where_the_equations_say(make: Make) -> None:
    brake = make("mr_brake_belt", tolerance=1e-8)
    names = ["phi_p", "w_p", "phi_b", "w_b", "tau_m", "W", "W_abs"]
    inputs = {
        "tau_s": lambda t: 3.0 * np.sin(20 * t),
        "i_b": lambda t: 0.3 * (t > 0.1),
        "tau_h": lambda t: 1.0 * (t > 0.25),
    }
    out = brake.run(0.4, 2e-5, names, inputs)
    phi_p, w_p, phi_b, w_b, tau_m, W, W_abs = (out[name] for name in names)
    tau_h = np.array([inputs["tau_h"](t) for t in out["time"]])
    stored = J_P * w_p**2 / 2 + J_B * w_b**2 / 2 + C_B * (R * phi_p - phi_b) ** 2 / 2
    loss = (tau_m + TAU_OFF) * np.tanh(w_b / W_B0) * w_b + D_OFF * w_b**2 + D_B * (R * w_p - w_b) ** 2
    loss += tau_h * np.tanh(w_p / W_H) * w_p
    assert np.all(loss >= 0)
    assert W[-1] == pytest.approx(stored[-1] + simpson(loss, x=out["time"]), rel=2e-4)
    tau_s = 3.0 * np.sin(20 * out["time"])
    assert W_abs[-1] == pytest.approx(simpson(np.abs(tau_s * w_p), x=out["time"]), rel=1e-4)
    assert abs(W[-1]) < W_abs[-1]
