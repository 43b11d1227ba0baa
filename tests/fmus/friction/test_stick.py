"""Friction that holds, against closed forms: rest below its level, break-away at it, and the time until rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

TAU_C, J = 0.02, 1e-4
BODY = {
    "motor_bldc": {"rotor.J": J, "enable": False, "friction.d": 0.0},  # the open bridge: no torque of its own
    "driven_load": {"body.J": J},
}
DRIVES = {"motor_bldc": "tau_add", "driven_load": "tau"}
START = {"motor_bldc": "w", "driven_load": "x_w"}
BOTH = pytest.mark.parametrize("name", BODY)
SIGN = pytest.mark.parametrize("sign", [1, -1])


def stuck(make: Make, name: str, **more: float) -> Any:
    values = {k.replace("__", "."): v for k, v in more.items()}
    return make(name, {**BODY[name], "friction.tau_C": TAU_C, "friction.law": 2, **values}, tolerance=1e-9)


@BOTH
@SIGN
def test_below_its_level_a_shaft_rests_for_ever(make: Make, name: str, sign: int) -> None:
    body = stuck(make, name)
    body.set({DRIVES[name]: sign * 0.999 * TAU_C})
    body.step(1000.0)
    assert (body["w"], body["phi"]) == (0, 0)
    smooth = stuck(make, name, friction__law=1)
    smooth.set({DRIVES[name]: sign * 0.999 * TAU_C})
    smooth.step(10.0)
    assert smooth["phi"] * sign > 0.01


@BOTH
@SIGN
@pytest.mark.parametrize("tau_S", [0.0, 0.01])
def test_it_breaks_away_at_its_static_level(make: Make, name: str, sign: int, tau_S: float) -> None:
    """a ramp of 1 N.m/s; beyond, J dw/dt = what exceeds the Coulomb friction"""
    body = stuck(make, name, stribeck__tau_S=tau_S, stribeck__w_S=1e-3)
    body.set({DRIVES[name]: 0.0})
    body.slope(DRIVES[name], sign * 1.0)
    level = TAU_C + tau_S
    body.step(0.9999 * level)
    assert body["w"] == 0
    body.set({DRIVES[name]: sign * body.time})
    body.slope(DRIVES[name], sign * 1.0)
    body.step(0.01)
    moving = body.time - level
    expected = (moving**2 / 2 + (level - TAU_C) * moving) / J
    assert sign * body["w"] == pytest.approx(expected, rel=2e-2 if tau_S else 1e-5)


@BOTH
@SIGN
def test_it_comes_to_rest_after_j_w_over_tau_c_and_stays(make: Make, name: str, sign: int) -> None:
    w_0 = 40.0
    body = stuck(make, name, **{START[name]: sign * w_0})
    end = J * w_0 / TAU_C
    body.step(end * (1 - 1e-6))
    assert sign * body["w"] == pytest.approx(w_0 * 1e-6, rel=1e-3)
    body.step(end * 2e-6)
    rest = body["phi"]
    assert body["w"] == 0
    assert sign * rest == pytest.approx(w_0 * end / 2, rel=1e-6)
    body.step(100.0)
    assert body["phi"] == rest


def test_viscous_friction_shortens_the_way_to_rest(make: Make) -> None:
    """J dw/dt = -tau_C - d w: t = J/d ln(1 + d w_0/tau_C)"""
    d, w_0 = 1e-3, 40.0
    body = stuck(make, "driven_load", friction__d=d, x_w=w_0)
    end = J / d * np.log(1 + d * w_0 / TAU_C)
    body.step(end * (1 - 1e-6))
    assert body["w"] > 0
    body.step(end * 2e-6)
    assert body["w"] == 0


def test_a_shaft_that_is_pushed_back_harder_than_friction_holds_turns_round(make: Make) -> None:
    """decelerates with tau + tau_C, accelerates with tau - tau_C"""
    tau, w_0 = 3 * TAU_C, 10.0
    body = stuck(make, "driven_load", x_w=w_0)
    body.set({"tau": -tau})
    stop = J * w_0 / (tau + TAU_C)
    body.step(stop + 0.1)
    assert body["w"] == pytest.approx(-(tau - TAU_C) * 0.1 / J, rel=1e-6)


def test_a_pendulum_rests_where_friction_carries_its_weight(make: Make) -> None:
    hangs = {"body.m": 0.1, "body.r": 0.1, "gravity.g": 9.80665}
    level = np.arcsin(TAU_C / (0.1 * 0.1 * 9.80665))
    inside = stuck(make, "driven_load", phi=0.99 * level, **hangs)
    inside.step(100.0)
    assert inside["phi"] == 0.99 * level
    beyond = stuck(make, "driven_load", phi=1.01 * level, **hangs)
    beyond.step(10.0)
    assert beyond["phi"] < level
    assert beyond["w"] == 0


OFF = {"brake.tau_off": 0.0, "brake.d_off": 0.0}


@pytest.mark.parametrize("law", ["smooth", "stick"])
def test_brake_of_10_newton_metres_holds_five_for_ever(make: Make, law: str) -> None:
    """at the pulley: 4.1 (2.5 + 0.08) N.m; by tanh it creeps with 3.6 degrees per second"""
    brake = make("mr_brake_belt", {"brake.law": 1 + (law == "stick"), "tau_m": 2.5, "i_b": 1.0})
    brake.set({"tau_s": 5.0})
    brake.step(5.0)
    before, stretch = brake["phi_b"], 5.0 / 4.1 / 60
    brake.step(100.0)
    if law == "smooth":
        assert brake["phi_b"] - before > np.radians(3.5) * 100 * 4.1
        return
    assert brake["phi_b"] == before == 0
    assert brake["phi_p"] == pytest.approx(stretch / 4.1, rel=1e-6)


def test_brake_lets_go_when_its_torque_has_fallen_to_what_is_applied(make: Make) -> None:
    """tau_m = 2.5 N.m exp(-62 t) meets 5/4.1 N.m"""
    brake = make("mr_brake_belt", {"brake.law": 2, "tau_m": 2.5, "i_b": 1.0, **OFF}, tolerance=1e-8)
    brake.set({"tau_s": 5.0})
    brake.step(5.0)
    brake.set({"i_b": 0.0, "tau_s": 5.0})
    slips = np.log(2.5 / (5.0 / 4.1)) / 62
    brake.step(slips - 1e-5)
    assert brake["w_b"] == 0
    brake.step(1e-4)
    assert brake["w_b"] > 0


@SIGN
def test_hand_holds_the_pulley_up_to_its_capacity(make: Make, sign: int) -> None:
    free = {"belt.r": 0.0, "pulley.J_p": 0.5}  # nothing behind the pulley
    held = make("mr_brake_belt", {"hand.law": 2, "tau_h": 4.0, **free})
    held.set({"tau_s": sign * 3.9})
    held.step(100.0)
    assert (held["w_p"], held["phi_p"]) == (0, 0)
    held.set({"tau_s": sign * 5.0})
    held.step(1.0)
    assert held["w_p"] == pytest.approx(sign * (5.0 - 4.0) / 0.5, rel=1e-6)
    held.set({"tau_h": -3.0, "tau_s": 0.0})  # a hand never drives
    held.step(1.0)
    assert held["w_p"] == pytest.approx(sign * (5.0 - 4.0) / 0.5, rel=1e-6)


def test_in_the_joint_the_motor_rests_on_its_friction_and_starts_again(make: Make) -> None:
    """voltage ramps through k i = tau_C + tau: breaks away there and stops again below"""
    R, k, tau_C = 0.209, 0.0232, 1.2e-3
    motor = make("motor_bldc", {"friction.law": 2}, tolerance=1e-8)
    breaks = tau_C / k * R  # V
    motor.set({"set_value": 0.99 * breaks})
    motor.step(5.0)
    assert (motor["w"], motor["phi"]) == (0, 0)
    motor.set({"set_value": 3 * breaks})
    motor.step(5.0)
    assert motor["w"] == pytest.approx((3 * breaks - R * tau_C / k) / (k + R * 7.5e-6 / k), rel=1e-3)
    motor.set({"set_value": 0.0})
    motor.step(5.0)
    rest = motor["phi"]
    motor.step(5.0)
    assert motor["w"] == 0
    assert motor["phi"] == rest
