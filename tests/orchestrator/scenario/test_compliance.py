"""Impedance control: the joint is the spring and the damper that its loop asks for, but for what the gearhead does."""

from __future__ import annotations

import numpy as np
import pytest

import cobot_joint as cj

K, N, K_T = 20.0, 338 / 3, 0.0232  # N.m/rad at the link, ratio, N.m/A
D = K_T * N**2 * 0.01 * 0.78
J_DRIVE, J_LINK = 5.38e-6 * N**2 + 9.3e-7 * N**2 + 4e-4, 0.01 + 0.2**2  # rotor, gearhead, output shaft; link; kg.m2
FEEDBACK = "position_loop.torque_feedback.K"
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


def step_response(t: np.ndarray, J: float) -> np.ndarray:
    """J phi'' + D phi' + K phi = K, from rest; under- or overdamped."""
    s_1, s_2 = np.roots([J, D, K]).astype(complex)
    return np.real(1 + (s_2 * np.exp(s_1 * t) - s_1 * np.exp(s_2 * t)) / (s_1 - s_2))


@pytest.mark.parametrize("gain", [0.0, 1.0, 3.0, 10.0])
def test_pushed_joint_swings_as_its_spring_and_damper_with_a_drive_as_light_as_the_feedback_makes_it(
    gain: float,
) -> None:
    """J = J_drive/(1 + K) + J_link; shafts and mesh yield by 1/700 of it"""
    time, phi = pushed(4.0, 2.0, {**IDEAL, FEEDBACK: gain})
    wanted = step_response(np.maximum(0, time - 0.1), J_DRIVE / (1 + gain) + J_LINK)
    np.testing.assert_allclose(phi, 4.0 / K * wanted, atol=0.03 * 4.0 / K)
    assert phi[-1] == pytest.approx(4.0 / K, rel=2e-3)


HOLDS = {"motor_bldc.friction.law": "stick", "motor_bldc.friction.tau_C": 2.436e-3}  # N.m; 0.27 N.m at the link


def test_friction_of_the_gearhead_stands_between_the_push_and_the_spring() -> None:
    """0.2 N.m at the link do not move a motor that 0.27 N.m hold there: only the shafts yield"""
    _, ideal = pushed(0.2, 1.5, IDEAL)
    _, real = pushed(0.2, 1.5, {**IDEAL, **HOLDS})
    assert ideal[-1] == pytest.approx(0.2 / K, rel=2e-2)
    assert np.max(np.abs(real)) < 0.1 * 0.2 / K


@pytest.mark.parametrize("gain", [1.0, 3.0, 5.0])
def test_torque_feedback_divides_the_friction_that_holds_the_drive(gain: float) -> None:
    """the spring takes what the push leaves over 0.27 N.m/(1 + K)"""
    _, phi = pushed(0.2, 3.0, {**IDEAL, **HOLDS, FEEDBACK: gain})
    held = 2.436e-3 * N / (1 + gain)
    assert phi[-1] == pytest.approx((0.2 - held) / K, abs=0.02 * 0.2 / K)


def test_with_torque_feedback_the_pushed_link_comes_back_nearer_to_where_it_was() -> None:
    """at 7.8 s it has been let go for 0.8 s and shall be at 0.8 rad"""
    errors = []
    for scenario in ("compliance", "compliance_torque_feedback"):
        result = cj.run(scenario)
        at = np.searchsorted(np.asarray(result.time), 7.8)
        errors.append(abs(float(np.asarray(result["phi_link"])[at]) - 0.8))
    assert errors[1] < 0.5 * errors[0]


def test_link_rests_between_its_wanted_angle_and_the_wall() -> None:
    """wall and joint are equally stiff, so that each yields half of the 0.3 rad between them"""
    result = cj.run("compliance", parameters=IDEAL)
    assert np.asarray(result["phi_link"])[-1] == pytest.approx(1.15, abs=0.005)
