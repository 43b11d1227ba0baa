"""Coil and magnetic circuit of the brake: closed forms; off at zero."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

COIL = {"coil.L": 0.2, "coil.R": 8.0}
PLAY = {"remanence.i_h": 0.1, "remanence.T_e": 1e-4}
K_B = 2.5  # N.m/A


def test_coil_on_a_voltage_lags_by_its_inductance_over_its_resistance(make: Make) -> None:
    brake = make("mr_brake_belt", {**COIL, "i_b": 0.5, "coil.omega_i": 0.0})
    out = brake.run(0.1, 1e-3, ["i_coil"])
    np.testing.assert_allclose(out["i_coil"], 0.5 * (1 - np.exp(-out["time"] * 8.0 / 0.2)), atol=2e-5)


def test_current_control_is_faster_by_its_bandwidth(make: Make) -> None:
    brake = make("mr_brake_belt", {**COIL, "i_b": 0.5, "coil.omega_i": 160.0, "coil.v_s": 100.0})
    out = brake.run(0.03, 1e-3, ["i_coil"])
    np.testing.assert_allclose(out["i_coil"], 0.5 * (1 - np.exp(-out["time"] * (160.0 + 40.0))), atol=2e-5)


def test_current_rises_no_faster_than_the_drivers_supply_allows(make: Make) -> None:
    brake = make("mr_brake_belt", {**COIL, "i_b": 2.0, "coil.omega_i": 1e4, "coil.v_s": 24.0})
    out = brake.run(0.04, 1e-3, ["i_coil"])
    rising = out["i_coil"] < 1.98
    np.testing.assert_allclose(out["i_coil"][rising], 3.0 * (1 - np.exp(-out["time"][rising] * 40))[:], atol=1e-4)
    assert rising.sum() > 20
    assert out["i_coil"][-1] == pytest.approx(2.0, rel=1e-3)


def test_coil_heats_the_brake_that_stands(make: Make) -> None:
    brake = make("mr_brake_belt", {**COIL, "x_coil": 0.5, "i_b": 0.5, "brake_fade.T_c": 1e9})
    brake.step(10.0)
    assert brake["E"] == pytest.approx(8.0 * 0.5**2 * 10.0, rel=1e-6)


def settled(brake: Any, *currents: float) -> list[float]:
    """i_m after each current has been held."""
    found = []
    for i in currents:
        brake.set({"i_b": i})
        brake.step(0.5)
        found.append(brake["i_m"])
    return found


def test_field_follows_the_current_with_play(make: Make) -> None:
    """max(i - i_h, min(i + i_h, i_m)), the play operator, over a history of currents"""
    currents, i_m, expected = [0.05, 0.8, 0.7, 0.75, 0.3, 0.35, 0.0, -0.4, 0.0], 0.0, []
    for i in currents:
        i_m = max(i - 0.1, min(i + 0.1, i_m))
        expected.append(i_m)
    assert settled(make("mr_brake_belt", PLAY), *currents) == pytest.approx(expected, abs=1e-5)


def test_torque_stays_once_the_current_is_gone_and_the_opposite_current_removes_it(make: Make) -> None:
    brake = make("mr_brake_belt", PLAY)
    settled(brake, 0.8, 0.0)
    assert brake["tau_m"] == pytest.approx(K_B * 0.1, abs=1e-4)
    settled(brake, -0.1)
    assert brake["tau_m"] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("period", [2.0, 8.0])
def test_loop_of_a_cycle_is_as_large_however_slow_it_is(make: Make, period: float) -> None:
    """current between -1 and 1 A: i_m over i encloses 2 i_h times twice what i_m travels, 4 i_h (1 - i_h)"""
    h = period / 2000
    wave = {"i_b": lambda t: float(np.sin(2 * np.pi * t / period))}
    out = make("mr_brake_belt", PLAY).run(2 * period, h, ["i_coil", "i_m"], wave)
    last = out["time"] > period - h / 2
    area = abs(np.trapezoid(out["i_m"][last], out["i_coil"][last]))
    assert area == pytest.approx(4 * 0.1 * 0.9, rel=5e-3)
