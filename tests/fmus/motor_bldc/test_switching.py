"""The motor under its bridge's pulses: closed forms of an RL circuit, edges in time, losses, the averaged level."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

AVERAGED, SWITCHING = 1, 5
R, L, K, V_BUS = 0.209, 84.3e-6, 0.0232, 24.0
A = R / L
ESCON = 1 / 53.6e3  # s
HELD = {"rotor.J": 1e6}
NO_LIMITS = {"drive.i_peak": 0.0, "drive.v_max": 0.0, "drive.w_max": 0.0}
LEVEL = {"motor.level": SWITCHING, **NO_LIMITS}
CURRENT_MODE = {**LEVEL, "drive.mode": 2}


def at_speed(v: float) -> dict[str, float]:
    """The rotor turns with a back-EMF of v, whatever acts on it."""
    return {"w": v / K, **HELD}


def pulse(D: float, T: float) -> tuple[float, float]:
    """Where it begins and ends within its period."""
    return (1 - abs(D)) / 2 * T, (1 + abs(D)) / 2 * T


def rl(i: float, v: float, dt: float, resistance: float = R) -> float:
    """Current after dt under a constant voltage."""
    return v / resistance + (i - v / resistance) * np.exp(-resistance / L * dt)


def closed_form(t: float, D: float, T: float, e: float, i: float = 0.0) -> float:
    """Current at t of pulses +-v_bus from t = 0 on."""
    on, off = pulse(D, T)
    n = int(t // T)
    for k in range(n + 1):
        left = t - n * T if k == n else T
        for begin, end, v in ((0.0, on, 0.0), (on, off, np.copysign(V_BUS, D)), (off, T, 0.0)):
            i = rl(i, v - e, max(0.0, min(left, end) - begin))
    return i


def settled(i_low: float, make: Make, start: dict[str, float], T: float, periods: int) -> Any:
    """After so many periods, from a current near the end."""
    motor = make("motor_bldc", {**start, "x_i": i_low}, tolerance=1e-9)
    motor.step(periods * T)
    return motor


def mean_over(slave: Any, T: float, names: list[str], periods: int = 1, points: int = 400) -> list[float]:
    """Means over whole periods from now on."""
    out = slave.run(slave.time + periods * T, T / points, names)
    return [float(np.mean((out[name][1:] + out[name][:-1]) / 2)) for name in names]


@pytest.mark.parametrize("v_mean", [0.0, 0.8, -0.8])
@pytest.mark.parametrize(
    ("D", "T"), [(0.5, ESCON), (0.2, ESCON), (-0.7, ESCON), (0.5, 4e-4), (0.1, 4e-4), (-0.8, 4e-4)]
)
def test_ripple_from_peak_to_peak_is_the_exact_one_of_an_rl_circuit(
    make: Make, D: float, T: float, v_mean: float
) -> None:
    """v_bus/R (1 - exp(-a D T)) (1 - exp(-a (1 - D) T))/(1 - exp(-a T)), a = R/L; a triangle misses it if T is long"""
    start = {**LEVEL, "pwm.T": T, "set_value": D * V_BUS, **at_speed(D * V_BUS - v_mean)}
    periods = 3 + int(12 / (A * T))
    motor, (on, off) = settled(v_mean / R, make, start, T, periods), pulse(D, T)
    motor.step(on)
    low = motor["i"]
    motor.step(off - on)
    i_pp = abs(motor["i"] - low)
    part = [1 - np.exp(-A * x * T) for x in (abs(D), 1 - abs(D), 1.0)]
    exact, triangle = V_BUS / R * part[0] * part[1] / part[2], V_BUS * abs(D) * (1 - abs(D)) * T / L
    assert i_pp == pytest.approx(exact, rel=1e-6)
    assert (abs(triangle / exact - 1) > 0.005) == (T > 1e-4)


@pytest.mark.parametrize("h", [1e-3, 2e-4, 7e-6])
@pytest.mark.parametrize(("D", "T"), [(0.3, ESCON), (-0.85, 3.3e-5), (0.5, 1e-4)])
def test_edges_come_at_their_times_whatever_the_communication_step(make: Make, D: float, T: float, h: float) -> None:
    """one that is late by 4 ps is seen: v_bus/L is 0.28 A/us"""
    start = {**LEVEL, "pwm.T": T, "set_value": D * V_BUS, **at_speed(0.9 * D * V_BUS)}
    out = make("motor_bldc", start, tolerance=1e-10).run(4e-3, h, ["i", "v"])
    exact = [closed_form(t, D, T, 0.9 * D * V_BUS) for t in out["time"]]
    np.testing.assert_allclose(out["i"], exact, atol=1e-6)


def test_voltage_at_the_terminals_is_that_of_the_supply_or_none(make: Make) -> None:
    """in the middle of each period"""
    T, D = 1e-4, -0.4
    out = make("motor_bldc", {**LEVEL, "pwm.T": T, "set_value": D * V_BUS, **HELD}).run(5e-4, T / 100, ["v", "v_drive"])
    inside = np.abs(out["time"] / T % 1 - 0.5)
    np.testing.assert_array_equal(out["v"][inside < 0.19], -V_BUS)
    np.testing.assert_array_equal(out["v"][inside > 0.21], 0)
    np.testing.assert_allclose(out["v_drive"], D * V_BUS)


@pytest.mark.parametrize(("set_value", "v"), [(24.0, 24.0), (30.0, 24.0), (-24.0, -24.0), (0.0, 0.0)])
def test_full_and_no_duty_have_no_edges(make: Make, set_value: float, v: float) -> None:
    start = {**LEVEL, "set_value": set_value, **at_speed(v - 0.5)}
    motor = make("motor_bldc", start, tolerance=1e-9)
    out = motor.run(2e-3, 1.3e-5, ["v", "i"])
    np.testing.assert_array_equal(out["v"][1:], v)
    np.testing.assert_allclose(out["i"], 0.5 / R * (1 - np.exp(-A * out["time"])), atol=1e-6)


def test_period_of_zero_is_that_of_the_escon(make: Make) -> None:
    outs = [
        make("motor_bldc", {**LEVEL, "pwm.T": T, "set_value": 6.0, "tau": 0.02}).run(2e-3, 7e-6, ["i", "w"])
        for T in (0.0, ESCON)
    ]
    np.testing.assert_array_equal(outs[0]["i"], outs[1]["i"])
    assert np.ptp(outs[0]["i"][-20:]) > 0.5 * V_BUS * 0.25 * 0.75 * ESCON / L


def test_duty_is_sampled_as_a_period_begins_and_held(make: Make) -> None:
    T = 1e-4
    motor = make("motor_bldc", {**LEVEL, "pwm.T": T, "set_value": 12.0, **HELD}, tolerance=1e-9)
    motor.step(0.4 * T)  # in the pulse
    motor.set({"set_value": -6.0})
    assert motor["v"] == V_BUS
    motor.step(0.34 * T)
    assert motor["v"] == V_BUS
    motor.step(0.02 * T)
    assert motor["v"] == 0
    motor.step(0.7 * T)  # 1.46 T: in the middle of the next pulse
    assert motor["v"] == -V_BUS
    motor.step(0.22 * T)  # it ends at 1.625 T
    assert motor["v"] == 0


def test_period_that_is_changed_counts_from_the_next_one_on(make: Make) -> None:
    motor = make("motor_bldc", {**LEVEL, "pwm.T": 1e-4, "set_value": 12.0, **HELD}, tolerance=1e-9)
    motor.step(1.3e-4)
    motor.set({"pwm.T": 4e-5})
    before = closed_form(2e-4, 0.5, 1e-4, 0.0)
    out = motor.run(3.3e-4, 1e-5, ["i"])
    exact = [closed_form(t - 2e-4, 0.5, 4e-5, 0.0, before) for t in out["time"][8:]]
    np.testing.assert_allclose(out["i"][8:], exact, atol=1e-6)


@pytest.mark.parametrize("mode", [1, 2])
@pytest.mark.parametrize(("set_value", "tau"), [(8.0, 0.06), (5.0, 0.09), (-5.0, -0.09), (2.5, 0.055)])
def test_mean_current_and_speed_are_those_of_the_averaged_level(
    make: Make, set_value: float, tau: float, mode: int
) -> None:
    """within a hundredth of the ripple; the drive's limits are those of either"""
    value = set_value if mode == 1 else tau / K + 0.1 * np.sign(tau)
    start = {"set_value": value, "drive.mode": mode, "tau": tau, "J_coupled": 2e-5}
    means = []
    for level in (AVERAGED, SWITCHING):
        motor = make("motor_bldc", {**start, "motor.level": level}, tolerance=1e-8)
        motor.step(53_600 // 4 * ESCON)
        means.append(mean_over(motor, ESCON, ["i", "w"], periods=2))
    ripple = V_BUS * 0.25 * ESCON / L
    assert means[1][0] == pytest.approx(means[0][0], abs=0.01 * ripple)
    assert means[1][1] == pytest.approx(means[0][1], abs=0.01 * ripple * R / K)


@pytest.mark.parametrize("e", [0.0, 9.0, -3.0])
def test_current_loops_samples_are_the_mean_not_an_end_of_the_ripple(make: Make, e: float) -> None:
    """the pulse lies in the middle of its period; at its edge the ripple is half of itself away"""
    motor = make("motor_bldc", {**CURRENT_MODE, "set_value": 3.0, **at_speed(e)}, tolerance=1e-9)
    motor.step(400 * ESCON)
    D = (3.0 * R + e) / V_BUS
    i_pp = V_BUS * abs(D) * (1 - abs(D)) * ESCON / L
    sample = motor["i"]
    assert mean_over(motor, ESCON, ["i"]) == pytest.approx([3.0], abs=1e-4)
    assert sample == pytest.approx(3.0, abs=0.01 * i_pp)


@pytest.mark.parametrize("D", [0.5, 0.2, -0.7])
@pytest.mark.parametrize("i", [0.0, 4.0])
def test_ripple_heats_once_and_as_much_as_the_averaged_level_says(make: Make, D: float, i: float) -> None:
    """R i_pp^2/12 of a triangle, for R T/L of 0.046 within a thousandth"""
    start = {"set_value": D * V_BUS, "pwm.T": ESCON, "winding_heating.T": 0.1, **NO_LIMITS, "x_i": i}
    start |= {**at_speed(D * V_BUS - i * R), "winding_heating.R_th": 1.0}
    heat = {}
    for level in (AVERAGED, SWITCHING):
        motor = make("motor_bldc", {**start, "motor.level": level}, tolerance=1e-9)
        motor.step(300 * ESCON)
        before, rise = motor["rise"], 100 * ESCON
        (mean,) = mean_over(motor, ESCON, ["rise"], periods=100, points=4)
        heat[level] = ((motor["rise"] - before) / rise * 0.1 + mean) / 1.0 - R * i**2
    ripple = R * (V_BUS * abs(D) * (1 - abs(D)) * ESCON / L) ** 2 / 12
    assert heat[AVERAGED] == pytest.approx(ripple, rel=1e-4)
    assert heat[SWITCHING] == pytest.approx(ripple, rel=1e-3)


def test_current_that_is_driven_back_through_the_pulses_is_the_exact_one(make: Make) -> None:
    """regenerating: the back-EMF is above the mean voltage, the current negative under positive pulses"""
    D, T = 0.5, 1e-4
    start = {**LEVEL, "pwm.T": T, "set_value": D * V_BUS, **at_speed(13.5)}
    out = make("motor_bldc", start, tolerance=1e-10).run(6e-3, 3.7e-5, ["i", "tau_e", "v"])
    np.testing.assert_allclose(out["i"], [closed_form(t, D, T, 13.5) for t in out["time"]], atol=1e-6)
    late = out["time"] > 4e-3
    assert np.mean(out["i"][late]) == pytest.approx(-1.5 / R, rel=0.02)
    assert np.all(out["v"] >= 0)


def test_bus_capacitor_takes_the_current_of_the_pulses_alone(make: Make) -> None:
    """C dv/dt = -i in the pulse, beside it the winding is short-circuited"""
    C, T, D = 1.0, 1e-4, 0.5
    start = {
        **LEVEL,
        "pwm.T": T,
        "set_value": D * V_BUS,
        **at_speed(13.5),
        "x_i": -1.5 / R,
        "bus.C": C,
        "bus.R_ch": 0.0,
    }
    motor = make("motor_bldc", start, tolerance=1e-9)
    motor.step(0.05 * T)
    assert motor.rate("surge") == 0
    motor.step(0.45 * T)
    assert motor.rate("surge") == pytest.approx(-motor["i"] / C, rel=1e-6)
    motor.step(0.5 * T)
    assert motor.rate("surge") == 0


@pytest.mark.parametrize("i", [6.0, -6.0])
def test_two_switches_conduct_in_the_pulse_and_one_with_a_diode_beside_it(make: Make, i: float) -> None:
    R_on, V_d, T = 0.02, 0.7, 1e-4
    start = {**LEVEL, "pwm.T": T, "set_value": 12.0, **at_speed(12.0), "x_i": i}
    motor = make("motor_bldc", {**start, "mosfet.R_on": R_on, "diode_drop.V_d": V_d}, tolerance=1e-9)
    for share, v in ((0.0, 0.0), (0.3, V_BUS), (0.5, 0.0)):
        motor.step(share * T) if share else None
        now = motor["i"]
        drop = 2 * R_on * now if v else R_on * now + V_d * np.sign(now)
        assert motor["v"] == pytest.approx(v - drop, rel=1e-9)
        assert motor.rate("x_i") == pytest.approx((v - drop - R * now - 12.0) / L, rel=1e-6)


def test_drops_take_from_the_mean_current_what_an_rl_circuit_with_them_says(make: Make) -> None:
    """R i = D v_bus - e - R_on (1 + D) i - V_d (1 - D) over a period, the ripple within the diode's side"""
    R_on, V_d, D, i = 0.02, 0.7, 0.6, 8.0
    e = D * V_BUS - i * (R + R_on * (1 + D)) - V_d * (1 - D)
    start = {**LEVEL, "set_value": D * V_BUS, **at_speed(e), "x_i": i, "mosfet.R_on": R_on, "diode_drop.V_d": V_d}
    motor = make("motor_bldc", start, tolerance=1e-9)
    motor.step(400 * ESCON)
    assert mean_over(motor, ESCON, ["i"]) == pytest.approx([i], rel=1e-3)


def test_reading_of_the_current_is_averaged_by_its_filter(make: Make) -> None:
    start = {**CURRENT_MODE, "set_value": 2.0, **at_speed(10.0)}
    plain, filtered = (make("motor_bldc", {**start, "drive.T_i": T}, tolerance=1e-8) for T in (0.0, 5e-3))
    outs = []
    for motor in (plain, filtered):
        motor.step(0.05)
        outs.append(motor.run(0.0505, 1.7e-6, ["i", "i_reading"]))
    np.testing.assert_array_equal(outs[0]["i"], outs[0]["i_reading"])
    assert np.ptp(outs[0]["i"]) > 1.0
    np.testing.assert_allclose(outs[1]["i_reading"], 2.0, atol=3e-3)


def test_bridge_that_is_off_has_no_pulses_and_counts_periods_anew_when_it_is_on(make: Make) -> None:
    T, D = 1e-4, 0.5
    start = {**LEVEL, "pwm.T": T, "set_value": D * V_BUS, "x_i": 5.0, **at_speed(3.0)}
    motor = make("motor_bldc", start, tolerance=1e-10)
    motor.step(1.3e-4)  # in a pulse
    motor.set({"enable": False})
    off = motor.run(6e-4, 1e-5, ["i", "v"])
    i_0 = closed_form(1.3e-4, D, T, 3.0, 5.0)
    against = [max(0.0, rl(i_0, -V_BUS - 3.0, t - 1.3e-4)) for t in off["time"]]
    np.testing.assert_allclose(off["i"], against, atol=1e-6)
    motor.set({"enable": True})
    begin = motor.time
    on = motor.run(begin + 5e-4, 1.3e-5, ["i"])
    np.testing.assert_allclose(on["i"], [closed_form(t - begin, D, T, 3.0) for t in on["time"]], atol=1e-6)


@pytest.mark.parametrize("start", [{"set_value": 8.0}, {"drive.mode": 2, "set_value": 3.0, "bus.C": 1e-3}])
def test_state_that_is_kept_within_a_period_goes_on_to_the_bit(make: Make, start: dict[str, float]) -> None:
    """as itself and through bytes, in another instance"""
    first, other = (make("motor_bldc", {**LEVEL, "pwm.T": 1e-4, "tau": 0.02, **start}) for _ in range(2))
    first.step(1.234e-3)  # before, in and behind pulses
    for _ in range(5):
        first.step(2.3e-5)
        state = first.fmu.getFMUstate()
        data = first.fmu.serializeFMUstate(state)
        ends, begin = [], first.time
        for slave in (first, first, other):
            if slave is other:
                restored = slave.fmu.deSerializeFMUstate(data)
                slave.fmu.setFMUstate(restored)
                slave.fmu.freeFMUstate(restored)
            else:
                slave.fmu.setFMUstate(state)
            slave.time = begin
            slave.step(5.71e-4)
            ends.append(slave.reals(slave.outputs()))
        first.fmu.setFMUstate(state)
        first.time = begin
        first.fmu.freeFMUstate(state)
        np.testing.assert_array_equal(ends[0], ends[1])
        np.testing.assert_array_equal(ends[0], ends[2])


def test_directional_derivatives_are_those_of_the_circuit_and_hold_the_pulse(make: Make) -> None:
    motor = make("motor_bldc", {**LEVEL, "pwm.T": 1e-4, "set_value": 12.0, "tau": 0.01})
    motor.step(5e-5)
    unknowns = motor.vr("der(x_i)")
    for known, exact in (("x_i", -R / L), ("w", -K / L), ("set_value", 0.0)):
        assert motor.fmu.getDirectionalDerivative(unknowns, motor.vr(known), [1.0]) == pytest.approx([exact], rel=1e-5)
    assert motor.fmu.getDirectionalDerivative(motor.vr("v"), motor.vr("set_value"), [1.0]) == [0.0]


def test_phases_of_the_dc_equivalent_carry_the_ripple(make: Make) -> None:
    motor = make("motor_bldc", {**LEVEL, "set_value": 12.0, "tau": 0.05, "w": 200.0})
    out = motor.run(2e-3, 1.1e-5, ["i", "i_a", "i_b", "i_c"])
    phases = np.array([out[f"i_{x}"] for x in "abc"])
    np.testing.assert_allclose(phases.sum(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(np.abs(phases).max(axis=0), np.abs(out["i"]), rtol=1e-12)


def test_period_below_the_shortest_one_is_that(make: Make) -> None:
    """or a step would not end"""
    outs = [
        make("motor_bldc", {**LEVEL, "pwm.T": T, "set_value": 6.0}).run(1e-4, 1.1e-5, ["i"])["i"] for T in (1e-12, 1e-7)
    ]
    np.testing.assert_array_equal(*outs)
