"""The harmonic drive alone, against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

N, K_1, K_2, K_3, T_1, T_2, MU = -100.0, 1.6e4, 2.5e4, 2.9e4, 7.0, 25.0, 0.25
PLAIN = {"friction.tau_C": 0.0, "friction.d": 0.0, "load_friction.mu": 0.0}
HELD = {"output.J_o": 1e6}  # an immense inertia holds the output


def wound_up(delta: float, w: float = 0.0, **more: float) -> dict[str, float]:
    """The flex spline wound up by delta; the output follows the input, so that nothing is damped."""
    return {"phi": N * delta, "w": w, "w_o": w / N, **HELD, **PLAIN, **more}


@pytest.mark.parametrize(("output", "ratio"), [(1, -80.0), (2, 81.0)])
def test_teeth_give_the_ratio_of_eq_2_28_and_of_the_circular_spline(make: Make, output: int, ratio: float) -> None:
    teeth = {"ratio.from": 2, "ratio.z_f": 160, "ratio.output": output}
    gear = make("harmonic_drive", {"w": 200.0, "w_o": 200.0 / ratio, "tau_s": 1.0, **teeth})
    gear.slope("phi", 200.0)
    gear.step(1.0)
    assert gear["w_o"] == pytest.approx(200 / ratio, rel=1e-6)
    assert gear["tau_g"] == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize(
    ("torque", "delta"),
    [(3.0, 3 / K_1), (15.0, 7 / K_1 + 8 / K_2), (-40.0, -(7 / K_1 + 18 / K_2 + 15 / K_3))],
)
def test_stiffness_has_three_slopes_in_both_directions(make: Make, torque: float, delta: float) -> None:
    gear = make("harmonic_drive", wound_up(delta))
    assert gear["delta"] == pytest.approx(delta, rel=1e-9)
    assert gear["tau_g"] == pytest.approx(torque, rel=1e-9)


def test_the_motor_feels_eq_2_31(make: Make) -> None:
    """T_l = K_el (q_m - i_G q_l) + D_el (dq_m - i_G dq_l), with K_el = K/i_G^2"""
    q_m, q_l, dq_m, dq_l, d_g = 0.03, 1e-4, 4.0, 0.02, 2.0
    gear = make("harmonic_drive", {"phi": q_m, "phi_o": q_l, "w": dq_m, "w_o": dq_l, **HELD, **PLAIN})
    T_l = K_1 / N**2 * (q_m - N * q_l) + d_g / N**2 * (dq_m - N * dq_l)
    assert gear["tau"] == pytest.approx(T_l, rel=1e-9)


@pytest.mark.parametrize(("torque", "w"), [(5.0, -300.0), (-5.0, 300.0), (5.0, 300.0), (-5.0, -300.0)])
def test_loss_grows_with_the_transmitted_torque_in_both_directions_of_power(
    make: Make, torque: float, w: float
) -> None:
    gear = make("harmonic_drive", wound_up(torque / K_1, w) | {"load_friction.mu": MU})
    assert gear["tau"] == pytest.approx(torque / N + MU * abs(torque / N) * np.sign(w), rel=1e-9)
    assert gear["tau"] * w > torque * w / N


def test_output_swings_on_the_flex_spline_with_its_natural_frequency(make: Make) -> None:
    gear = make("harmonic_drive", {"phi_o": 1e-4, "output.J_o": 0.4, "flex_spline.d_g": 0.0, **PLAIN}, tolerance=1e-9)
    run = gear.run(0.1, 1e-3, ["phi_o"])
    np.testing.assert_allclose(run["phi_o"], 1e-4 * np.cos(np.sqrt(K_1 / 0.4) * run["time"]), atol=1e-7)


@pytest.mark.parametrize("phi", [0.0, 0.4, 1.3, 4.0])
def test_kinematic_error_comes_twice_per_turn_and_does_no_work(make: Make, phi: float) -> None:
    A, phi_0, w = 2e-4, 0.3, 50.0
    error, slope = A * np.sin(2 * phi + phi_0), 2 * A * np.cos(2 * phi + phi_0)
    rest = {"phi": phi, "phi_o": phi / N, "w": w, "w_o": w * (1 / N + slope), **HELD, **PLAIN}
    gear = make("harmonic_drive", rest | {"kinematic_error.A": A, "kinematic_error.phi_0": phi_0})
    assert gear["delta"] == pytest.approx(error, abs=1e-15)
    assert gear["tau_g"] == pytest.approx(K_1 * error, rel=1e-9)  # the rate of the wind-up is zero: nothing is damped
    assert gear["tau"] * w == pytest.approx(gear["tau_g"] * gear["w_o"], rel=1e-9, abs=1e-12)


def test_hysteresis_takes_the_area_of_its_loop(make: Make) -> None:
    """Dahl's loop between +-a: 4 T_h (a - phi_h) where a is many phi_h; the spring gives back what it takes."""
    T_h, phi_h, a, period = 2.0, 2e-5, 1e-3, 0.05
    start = {**HELD, **PLAIN, "flex_spline.d_g": 0.0, "hysteresis.T_h": T_h, "hysteresis.phi_h": phi_h}
    gear = make("harmonic_drive", start, tolerance=1e-9)

    def phi(t: float) -> float:
        return N * a * np.sin(2 * np.pi * t / period)

    def w(t: float) -> float:
        return N * a * 2 * np.pi / period * np.cos(2 * np.pi * t / period)

    run = gear.run(2.25 * period, 1e-4 * period, ["W_in"], {"phi": phi, "w": w})
    first, second = run["W_in"][12500], run["W_in"][22500]  # at the same turning point
    assert second - first == pytest.approx(4 * T_h * (a - phi_h), rel=2e-3)


@pytest.mark.parametrize(("ratio", "left"), [(-100.0, 0.0), (-2000.0, None)])
def test_teeth_jump_at_the_ratcheting_torque_by_one_tooth_or_the_whole_wind_up(
    make: Make, ratio: float, left: float | None
) -> None:
    limit = 50.0
    most = T_1 / K_1 + (T_2 - T_1) / K_2 + (limit - T_2) / K_3
    start = {"phi": ratio * 0.999 * most, **HELD, **PLAIN, "ratio.N": ratio, "ratcheting.x": 1 / limit}
    gear = make("harmonic_drive", start)
    assert gear["delta"] == pytest.approx(0.999 * most)
    gear.set({"phi": ratio * 0.999 * most})
    gear.slope("phi", ratio * 0.002 * most / 1e-3)
    gear.step(1e-3)  # crosses the limit half-way
    tooth = np.pi / abs(ratio)
    expected = 0.001 * most + (most - tooth if left is None else left)
    assert gear["delta"] == pytest.approx(expected, rel=1e-3)


def test_without_a_ratcheting_torque_teeth_hold(make: Make) -> None:
    gear = make("harmonic_drive", wound_up(0.05))
    gear.step(1e-3)
    assert gear["delta"] == pytest.approx(0.05, rel=1e-6)
