"""Impedance control: the joint is the spring and the damper that its loop asks for, but for what the gearhead does."""

from __future__ import annotations

import numpy as np
import pytest

import cobot_joint as cj

K, N, K_T = 20.0, 338 / 3, 0.0232  # N.m/rad at the link, ratio, N.m/A
D = K_T * N**2 * 0.01 * 0.78
J = 5.38e-6 * N**2 + 9.3e-7 * N**2 + 4e-4 + 0.01 + 0.2**2  # rotor and gearhead at the output, output shaft, link
IDEAL = {
    "planetary_gear.mesh.b": 0.0, "planetary_gear.mesh.eta": 1.0, "planetary_gear.friction.tau_C": 0.0,
    "planetary_gear.friction.d": 0.0, "motor_bldc.friction.tau_C": 0.0, "motor_bldc.friction.d": 0.0,
    "link.friction.tau_C": 0.0, "link.friction.d": 0.0, "motor_bldc.drive.w_max": 0.0,
}  # fmt: skip


def pushed(tau: float, stop_time: float, parameters: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Time and the link's angle, after a torque that sets in at 0.1 s."""
    inputs = cj.Inputs(np.array([0.0, 0.1, 0.1001]), {"tau_push": np.array([0.0, 0.0, tau])})
    result = cj.run("joint_compliant", cj.Experiment(inputs, stop_time), parameters=parameters)
    return np.asarray(result.time), np.asarray(result["phi_link"])


def test_pushed_joint_swings_as_the_spring_and_damper_that_are_asked_for() -> None:
    """J phi'' + D phi' + K phi = tau; shafts and mesh yield by K/700 of it"""
    time, phi = pushed(4.0, 2.0, IDEAL)
    omega, zeta = np.sqrt(K / J), D / (2 * np.sqrt(K * J))
    t, damped = np.maximum(0, time - 0.1), omega * np.sqrt(1 - zeta**2)
    decay = np.exp(-zeta * omega * t)
    step = 1 - decay * (np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t))
    np.testing.assert_allclose(phi, 4.0 / K * step, atol=0.06 * 4.0 / K)
    assert phi[-1] == pytest.approx(4.0 / K, rel=2e-3)


def test_friction_of_the_gearhead_stands_between_the_push_and_the_spring() -> None:
    """0.2 N.m at the link do not move a motor that 2.436 mN.m hold, 0.27 N.m there: only the shafts yield"""
    holds = {"motor_bldc.friction.law": "stick", "motor_bldc.friction.tau_C": 2.436e-3}
    _, ideal = pushed(0.2, 1.5, IDEAL)
    _, real = pushed(0.2, 1.5, {**IDEAL, **holds})
    assert ideal[-1] == pytest.approx(0.2 / K, rel=2e-2)
    assert np.max(np.abs(real)) < 0.1 * 0.2 / K


def test_link_rests_between_its_wanted_angle_and_the_wall() -> None:
    """wall and joint are equally stiff, so that each yields half of the 0.3 rad between them"""
    result = cj.run("compliance", parameters=IDEAL)
    assert np.asarray(result["phi_link"])[-1] == pytest.approx(1.15, abs=0.005)
