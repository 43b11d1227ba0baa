"""The load alone, against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu

Run = Callable[..., Any]


@pytest.fixture(scope="module")
def run(fmu: Callable[[str], Path]) -> Run:
    """run(stop_time, **start values, dots written as two underscores) -> structured array of all outputs."""
    path = str(fmu("driven_load"))

    def simulate(stop_time: float, **start: Any) -> Any:
        values = {name.replace("__", "."): value for name, value in start.items()}
        return simulate_fmu(path, stop_time=stop_time, output_interval=stop_time / 200, start_values=values)

    return simulate


def test_torque_accelerates_inertia_and_mass_on_lead_and_arm(run: Run) -> None:
    out = run(1.0, tau=0.5, body__J=0.01, body__m=2.0, body__lead=0.1, body__r=0.2)
    J = 0.01 + 2.0 * (0.1**2 + 0.2**2)
    assert out["w"][-1] == pytest.approx(0.5 / J, rel=1e-6)
    assert out["phi"][-1] == pytest.approx(0.5 / J / 2, rel=1e-5)
    assert out["s"][-1] == pytest.approx(0.1 * out["phi"][-1], rel=1e-9)
    assert out["v"][-1] == pytest.approx(0.1 * out["w"][-1], rel=1e-12)


def test_inertia_of_a_log_is_carried_beside_the_body_s(run: Run) -> None:
    out = run(1.0, tau=0.5, body__J=0.01, J_variable=0.03)
    assert out["w"][-1] == pytest.approx(0.5 / 0.04, rel=1e-6)


def test_displacement_counts_from_its_own_start(run: Run) -> None:
    out = run(1.0, s=0.7, phi=2.0, tau=0.5, body__J=0.1, body__lead=0.1)
    np.testing.assert_allclose(out["s"] - 0.7, 0.1 * (out["phi"] - 2.0), atol=1e-9)


def test_force_on_the_mass_acts_through_the_lead(run: Run) -> None:
    by_force = run(1.0, F_add=5.0, body__m=2.0, body__lead=0.1)
    by_torque = run(1.0, tau_add=0.5, body__m=2.0, body__lead=0.1)
    np.testing.assert_allclose(by_force["w"], by_torque["w"], rtol=1e-12)


def test_viscous_friction_gives_an_exponential(run: Run) -> None:
    out = run(2.0, tau=0.3, body__J=0.02, body__m=0.0, friction__d=0.05)
    t = out["time"]
    np.testing.assert_allclose(out["w"], 0.3 / 0.05 * (1 - np.exp(-t * 0.05 / 0.02)), atol=2e-4)


def test_coulomb_friction_holds_below_and_subtracts_above_its_level(run: Run) -> None:
    held = run(1.0, tau=0.1, body__J=0.02, friction__tau_C=0.2, friction__w_C=1e-3)
    assert abs(held["w"][-1]) < 1e-3
    moved = run(1.0, tau=0.3, body__J=0.02, friction__tau_C=0.2, friction__w_C=1e-3)
    assert moved["w"][-1] == pytest.approx((0.3 - 0.2) / 0.02, rel=1e-3)


def test_pendulum_swings_with_its_natural_frequency(run: Run) -> None:
    out = run(2.0, phi=0.01, body__J=0.0, body__m=0.5, body__lead=0.0, body__r=0.1, gravity__g=9.81)
    omega = np.sqrt(9.81 / 0.1)
    np.testing.assert_allclose(out["phi"], 0.01 * np.cos(omega * out["time"]), atol=5e-5)


def test_imbalance_swings_as_the_pendulum_of_its_torque(run: Run) -> None:
    out = run(2.0, phi=0.01 - 0.3, body__J=5e-3, imbalance__G=0.5, imbalance__phi_0=0.3)
    omega = np.sqrt(0.5 / 5e-3)
    np.testing.assert_allclose(out["phi"] + 0.3, 0.01 * np.cos(omega * out["time"]), atol=5e-5)
    np.testing.assert_allclose(out["tau_g"], 0.5 * np.sin(out["phi"] + 0.3), atol=1e-12)


def test_friction_at_rest_holds_what_an_imbalance_pulls(run: Run) -> None:
    held = {"phi": 0.2, "imbalance__G": 0.5, "friction__law": 2}
    assert run(2.0, friction__tau_C=0.1, **held)["phi"][-1] == 0.2  # 0.099 N.m
    assert run(2.0, friction__tau_C=0.09, **held)["phi"][-1] < 0.2


def test_pendulum_hangs_at_its_angle_of_zero_torque(run: Run) -> None:
    out = run(0.01, phi=-0.3, body__m=0.5, body__r=0.1, gravity__g=9.81, gravity__phi_0=0.3)
    np.testing.assert_allclose(out["tau_g"], 0, atol=1e-12)


def test_carriage_slides_down_its_slope(run: Run) -> None:
    out = run(1.0, body__J=0.0, body__m=3.0, body__lead=0.5, gravity__g=9.81, gravity__slope=0.1)
    assert out["v"][-1] == pytest.approx(-9.81 * np.sin(0.1), rel=1e-6)


@pytest.mark.parametrize(("direction", "d"), [(1, 0.06), (-1, 0.04)])
def test_viscous_asymmetry_gives_each_direction_its_own_friction(run: Run, direction: int, d: float) -> None:
    out = run(10.0, tau=0.1 * direction, body__J=0.01, friction__d=0.05, viscous_asymmetry__d_A=0.01)
    assert out["w"][-1] == pytest.approx(direction * 0.1 / d, rel=1e-3)


def test_imposed_motion_follows_its_speed_whatever_the_torques(run: Run) -> None:
    out = run(1.0, motion__source=2, w_imposed=1.5, tau=7.0, friction__d=0.3)
    np.testing.assert_allclose(out["phi"], 1.5 * out["time"], atol=1e-12)
    np.testing.assert_allclose(out["tau_f"], 0.3 * 1.5, rtol=1e-12)


def test_work_taken_at_the_shaft_becomes_kinetic_energy(run: Run) -> None:
    out = run(1.0, tau=0.5, body__J=0.04, body__m=0.0)
    np.testing.assert_allclose(out["W"], 0.04 * out["w"] ** 2 / 2, rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(out["W_abs"], out["W"], rtol=1e-12)
