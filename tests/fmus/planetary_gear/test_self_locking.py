"""The gearhead that holds itself, law stick: rest between both sides of eq. 2.26, its torques, no energy made."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

N, ETA, C, B, J_O = 338 / 3, 0.75, 3000.0, np.pi / 180, 4e-4
LOAD = 10.0  # N.m
STICK = {"mesh.law": 2, "friction.tau_C": 0.0, "friction.d": 0.0}
SIGN = pytest.mark.parametrize("sign", [1, -1])


def pressed(make: Make, tau_g: float, **more: float) -> Any:
    """A gear whose input is held where the mesh transmits tau_g to an output that has not moved."""
    values = {k.replace("__", "."): v for k, v in more.items()}
    c = values.get("mesh.c", C)
    start = {"phi": N * (np.sign(tau_g) * B / 2 + tau_g / c), "w": 0.0}
    return make("planetary_gear", {**STICK, **start, **values}, tolerance=1e-9)


@SIGN
@pytest.mark.parametrize("tau_g", [7.51, 9.0, 10.0, 12.0, 13.32])
def test_at_75_percent_a_load_of_10_newton_metres_rests_between_7_5_and_13_3(
    make: Make, sign: int, tau_g: float
) -> None:
    gear = pressed(make, sign * tau_g, tau_s=sign * LOAD)
    gear.step(100.0)
    assert (gear["w_o"], gear["phi_o"]) == (0, 0)
    assert gear["tau"] == pytest.approx(sign * tau_g / N, rel=1e-9)


def test_by_the_smooth_law_the_same_load_runs_away(make: Make) -> None:
    gear = pressed(make, 9.0, tau_s=LOAD, mesh__law=1)
    gear.step(0.01)
    assert abs(gear["phi_o"]) > 1e-4


@SIGN
@pytest.mark.parametrize(("tau_g", "leaves"), [(14.0, 14.0 * ETA - LOAD), (7.0, 7.0 / ETA - LOAD)])
def test_outside_it_gives_way_with_what_eq_2_26_leaves(make: Make, sign: int, tau_g: float, leaves: float) -> None:
    gear = pressed(make, sign * tau_g, tau_s=sign * LOAD)
    assert gear.rate("w_o") == pytest.approx(sign * leaves / J_O, rel=1e-6)


@SIGN
@pytest.mark.parametrize(("direction", "limit"), [(1, LOAD / ETA), (-1, LOAD * ETA)])
def test_a_ramp_of_the_motors_torque_breaks_away_at_the_limit(
    make: Make, sign: int, direction: int, limit: float
) -> None:
    slope = 1.0  # N.m/s
    gear = pressed(make, sign * LOAD, tau_s=sign * LOAD)
    gear.slope("phi", sign * direction * slope * N / C)
    gear.step(abs(limit - LOAD) / slope - 1e-6)
    assert gear["w_o"] == 0
    gear.slope("phi", sign * direction * slope * N / C)
    gear.step(2e-3)
    assert sign * direction * gear["w_o"] > 0


@pytest.mark.parametrize(("w_0", "brakes"), [(0.02, LOAD * (1 - ETA)), (-0.02, LOAD * (1 / ETA - 1))])
def test_the_output_comes_to_rest_after_j_w_over_the_loss_and_stays(make: Make, w_0: float, brakes: float) -> None:
    """without damping, against a spring so soft that tau_g changes by less than 1e-6"""
    J = 10.0
    gear = pressed(make, LOAD, tau_s=LOAD, w_o=w_0, output__J_o=J, mesh__c=1e-2, mesh__d_g=0.0)
    end = J * abs(w_0) / brakes
    gear.step(0.999 * end)
    assert gear["w_o"] / w_0 == pytest.approx(1e-3, rel=0.1)
    gear.step(0.002 * end)
    rest = gear["phi_o"]
    assert gear["w_o"] == 0
    assert rest == pytest.approx(w_0 * end / 2, rel=1e-3)
    gear.step(100.0)
    assert (gear["w_o"], gear["phi_o"]) == (0, rest)


@pytest.mark.parametrize(("w", "over"), [(100.0, 1 / ETA), (-100.0, ETA)])
def test_at_constant_speed_both_laws_take_the_same_torque(make: Make, w: float, over: float) -> None:
    for law in (1, 2):
        gear = pressed(make, 2.0 * over, tau_s=2.0, w=w, w_o=w / N, mesh__law=law)
        gear.slope("phi", w)
        gear.step(1.0)
        assert gear["tau"] == pytest.approx(2.0 / N * over, rel=1e-4)


def test_less_loss_holds_less_and_no_loss_nothing(make: Make) -> None:
    """load_friction.mu < 0 takes from the loss of the mesh"""
    for tau_g, rests in ((LOAD * (1 / ETA - 0.2) - 0.01, True), (LOAD * (1 / ETA - 0.2) + 0.01, False)):
        less = pressed(make, tau_g, tau_s=LOAD, load_friction__mu=-0.2)
        less.step(0.01)
        assert (less["phi_o"] == 0) is rests
    for none in ({"mesh__eta": 1.0}, {"load_friction__mu": -1.0}):
        gear = pressed(make, 10.01, tau_s=LOAD, **none)
        assert gear.rate("w_o") == pytest.approx(0.01 / J_O, rel=1e-6)


def test_in_the_gap_the_output_is_free(make: Make) -> None:
    gear = make("planetary_gear", {**STICK, "mesh.b": 10.0})
    gear.set({"tau_s": -0.001})
    gear.step(0.1)
    assert gear["w_o"] == pytest.approx(0.001 / J_O * 0.1, rel=1e-9)


def test_work_in_is_work_out_stored_and_lost_and_never_less(make: Make) -> None:
    """the motor drives, stops and drives back against a load that pulls: driven, held and driving"""
    gear = make("planetary_gear", {**STICK, "mesh.b": 0.0, "tau_s": 1.0, "output.J_o": 0.01}, tolerance=1e-9)
    lost, held = [], 0
    for k in range(3000):
        w = 50.0 * np.sin(2 * np.pi * k / 1000) if k % 1000 < 800 else 0.0
        gear.set({"w": w})
        gear.slope("phi", w)
        gear.step(1e-3)
        spring = gear["tau_g"] ** 2 / 2 / C
        stored = 0.01 * gear["w_o"] ** 2 / 2 + spring
        lost.append(gear["W_in"] - gear["W_out"] - stored)
        held += gear["w_o"] == 0
    assert held > 100
    assert lost[-1] > 0.1
    assert min(np.diff(lost)) > -1e-3 * lost[-1]
