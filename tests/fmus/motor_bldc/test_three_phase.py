"""The motor's three-phase levels: Kirchhoff, commutation, and agreement with the averaged level."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

AVERAGED, SIMSCAPE, COMPREHENSIVE = 1, 2, 3
R, L, K, J, TAU_C, D, V_BUS = 0.209, 84.3e-6, 0.0232, 5.38e-6, 1.2e-3, 7.5e-6, 24.0
HELD = {"rotor.J": 1e3}


def settled(make: Make, level: int, tau: float, v: float = 12.0, p: int = 1) -> tuple[float, float]:
    """Mean current and speed over whole turns, after settling."""
    start = {"motor.level": level, "set_value": v, "tau": tau, "viscous_dynamic.D": 0.0, "winding.p": p}
    motor = make("motor_bldc", start)
    motor.step(1.0)
    turn = 2 * np.pi / motor["w"]
    out = motor.run(
        1.0 + 20 * turn, 20 * turn / 1201, ["i", "w"]
    )  # 1201 is prime: no point keeps step with the sectors
    return float(np.mean(out["i"][:-1])), float(np.mean(out["w"][:-1]))


@pytest.mark.parametrize(("tau", "p"), [(0.0, 1), (0.03, 1), (0.0765, 1), (0.03, 2)])
def test_steady_means_agree_with_the_averaged_level_within_1_percent(make: Make, tau: float, p: int) -> None:
    i, w = settled(make, SIMSCAPE, tau, p=p)
    i_averaged, w_averaged = settled(make, AVERAGED, tau)
    assert i == pytest.approx(i_averaged, rel=0.01)
    assert w == pytest.approx(w_averaged, rel=0.01)


def test_phase_currents_add_up_to_nothing(make: Make) -> None:
    motor = make("motor_bldc", {"motor.level": SIMSCAPE, "set_value": 12.0, "tau": 0.07})
    out = motor.run(0.3, 3.7e-4, ["i_a", "i_b", "i_c"])
    assert np.ptp(out["i_a"]) > 1
    np.testing.assert_allclose(out["i_a"] + out["i_b"] + out["i_c"], 0, atol=1e-12)


@pytest.mark.parametrize("level", [AVERAGED, SIMSCAPE])
@pytest.mark.parametrize("p", [1, 4])
def test_back_emfs_are_trapezoids_a_third_of_a_turn_apart(make: Make, level: int, p: int) -> None:
    """of an electrical turn, of which there are p to a mechanical one"""
    w = 2 * np.pi
    motor = make("motor_bldc", {"motor.level": level, "winding.p": p, "w": w, "enable": False, **HELD})
    out = motor.run(1.0, 1 / 360, ["e_a", "e_b", "e_c"])
    theta = np.degrees(p * w * out["time"])

    def trapezoid(degrees: np.ndarray) -> np.ndarray:
        """0 at 0, flat at +1 from 30 to 150 degrees, at -1 from 210 to 330"""
        return np.interp(degrees % 360, [0, 30, 150, 210, 330, 360], [0, 1, 1, -1, -1, 0])

    for phase, lag in (("e_a", 0), ("e_b", 120), ("e_c", 240)):
        np.testing.assert_allclose(out[phase], K / 2 * w * trapezoid(theta - lag), atol=1e-5)


def test_stall_current_in_a_sector_is_the_averaged_one(make: Make) -> None:
    start = {"motor.level": SIMSCAPE, "set_value": 0.5, "phi": np.pi / 3, **HELD}
    motor = make("motor_bldc", start, tolerance=1e-8)
    out = motor.run(3e-3, 1e-4, ["i_a", "i_b", "i_c"])
    expected = 0.5 / R * (1 - np.exp(-R / L * out["time"]))
    np.testing.assert_allclose(out["i_a"], expected, atol=1e-4)  # A+ B-, 30 to 90 degrees
    np.testing.assert_allclose(out["i_b"], -expected, atol=1e-4)
    assert np.all(out["i_c"] == 0)


@pytest.mark.parametrize(
    ("degrees", "high", "low"),
    [(60, "a", "b"), (120, "a", "c"), (180, "b", "c"), (240, "b", "a"), (300, "c", "a"), (0, "c", "b")],
)
def test_each_sector_drives_its_pair_forwards(make: Make, degrees: float, high: str, low: str) -> None:
    """Table 2.2 with its zero moved by 30 degrees"""
    start = {"motor.level": SIMSCAPE, "set_value": 0.5, "phi": np.radians(degrees), **HELD}
    motor = make("motor_bldc", start)
    motor.step(0.01)
    assert motor[f"i_{high}"] == pytest.approx(0.5 / R, rel=1e-3)
    assert motor[f"i_{low}"] == pytest.approx(-0.5 / R, rel=1e-3)
    assert motor["tau_e"] == pytest.approx(K * 0.5 / R, rel=1e-3)


def test_negative_voltage_swaps_the_legs(make: Make) -> None:
    start = {"motor.level": SIMSCAPE, "set_value": -0.5, "phi": np.pi / 3, **HELD}
    motor = make("motor_bldc", start)
    motor.step(0.01)
    assert motor["i_a"] == pytest.approx(-0.5 / R, rel=1e-3)
    assert motor["i"] == pytest.approx(-0.5 / R, rel=1e-3)
    assert motor["tau_e"] == pytest.approx(-K * 0.5 / R, rel=1e-3)


def test_current_of_the_opening_phase_freewheels_to_zero(make: Make) -> None:
    """A+ B- to A+ C- at 90 degrees: i_b rises from -i_0 to 0 on the diode to the supply"""
    w = 100.0
    start = {"motor.level": SIMSCAPE, "set_value": 3.0, "w": w, "phi": np.radians(60), **HELD}
    motor = make("motor_bldc", start)
    out = motor.run(np.radians(60) / w, 2e-6, ["i_a", "i_b", "i_c"])
    t_c = np.radians(30) / w
    i_0 = -out["i_b"][out["time"] < t_c][-1]
    after = out["time"] > t_c + 1e-3
    assert np.all(out["i_b"][after] == 0)
    falling = (out["time"] > t_c) & (out["i_b"] < 0)
    # phase B on +v_bus/2: (u_a + u_b + u_c)/3 with u_a = -u_c = v/2, e_a = -e_c = K w/2, e_b from 1 to -1 through 0
    slope = (V_BUS / 2 - V_BUS / 6 + K * w / 2 / 3 - K * w / 2 * -1) / (L / 2)
    first = np.flatnonzero(falling)[:3]
    measured = (out["i_b"][first[2]] - out["i_b"][first[0]]) / (out["time"][first[2]] - out["time"][first[0]])
    assert i_0 > 1
    assert measured == pytest.approx(slope, rel=0.15)


def test_speed_does_not_depend_on_the_communication_step(make: Make) -> None:
    ends = []
    for h in (1e-2, 1e-3):
        motor = make("motor_bldc", {"motor.level": SIMSCAPE, "set_value": 8.0, "tau": 0.02}, tolerance=1e-8)
        motor.run(0.2, h)
        ends.append((motor["w"], motor["phi"]))
    assert ends[0] == pytest.approx(ends[1], rel=1e-6)


def test_comprehensive_level_has_more_viscous_friction_at_low_speed(make: Make) -> None:
    """d(w) = d (1 + D exp(-|w|/w_D)), its form assumed"""
    for w in (10.0, 500.0):
        rates = [
            make("motor_bldc", {"motor.level": level, "w": w, "enable": False}).rate("w")
            for level in (SIMSCAPE, COMPREHENSIVE)
        ]
        expected = -D * w * 0.3 * np.exp(-w / 150) / J
        assert rates[1] - rates[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("level", [AVERAGED, SIMSCAPE])
@pytest.mark.parametrize("p", [1, 3])
def test_hall_sensors_change_six_times_per_electrical_turn(make: Make, level: int, p: int) -> None:
    start = {"motor.level": level, "winding.p": p, "w": 2 * np.pi, "enable": False, "phi": 0.01, **HELD}
    hall = make("motor_bldc", start).run(1.0, 1e-3, ["hall"])["hall"]
    assert np.count_nonzero(np.diff(hall)) == 6 * p


@pytest.mark.parametrize("read", ["hall", "e_a"])
def test_phases_follow_an_angle_that_is_set_again_during_the_initialization(instantiate: Make, read: str) -> None:
    motor = instantiate("motor_bldc")
    motor.fmu.setupExperiment()
    motor.fmu.enterInitializationMode()
    for phi in (0.0, 2.0, 4.0):
        motor.set({"motor.level": SIMSCAPE, "w": 100.0, "phi": phi})
        seen = motor[read]
        assert seen == make_fresh(instantiate, phi)[read]


def make_fresh(instantiate: Make, phi: float) -> Any:
    return instantiate("motor_bldc").initialise({"motor.level": SIMSCAPE, "w": 100.0, "phi": phi})
