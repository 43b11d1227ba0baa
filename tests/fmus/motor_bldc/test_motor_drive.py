"""The motor's drive and sensors alone: modes, limits, scaling, encoder."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

R, L, K, V_BUS = 0.209, 84.3e-6, 0.0232, 24.0
HELD = {"rotor.J": 1e3}
CURRENT_MODE = {"drive.mode": 2}
NO_LIMITS = {"drive.i_peak": 0.0, "drive.v_max": 0.0, "drive.w_max": 0.0}


def test_current_follows_its_set_value_with_the_loops_bandwidth(make: Make) -> None:
    """pole of the winding cancelled: di/dt = w_c (i_ref - i)"""
    start = {**CURRENT_MODE, **HELD, "set_value": 2.0}
    out = make("motor_bldc", start, tolerance=1e-8).run(2e-3, 5e-5, ["i"])
    np.testing.assert_allclose(out["i"], 2.0 * (1 - np.exp(-6000 * out["time"])), atol=1e-4)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_back_emf_that_is_not_fed_forward_acts_as_an_inertia(make: Make, share: float) -> None:
    """J dw/dt = k i and, in the steady ramp, w_c R (i_ref - i) = (1 - share) k dw/dt"""
    J, w_c = 1e-5, 6000.0
    start = {**CURRENT_MODE, **NO_LIMITS, "set_value": 1.0, "rotor.J": J, "friction.tau_C": 0.0, "friction.d": 0.0}
    out = make("motor_bldc", {**start, "drive.decoupling": share}, tolerance=1e-8).run(0.02, 1e-3, ["i"])
    assert out["i"][-1] == pytest.approx(1 / (1 + (1 - share) * K**2 / (J * w_c * R)), rel=1e-4)


@pytest.mark.parametrize("T_i", [0.0, 0.02])
def test_current_reading_is_averaged_by_a_first_order_filter(make: Make, T_i: float) -> None:
    """behind the current loop: i = i_ref (1 - exp(-w_c t)), through 1/(1 + T_i s)"""
    start = {**CURRENT_MODE, **HELD, "set_value": 2.0, "drive.T_i": T_i}
    out = make("motor_bldc", start, tolerance=1e-8).run(0.1, 1e-3, ["i", "i_reading"])
    if T_i == 0:
        np.testing.assert_array_equal(out["i_reading"], out["i"])
        return
    T = 1 / 6000
    closed = 2.0 * (1 - (T_i * np.exp(-out["time"] / T_i) - T * np.exp(-out["time"] / T)) / (T_i - T))
    np.testing.assert_allclose(out["i_reading"], closed, atol=1e-4)


def test_current_reading_of_three_phases_is_its_average(make: Make) -> None:
    """the commutation's ripple is gone, the mean stays"""
    start = {"motor.level": 2, "set_value": 12.0, "tau": 0.05, "drive.T_i": 0.02}
    motor = make("motor_bldc", start)
    motor.run(0.5, 1e-2)
    out = motor.run(0.52, 1.3e-5, ["i", "i_reading"])
    assert np.std(out["i_reading"]) < 0.05 * np.std(out["i"])
    assert np.mean(out["i_reading"]) == pytest.approx(np.mean(out["i"]), rel=0.01)


