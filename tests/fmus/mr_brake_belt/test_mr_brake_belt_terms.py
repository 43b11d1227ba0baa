"""Every term of the brake: switched on, it does what its equation says."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

J_P, J_B, R, C_B, D_B = 2e-3, 3e-4, 4.1, 60.0, 0.05
TAU_OFF, D_OFF, W_B0, OMEGA_M = 0.08, 1e-3, 0.5, 62.0
STATE = {"phi_p": 0.7, "w_p": 1.3, "phi_b": 2.9, "w_b": 5.0, "tau_m": 1.1}
ALONE = {"belt.r": 0.0}  # the pulley without its belt


def change(make: Make, state: str, term: dict[str, float], start: dict[str, float] | None = None) -> float:
    """By how much a term changes the derivative of a state."""
    off = make("mr_brake_belt", {**STATE, **(start or {})})
    on = make("mr_brake_belt", {**STATE, **(start or {}), **term})
    return float(on.rate(state) - off.rate(state))


def test_hysteresis_resists_by_what_has_built_up(make: Make) -> None:
    term = {"brake_hysteresis.T": 0.02, "z_h": 0.6}
    assert change(make, "w_b", term) == pytest.approx(-0.02 * 0.6 / J_B, rel=1e-9)


def test_hysteresis_builds_up_with_the_way_travelled_since_reversal(make: Make) -> None:
    start = {"brake_hysteresis.T": 1e-3, "brake_hysteresis.phi_h": 0.4, "tau_s": 2.0}
    brake = make("mr_brake_belt", start, tolerance=1e-8)
    there = brake.run(0.2, 1e-3, ["phi_b", "z_h"])
    np.testing.assert_allclose(there["z_h"], 1 - np.exp(-there["phi_b"] / 0.4), atol=1e-5)
    brake.set({"tau_s": -2.0})
    back = brake.run(0.8, 1e-3, ["phi_b", "w_b", "z_h"])
    turn = int(np.argmax(back["phi_b"]))
    z_turn, way = back["z_h"][turn], back["phi_b"][turn] - back["phi_b"][turn + 5 :]
    np.testing.assert_allclose(back["z_h"][turn + 5 :], (1 + z_turn) * np.exp(-way / 0.4) - 1, atol=1e-3)


def test_release_lag_slows_the_fall_and_not_the_rise(make: Make) -> None:
    brake = make("mr_brake_belt", {"i_b": 0.8, "brake_release_lag.x": 0.7})
    up = brake.run(0.1, 1e-3, ["tau_m"])
    np.testing.assert_allclose(up["tau_m"], 2.0 * (1 - np.exp(-OMEGA_M * up["time"])), atol=2e-5)
    top = brake["tau_m"]
    brake.set({"i_b": 0.0})
    down = brake.run(0.3, 1e-3, ["tau_m"])
    np.testing.assert_allclose(down["tau_m"], top * np.exp(-0.3 * OMEGA_M * (down["time"] - 0.1)), atol=2e-5)


def test_fade_divides_the_fields_torque_by_the_heat(make: Make) -> None:
    lost = 1.1 - 1.1 / (1 + 2e-4 * 3000)
    term = {"brake_fade.x": 2e-4, "E": 3000.0}
    assert change(make, "w_b", term) == pytest.approx(lost * np.tanh(5.0 / W_B0) / J_B, rel=1e-9)


def test_heat_is_the_work_of_the_fields_torque(make: Make) -> None:
    """an immense rotor turns on at 5 rad/s, the field's torque is steady"""
    start = {**STATE, "brake.J_b": 1e3, "i_b": 0.44, "belt.c_b": 1e-6, "belt.d_b": 0.0}
    brake = make("mr_brake_belt", start)
    brake.step(2.0)
    assert brake["E"] == pytest.approx(1.1 * 5.0 * 2.0, rel=2e-3)


def test_eccentricity_ripples_belt_angle_speed_and_torque(make: Make) -> None:
    A, phi_0 = 0.05, 0.4
    ripple = 1 + A * np.cos(0.7 + phi_0)
    stretch = R * (0.7 + A * (np.sin(0.7 + phi_0) - np.sin(phi_0))) - 2.9
    tau_belt = C_B * stretch + D_B * (R * ripple * 1.3 - 5.0)
    brake = make("mr_brake_belt", {**STATE, "pulley_eccentricity.A": A, "pulley_eccentricity.phi_0": phi_0})
    assert brake["tau_belt"] == pytest.approx(tau_belt, rel=1e-9)
    assert brake.rate("w_p") == pytest.approx(-R * ripple * tau_belt / J_P, rel=1e-9)


