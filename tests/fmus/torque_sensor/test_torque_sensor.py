"""The torque sensor alone: shaft, amplifier, calibration, terms of the reading."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

C_S, D_S = 955.0, 0.2
TAU_5 = {"phi_o": 5 / C_S}  # 5 N.m


def test_shaft_is_a_spring_of_955_newton_metres_per_radian_with_damping(make: Make) -> None:
    sensor = make("torque_sensor", {"phi_o": 0.011, "phi_p": 0.003, "w_o": 0.7, "w_p": -0.4})
    assert sensor["tau_s"] == pytest.approx(C_S * 0.008 + D_S * 1.1, rel=1e-12)


def test_couplings_are_in_series_with_the_shaft(make: Make) -> None:
    sensor = make("torque_sensor", {"phi_o": 0.01, "shaft.s_o": 1 / 2000, "shaft.s_p": 1 / 500})
    assert sensor["tau_s"] == pytest.approx(0.01 / (1 / C_S + 1 / 2000 + 1 / 500), rel=1e-12)


def test_couplings_are_rigid_as_the_unit_starts(make: Make) -> None:
    assert make("torque_sensor", {"phi_o": 0.01})["tau_s"] == C_S * 0.01


def test_reading_is_the_shafts_torque_as_the_unit_starts(make: Make) -> None:
    sensor = make("torque_sensor", {**TAU_5, "w_o": 0.3})
    assert sensor["tau_reading"] == sensor["tau_s"]


@pytest.mark.parametrize("tau", [-10.0, -2.0, 0.0, 7.2, 10.0])
def test_ten_newton_metres_are_five_volts(make: Make, tau: float) -> None:
    sensor = make("torque_sensor", {"phi_o": tau / C_S})
    assert sensor["y"] == pytest.approx(tau / 2, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("sign", [1, -1])
def test_amplifier_saturates_at_five_volts_and_the_shaft_does_not(make: Make, sign: int) -> None:
    sensor = make("torque_sensor", {"phi_o": sign * 13 / C_S})
    assert sensor["y"] == sign * 5
    assert sensor["tau_s"] == pytest.approx(sign * 13, rel=1e-12)


@pytest.mark.parametrize(("tau", "overload"), [(14.99, 0), (15.01, 1), (-14.99, 0), (-15.01, 1)])
def test_overload_is_flagged_above_150_percent(make: Make, tau: float, overload: int) -> None:
    assert make("torque_sensor", {"phi_o": tau / C_S})["overload"] == overload


def test_calibration_of_equation_3_3_returns_the_applied_torque(make: Make) -> None:
    """applied = 0.9971 measured + 0.05587"""
    sensor = make("torque_sensor", {**TAU_5, "calibration.a": 0.9971, "calibration.b": 0.05587})
    assert 0.9971 * sensor["tau_reading"] + 0.05587 == pytest.approx(5, rel=1e-12)


def test_added_torque_enters_the_reading_alone(make: Make) -> None:
    sensor = make("torque_sensor", {**TAU_5, "y_add": 0.3})
    assert sensor["tau_reading"] == pytest.approx(5.3, rel=1e-12)
    assert sensor["tau_s"] == pytest.approx(5, rel=1e-12)


def test_work_in_is_work_out_stored_and_damped(make: Make) -> None:
    """phi_o turns at 0.1 rad/s, phi_p stands: W_in = c phi^2/2 + d w^2 t"""
    sensor = make("torque_sensor", {"w_o": 0.1})
    sensor.slope("phi_o", 0.1)
    sensor.step(0.05)
    assert sensor["W_in"] == pytest.approx(C_S * (0.1 * 0.05) ** 2 / 2 + D_S * 0.01 * 0.05, rel=1e-9)
    assert sensor["W_out"] == 0


def test_offset_moves_the_zero(make: Make) -> None:
    assert make("torque_sensor", {"offset.tau_0": -0.04})["tau_reading"] == -0.04


def test_gain_changes_the_span(make: Make) -> None:
    assert make("torque_sensor", {**TAU_5, "gain.g": 0.03})["tau_reading"] == pytest.approx(5.15, rel=1e-12)


def test_low_pass_is_a_first_order_lag(make: Make) -> None:
    start = {**TAU_5, "low_pass.T": 0.02, "low_pass.T_s": 0.0}
    out = make("torque_sensor", start).run(0.1, 1e-3, ["tau_reading"])
    np.testing.assert_allclose(out["tau_reading"], 5 * (1 - np.exp(-out["time"] / 0.02)), atol=1e-4)


def test_low_pass_lets_no_high_frequency_around_it(make: Make) -> None:
    """5 kHz through 1 ms: 1/sqrt(1 + (omega T)^2) = 0.032"""
    T, omega = 1e-3, 2 * np.pi * 5e3
    signal = {"phi_o": lambda t: np.sin(omega * t) / C_S}
    out = make("torque_sensor", {"low_pass.T": T}).run(0.012, 4e-6, ["tau_reading", "tau_s"], signal)
    settled = out["time"] > 0.01
    gain = np.ptp(out["tau_reading"][settled]) / np.ptp(out["tau_s"][settled])
    assert gain == pytest.approx(1 / np.sqrt(1 + (omega * T) ** 2), rel=0.01)


def test_low_pass_matches_a_digital_filter_at_the_loggers_rate(make: Make) -> None:
    """y_k = y_(k-1) + a (x_k - y_(k-1)), a = 1 - exp(-T_s/T)"""
    T, T_s = 0.03, 1e-3
    signal = {"phi_o": lambda t: 5 * np.sin(15 * t) / C_S}
    out = make("torque_sensor", {"low_pass.T": T, "low_pass.T_s": T_s}).run(0.5, T_s, ["tau_reading", "tau_s"], signal)
    a, y = 1 - np.exp(-T_s / T), np.zeros(len(out["time"]))
    for k in range(1, len(y)):
        y[k] = y[k - 1] + a * (out["tau_s"][k] - y[k - 1])
    assert np.sqrt(np.mean((out["tau_reading"] - y) ** 2)) < 2e-3
    plain = make("torque_sensor", {"low_pass.T": T, "low_pass.T_s": 0.0}).run(0.5, T_s, ["tau_reading"], signal)
    assert np.sqrt(np.mean((plain["tau_reading"] - y) ** 2)) > 1e-2


@pytest.mark.parametrize("T", [1e-5, 1e-4, 5e-4, 2e-3])
def test_low_pass_near_or_below_the_loggers_sample_lags_as_the_digital_filter(make: Make, T: float) -> None:
    """On a ramp of slope s the reading lags by s a T_s/(1 - a), a = exp(-T_s/T): by nothing as T vanishes."""
    T_s, slope = 1e-3, 20.0
    signal = {"phi_o": lambda t: slope * t / C_S}
    out = make("torque_sensor", {"low_pass.T": T, "low_pass.T_s": T_s}).run(0.2, T_s, ["tau_reading", "tau_s"], signal)
    lag = slope * T_s / np.expm1(T_s / T)
    assert out["tau_s"][-1] - out["tau_reading"][-1] == pytest.approx(lag, abs=2e-4 * slope * T_s)


def test_low_pass_leaves_the_shaft(make: Make) -> None:
    sensor = make("torque_sensor", {"low_pass.T": 0.02})
    sensor.set(TAU_5)
    assert sensor["tau_s"] == pytest.approx(5, rel=1e-12)


def test_hysteresis_closes_its_loop_with_the_torque_travelled(make: Make) -> None:
    """up: z = 1 - exp(-tau/tau_H); down from tau_1: z = (1 + z_1) exp(-(tau_1 - tau)/tau_H) - 1"""
    H, tau_H, tau_1 = 0.1, 0.5, 2.0

    def torque(t: float) -> float:
        return float(tau_1 * (t if t < 1 else 2 - t))

    sensor = make("torque_sensor", {"hysteresis.H": H, "hysteresis.tau_H": tau_H})
    out = sensor.run(2.0, 1e-2, ["tau_reading", "tau_s"], {"phi_o": lambda t: torque(t) / C_S})
    z = (out["tau_reading"] - out["tau_s"]) / H
    up = out["time"] <= 1
    z_1 = 1 - np.exp(-tau_1 / tau_H)
    np.testing.assert_allclose(z[up], 1 - np.exp(-out["tau_s"][up] / tau_H), atol=6e-3)
    down = out["time"] > 1.05
    expected = (1 + z_1) * np.exp(-(tau_1 - out["tau_s"][down]) / tau_H) - 1
    np.testing.assert_allclose(z[down], expected, atol=1.5e-2)


@pytest.mark.parametrize("n", [1.0, 2.0])
def test_misalignment_ripples_with_the_driven_shafts_turn(make: Make, n: float) -> None:
    term = {"misalignment_ripple.A": 0.06, "misalignment_ripple.n": n, "misalignment_ripple.phi_0": 0.2}
    sensor = make("torque_sensor", {"phi_o": 1.5, "phi_p": 1.5, **term})
    assert sensor["tau_s"] == 0
    assert sensor["tau_reading"] == pytest.approx(0.06 * np.sin(n * 1.5 + 0.2), rel=1e-12)


def test_filter_starts_where_it_is_told_to(make: Make) -> None:
    sensor = make("torque_sensor", {"low_pass.T": 0.02, "low_pass.T_s": 0.0, "y_f": 5.0})
    assert sensor["tau_reading"] == 5.0