def test_set_value_is_scaled_in_both_modes(make: Make) -> None:
    voltage = make("motor_bldc", {"set_value": 2.0, "drive.k_v": 0.7})
    assert voltage["v"] == pytest.approx(1.4)
    current = make("motor_bldc", {**CURRENT_MODE, **HELD, "set_value": 2.0, "drive.k_i": -0.5})
    current.step(0.05)
    assert current["i"] == pytest.approx(-1.0, rel=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("mode", [1, 2])
def test_peak_current_lasts_20_seconds_then_the_continuous_one(make: Make, mode: int, sign: int) -> None:
    start = {"drive.mode": mode, **HELD, "set_value": sign * 24.0}
    out = make("motor_bldc", start).run(30.0, 0.1, ["i"])
    i, t = sign * out["i"], out["time"]
    np.testing.assert_allclose(i[(t > 0.05) & (t < 19.85)], 15.0, rtol=1e-4)
    np.testing.assert_allclose(i[t > 20.25], 5.0, rtol=1e-4)


def test_peak_current_returns_after_a_rest(make: Make) -> None:
    motor = make("motor_bldc", {**CURRENT_MODE, **HELD, "set_value": 20.0})
    motor.step(25.0)
    assert motor["i"] == pytest.approx(5, rel=1e-4)
    motor.set({"set_value": 0.0})
    motor.step(200.0)
    motor.set({"set_value": 20.0})
    motor.step(1.0)
    assert motor["i"] == pytest.approx(15, rel=1e-4)


def test_ten_amperes_last_as_long_as_their_excess_heat_allows(make: Make) -> None:
    """(225 - 25) 20 s = (100 - 25) 53.3 s"""
    out = make("motor_bldc", {**CURRENT_MODE, **HELD, "set_value": 10.0}).run(60.0, 0.1, ["i"])
    last = out["time"][out["i"] > 9].max()
    assert last == pytest.approx(200 * 20 / 75, abs=0.15)


def test_voltage_is_limited_to_24_volts(make: Make) -> None:
    motor = make("motor_bldc", {"set_value": 40.0, "drive.i_peak": 0.0, "drive.w_max": 0.0})
    assert motor["v"] == 24
    motor.set({"set_value": -40.0})
    assert motor["v"] == -24


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("mode", [1, 2])
def test_speed_stays_at_6000_rpm(make: Make, mode: int, sign: int) -> None:
    w_max = 6000 * 2 * np.pi / 60
    out = make("motor_bldc", {"drive.mode": mode, "set_value": sign * 24.0}).run(3.0, 0.01, ["w"])
    assert 0.99 * w_max <= sign * out["w"][-1] <= 1.02 * w_max
    assert np.max(sign * out["w"]) <= 1.05 * w_max  # run-up at full voltage and peak current


def test_current_loop_does_not_wind_up_at_the_voltage_limit(make: Make) -> None:
    """24 V drive 0.5 A at 1030 rad/s and 3 A are out of reach; all the same the current returns at once"""
    motor = make("motor_bldc", {**CURRENT_MODE, "set_value": 3.0, "w": 1030.0, "drive.w_max": 0.0, **HELD})
    motor.step(5.0)
    assert motor["v"] == 24
    assert motor["i"] == pytest.approx((24 - K * 1030) / R, rel=1e-3)
    motor.set({"set_value": 0.0})
    motor.step(0.01)
    assert abs(motor["i"]) < 0.05


def test_static_ixr_compensation_returns_the_windings_drop(make: Make) -> None:
    motor = make("motor_bldc", {"set_value": 1.0, "drive.ixr": 0.5, **HELD, **NO_LIMITS})
    motor.step(0.05)
    assert motor["i"] == pytest.approx(1.0 / (0.5 * R), rel=1e-5)


@pytest.mark.parametrize("level", [1, 2, 4, 5])
def test_without_enable_the_current_freewheels_against_the_supply(make: Make, level: int) -> None:
    motor = make("motor_bldc", {"motor.level": level, "set_value": 1.0, "phi": np.pi / 3, **HELD})
    motor.step(0.05)
    i_0 = motor["i"]
    motor.set({"enable": False})
    t_end = L / R * np.log(1 + R * i_0 / V_BUS)
    out = motor.run(0.05 + 3 * t_end, t_end / 20, ["i"])
    t = out["time"] - 0.05
    falling = t < t_end
    np.testing.assert_allclose(
        out["i"][falling], (i_0 + V_BUS / R) * np.exp(-R / L * t[falling]) - V_BUS / R, atol=1e-3
    )
    assert np.all(out["i"][t > 1.001 * t_end] == 0)


def test_set_value_does_nothing_without_enable(make: Make) -> None:
    motor = make("motor_bldc", {"set_value": 24.0, "enable": False})
    motor.step(1.0)
    assert motor["i"] == 0
    assert motor["w"] == 0


@pytest.mark.parametrize(
    ("source", "w", "i_ref", "sign"), [(1, 50.0, -0.2, 1), (1, -50.0, 0.2, -1), (2, 50.0, -0.2, -1), (2, -50.0, 0.2, 1)]
)
def test_bias_current_follows_the_direction_that_is_chosen(
    make: Make, source: int, w: float, i_ref: float, sign: int
) -> None:
    """1: measured speed, 2: commanded current"""
    start = {**CURRENT_MODE, **HELD, "w": w, "set_value": i_ref, "bias.i_0": 0.105, "bias.from": source}
    motor = make("motor_bldc", start)
    motor.step(0.1)
    assert motor["i"] == pytest.approx(i_ref + sign * 0.105, abs=1e-5)


@pytest.mark.parametrize("level", [1, 2, 4, 5])
@pytest.mark.parametrize("sign", [1, -1])
def test_hall_codes_come_in_order_one_per_sixth_of_a_turn(make: Make, level: int, sign: int) -> None:
    w = sign * 2 * np.pi  # one turn per second
    motor = make("motor_bldc", {"motor.level": level, "w": w, "enable": False, **HELD})
    codes = motor.run(2.0, 0.01, ["hall", "H1", "H2", "H3"])
    np.testing.assert_array_equal(codes["hall"], codes["H1"] + 2 * codes["H2"] + 4 * codes["H3"])
    hall = codes["hall"].astype(int)
    changes = np.flatnonzero(np.diff(hall))
    np.testing.assert_allclose(np.diff(changes), 100 / 6, atol=1)
    order = [1, 3, 2, 6, 4, 5][::sign]
    following = dict(zip(order, order[1:] + order[:1], strict=True))
    assert set(hall) == set(order)
    assert all(following[a] == b for a, b in zip(hall[changes], hall[changes + 1], strict=True))


def test_encoder_counts_2000_per_turn_with_one_index(make: Make) -> None:
    motor = make("motor_bldc", {"w": 2 * np.pi, "enable": False, **HELD})
    out = motor.run(3.5, 1e-4, ["encoder_count", "encoder_index"])
    turns = out["time"]
    np.testing.assert_array_less(np.abs(out["encoder_count"] - 2000 * turns), 1.5)
    assert np.sum(np.diff(out["encoder_index"]) > 0) == 3


def test_speed_reading_is_filtered_and_has_the_encoders_grain(make: Make) -> None:
    start = {"w": 100.0, "enable": False, **HELD}
    out = make("motor_bldc", start).run(0.1, 1e-3, ["w_reading"])
    np.testing.assert_allclose(out["w_reading"], 100 * (1 - np.exp(-out["time"] / 0.005)), atol=2 * np.pi / 2000 / 1e-3)
    assert out["w_reading"][-1] != 100


def test_speed_reading_ends_at_the_encoders_highest_frequency(make: Make) -> None:
    """500 lines at 100 kHz: 200 turns per second"""
    motor = make("motor_bldc", {"w": 3000.0, "enable": False, **HELD})
    motor.run(0.2, 1e-3)
    assert motor["w_reading"] == pytest.approx(2 * np.pi * 200, rel=1e-5)  # whole counts


@pytest.mark.parametrize("level", [1, 2, 3, 4, 5])
def test_back_emf_below_the_supply_drives_no_current_through_the_open_bridge(make: Make, level: int) -> None:
    motor = make("motor_bldc", {"motor.level": level, "w": 500.0, "enable": False, **HELD})
    motor.step(1.0)
    assert (motor["i_a"], motor["i_b"], motor["i_c"]) == (0, 0, 0)
    assert motor["tau_e"] == 0


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("level", [1, 2, 4, 5])
def test_back_emf_above_the_supply_brakes_through_the_open_bridges_diodes(make: Make, level: int, sign: int) -> None:
    """averaged, foc: R i = v_bus - k w; by phases the mean over the sectors comes close to it"""
    w = 1200.0
    motor = make("motor_bldc", {"motor.level": level, "w": sign * w, "enable": False, **HELD})
    out = motor.run(0.1, 0.1 / 1201, ["i", "tau_e"])
    expected = (V_BUS - K * w) / R
    settled = out["time"] > 0.05
    assert np.mean(out["tau_e"][settled]) * sign == pytest.approx(K * expected, rel=0.25 if level == 2 else 1e-3)
    assert np.all(out["tau_e"][settled] * sign <= 1e-9)


@pytest.mark.parametrize("level", [1, 2, 4])
def test_motor_that_is_enabled_again_starts_afresh(make: Make, level: int) -> None:
    start = {"motor.level": level, **CURRENT_MODE, **HELD, "set_value": 2.0, "phi": np.pi / 3}
    motor = make("motor_bldc", start)
    motor.step(0.05)
    motor.set({"enable": False})
    motor.step(0.05)
    assert motor["i"] == 0
    motor.set({"enable": True})
    out = motor.run(0.1 + 2e-3, 1e-4, ["i"])
    np.testing.assert_allclose(out["i"], 2.0 * (1 - np.exp(-6000 * (out["time"] - 0.1))), atol=5e-3)


@pytest.mark.parametrize(("v_max", "expected"), [(48.0, 24.0), (0.0, 24.0), (12.0, 12.0)])
def test_no_limit_of_the_drive_raises_the_voltage_above_its_supply(make: Make, v_max: float, expected: float) -> None:
    start = {"set_value": 100.0, "drive.i_peak": 0.0, "drive.v_max": v_max}
    assert make("motor_bldc", start)["v"] == expected
    assert make("motor_bldc", {**start, "drive.k_v": -1.0})["v"] == -expected


def test_counts_above_the_encoders_highest_frequency_are_lost_for_good(make: Make) -> None:
    """twice too fast for 0.1 s: half of the counts are missing, and stay so at a speed that the encoder follows"""
    lines, f_max = 500, 100e3
    fast = 2 * 2 * np.pi * f_max / lines
    still = {"enable": False, "rotor.J": 1e3, "inverter.v_bus": 1e4, "friction.tau_C": 0.0, "friction.d": 0.0}
    motor = make("motor_bldc", {**still, "w": fast})
    for _ in range(100):
        motor.step(1e-3)
    assert motor["encoder_count"] == pytest.approx(4 * f_max * 0.1, abs=200)
    assert motor["encoder_count"] == pytest.approx(4 * lines * motor["phi"] / (2 * np.pi) / 2, rel=1e-2)


@pytest.mark.parametrize("start_time", [0.0, 5.0])
def test_speed_reading_starts_from_the_first_communication_point(instantiate: Make, start_time: float) -> None:
    motor = instantiate("motor_bldc")
    motor.fmu.setupExperiment(startTime=start_time)
    motor.fmu.enterInitializationMode()
    motor.set({"phi": 100.0})
    motor.fmu.exitInitializationMode()
    assert motor["w_reading"] == 0