def test_eccentricity_neither_makes_nor_loses_energy(make: Make) -> None:
    lossless = {"belt.d_b": 0.0, "brake.tau_off": 0.0, "brake.d_off": 0.0}
    start = {"w_p": 20.0, "w_b": 82.0, "pulley_eccentricity.A": 0.1, "pulley_eccentricity.phi_0": 1.0, **lossless}
    out = make("mr_brake_belt", start, tolerance=1e-9).run(0.5, 1e-3, ["w_p", "w_b", "tau_belt"])
    energy = J_P * out["w_p"] ** 2 / 2 + J_B * out["w_b"] ** 2 / 2 + out["tau_belt"] ** 2 / (2 * C_B)
    assert np.ptp(out["tau_belt"]) > 0.5
    np.testing.assert_allclose(energy, energy[0], rtol=1e-5)


def test_imbalance_is_gravity_on_the_pulley(make: Make) -> None:
    term = {"imbalance.G": 0.05, "imbalance.phi_0": 0.3}
    assert change(make, "w_p", term) == pytest.approx(-0.05 * np.sin(0.7 + 0.3) / J_P, rel=1e-9)


def test_imbalance_swings_like_a_pendulum(make: Make) -> None:
    out = make("mr_brake_belt", {"phi_p": 0.01, "imbalance.G": 0.05, **ALONE, "brake.J_b": 1e3}).run(
        2.0, 1e-2, ["phi_p"]
    )
    np.testing.assert_allclose(out["phi_p"], 0.01 * np.cos(np.sqrt(0.05 / J_P) * out["time"]), atol=5e-5)


@pytest.mark.parametrize("w_p", [1.3, -1.3])
def test_position_friction_changes_sign_with_speed_and_size_along_the_turn(make: Make, w_p: float) -> None:
    term = {"position_friction.T": 0.1, "position_friction.n": 2.0, "position_friction.phi_0": 0.5}
    expected = -0.1 * (1 + np.sin(2 * 0.7 + 0.5)) * np.sign(w_p) / J_P
    assert change(make, "w_p", term, {"w_p": w_p}) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("phi_0", np.linspace(0, 6, 7))
@pytest.mark.parametrize("w_p", [1.3, -1.3])
def test_position_friction_with_a_mean_of_its_amplitude_always_resists(make: Make, phi_0: float, w_p: float) -> None:
    term = {"position_friction.T": 0.1, "position_friction.m": 1.0, "position_friction.phi_0": float(phi_0)}
    slowed = change(make, "w_p", term, {"w_p": w_p})
    assert slowed == pytest.approx(-0.1 * (1 + np.sin(0.7 + phi_0)) * np.sign(w_p) / J_P, rel=1e-9, abs=1e-12)
    assert slowed * w_p <= 0


def test_creeping_belt_loses_a_share_of_its_speed_in_proportion_to_its_torque(make: Make) -> None:
    brake = make("mr_brake_belt", {"tau_s": 1.0, "belt_creep.x": 0.1})
    brake.step(30.0)
    tau_belt = 1.0 / R
    assert brake["tau_belt"] == pytest.approx(tau_belt, rel=1e-5)
    assert brake["w_b"] == pytest.approx(R * brake["w_p"] * (1 - 0.1 * tau_belt), rel=1e-5)


def test_belt_under_torque_at_rest_does_not_creep(make: Make) -> None:
    """both ends held by immense inertias that stand still"""
    held = {"pulley.J_p": 1e3, "brake.J_b": 1e3, "brake.tau_off": 0.0}
    out = make("mr_brake_belt", {"phi_p": 0.01, "belt_creep.x": 1.0, **held}).run(0.02, 1e-3, ["tau_belt"])
    np.testing.assert_allclose(out["tau_belt"], C_B * R * 0.01, rtol=2e-3)  # they yield by 1e-5 rad


@pytest.mark.parametrize("h", [1e-3, 0.1])
def test_external_torque_acts_exactly_as_long_as_it_says(make: Make, h: float) -> None:
    term = {"external_torque.T": 0.4, "external_torque.t_0": 0.01234, "external_torque.T_d": 0.05678}
    brake = make("mr_brake_belt", {**term, **ALONE})
    out = brake.run(0.1, h, ["w_p"])
    assert out["w_p"][-1] == pytest.approx(0.4 * 0.05678 / J_P, rel=1e-6)
    if h < 0.01:
        assert out["w_p"][12] == 0
        assert out["w_p"][20] == pytest.approx(0.4 * (0.02 - 0.01234) / J_P, rel=1e-6)


def test_external_torque_can_be_switched_on_while_the_run_goes_on(make: Make) -> None:
    brake = make("mr_brake_belt", {"external_torque.T_d": 10.0, **ALONE})
    brake.step(0.5)
    brake.set({"external_torque.T": 0.1})
    brake.step(0.5)
    assert brake["w_p"] == pytest.approx(0.1 * 0.5 / J_P, rel=1e-6)


def test_heat_that_fades_the_torque_leaves_with_the_cooling(make: Make) -> None:
    brake = make("mr_brake_belt", {"E": 3000.0, "brake_fade.x": 2e-4, "brake_fade.T_c": 50.0})
    brake.step(100.0)
    assert brake["E"] == pytest.approx(3000 * np.exp(-2), rel=1e-4)
