"""The link alone, against closed forms, and in the place of belt and brake."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cobot_joint.scenario.model import load_scenario
from cobot_joint.scenario.options import Options
from cobot_joint.scenario.run import run_scenario
from cobot_joint.units import find_fmu

Make = Callable[..., Any]

M, R, G, J_L = 1.0, 0.2, 9.80665, 0.01
J = J_L + M * R**2
FREE = {"friction.tau_C": 0.0, "friction.d": 0.0}


def test_small_swings_have_the_period_of_the_physical_pendulum(make: Make) -> None:
    run = make("link", {"phi_p": 1e-3, **FREE}, tolerance=1e-9).run(3.0, 1e-2, ["phi_p"])
    np.testing.assert_allclose(run["phi_p"], 1e-3 * np.cos(np.sqrt(M * G * R / J) * run["time"]), atol=1e-6)


def test_imbalance_is_the_gravity_of_what_else_hangs_there(make: Make) -> None:
    phi, phi_0 = 0.4, 0.3
    arm = make("link", {"phi_p": phi, "imbalance.G": 0.8, "imbalance.phi_0": phi_0, **FREE})
    assert arm["tau_g"] == pytest.approx(M * G * R * np.sin(phi) + 0.8 * np.sin(phi + phi_0), rel=1e-12)
    upright = {"phi_p": 1e-3 - phi_0, "arm.g": 0.0, "imbalance.G": 0.8, "imbalance.phi_0": phi_0, **FREE}
    run = make("link", upright, tolerance=1e-9).run(3.0, 1e-2, ["phi_p"])
    np.testing.assert_allclose(run["phi_p"] + phi_0, 1e-3 * np.cos(np.sqrt(0.8 / J) * run["time"]), atol=1e-6)


@pytest.mark.parametrize("phi", [-1.0, 0.5, 2.0])
def test_gravity_is_carried_by_its_torque(make: Make, phi: float) -> None:
    arm = make("link", {"phi_p": phi, **FREE})
    assert arm["tau_g"] == pytest.approx(M * G * R * np.sin(phi), rel=1e-12)
    arm.set({"tau_s": arm["tau_g"]})
    arm.step(0.1)
    assert arm["phi_p"] == pytest.approx(phi, rel=1e-9)


def test_inertia_is_steiners(make: Make) -> None:
    arm = make("link", {"arm.g": 0.0, **FREE})
    arm.set({"tau_s": 0.3})
    arm.step(0.5)
    assert arm["w_p"] == pytest.approx(0.3 * 0.5 / J, rel=1e-6)


def test_the_wall_gives_back_what_hunt_and_crossley_say(make: Make) -> None:
    """elastic for a = 0; with a, F(x) = x - ln(1 + x) of x = a w is the same before and behind the impact"""
    wall = {"arm.g": 0.0, "wall.k": 2000.0, "wall.phi_c": 0.0, **FREE}
    elastic = make("link", {"w_p": 2.0, "wall.a": 0.0, **wall}, tolerance=1e-9)
    elastic.step(0.5)
    assert elastic["w_p"] == pytest.approx(-2.0, rel=1e-6)
    a, w = 0.2, 2.0
    lossy = make("link", {"w_p": w, "wall.a": a, **wall}, tolerance=1e-9)
    lossy.step(0.5)
    u = -lossy["w_p"] * a
    assert 0 < u < a * w
    assert -u - np.log(1 - u) == pytest.approx(a * w - np.log(1 + a * w), rel=1e-5)


def test_the_hand_resists_and_never_drives(make: Make) -> None:
    held = make("link", {"tau_h": 2.0, "arm.g": 0.0, **FREE})
    held.step(1.0)
    assert (held["w_p"], held["phi_p"]) == (0, 0)
    held.set({"tau_s": 3.0})
    held.step(1.0)
    assert held["w_p"] == pytest.approx((3.0 - 2.0) / J, rel=5e-3)


@pytest.mark.parametrize("law", [1, 2])
def test_it_stays_where_it_is_put_only_with_friction_that_holds(make: Make, law: int) -> None:
    arm = make("link", {"phi_p": 0.02, "friction.tau_C": 0.1, "friction.law": law})
    arm.step(60.0)
    assert (arm["phi_p"] == 0.02) == (law == 2)


def test_it_takes_the_place_of_belt_and_brake_in_the_joint(tmp_path: Path) -> None:
    swap = Options(units={"mr_brake_belt": f"{find_fmu('link.fmu')}:i_b=,w_b=,tau_belt="})
    report = run_scenario(load_scenario("load_hand", {"stop_time": "5"}), tmp_path, swap)
    signals = {row[0]: row[1:] for row in report.tables[0].rows}
    low, high = signals["tau_sensor [N.m]"][:2]
    assert low < -M * G * R  # the arm pulls on its way down, the teeth meet
    assert high > M * G * R  # and is lifted through the horizontal
    assert signals["phi_pulley [rad]"][1] > np.pi
    residuals = [value for name, value in report.values.items() if name.startswith("energy residual")]
    assert len(residuals) == 3
    assert max(residuals) < 1e-4
