"""The cycloidal drive alone, against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

Make = Callable[..., Any]

N, K_1, K_2, T_1, MU = -59.0, 1.2e4, 4e4, 3.0, 0.15
PLAIN = {"friction.tau_C": 0.0, "friction.d": 0.0, "load_friction.mu": 0.0}
HELD = {"output.J_o": 1e6}  # an immense inertia holds the output


@pytest.mark.parametrize(("P", "L"), [(60, 59), (12, 11), (24, 22)])
def test_pins_and_lobes_give_the_ratio_of_eq_2_32(make: Make, P: int, L: int) -> None:
    """output over input (P - L)/L, against the eccentric"""
    w_o = -200.0 * (P - L) / L
    gear = make("cycloidal_drive", {"w": 200.0, "w_o": w_o, "tau_s": 1.0, "ratio.from": 2, "ratio.P": P, "ratio.L": L})
    gear.slope("phi", 200.0)
    gear.step(1.0)
    assert gear["w_o"] == pytest.approx(w_o, rel=1e-6)
    assert gear["tau_g"] == pytest.approx(1.0, rel=1e-4)


def test_a_disc_with_as_many_lobes_as_there_are_pins_is_refused(make: Make) -> None:
    with pytest.raises(FMICallException):
        make("cycloidal_drive", {"ratio.from": 2, "ratio.P": 10, "ratio.L": 10})


@pytest.mark.parametrize(("torque", "delta"), [(2.0, 2 / K_1), (-20.0, -(T_1 / K_1 + 17 / K_2))])
def test_stiffness_is_soft_at_first_in_both_directions(make: Make, torque: float, delta: float) -> None:
    gear = make("cycloidal_drive", {"phi": N * delta, **HELD, **PLAIN})
    assert gear["delta"] == pytest.approx(delta, rel=1e-9)
    assert gear["tau_g"] == pytest.approx(torque, rel=1e-9)


@pytest.mark.parametrize(("torque", "w"), [(2.0, -300.0), (-2.0, 300.0), (2.0, 300.0), (-2.0, -300.0)])
def test_loss_grows_with_the_transmitted_torque_in_both_directions_of_power(
    make: Make, torque: float, w: float
) -> None:
    start = {"phi": N * torque / K_1, "w": w, "w_o": w / N, **HELD, **PLAIN, "load_friction.mu": MU}
    gear = make("cycloidal_drive", start)
    assert gear["tau"] == pytest.approx(torque / N + MU * abs(torque / N) * np.sign(w), rel=1e-9)


def test_output_swings_on_pins_and_lobes_with_its_natural_frequency(make: Make) -> None:
    start = {"phi_o": 1e-4, "output.J_o": 0.4, "mesh.d_g": 0.0, **PLAIN}
    run = make("cycloidal_drive", start, tolerance=1e-9).run(0.1, 1e-3, ["phi_o"])
    np.testing.assert_allclose(run["phi_o"], 1e-4 * np.cos(np.sqrt(K_1 / 0.4) * run["time"]), atol=1e-7)


@pytest.mark.parametrize("phi", [0.0, 0.4, 1.3])
def test_angle_error_does_no_work(make: Make, phi: float) -> None:
    A, n, phi_0, w = 2e-4, 2.0, 0.3, 50.0
    slope = A * n * np.cos(n * phi + phi_0)
    rest = {"phi": phi, "phi_o": phi / N, "w": w, "w_o": w * (1 / N + slope), **HELD, **PLAIN}
    term = {"angle_error.A": A, "angle_error.n": n, "angle_error.phi_0": phi_0}
    gear = make("cycloidal_drive", rest | term)
    assert gear["delta"] == pytest.approx(A * np.sin(n * phi + phi_0), abs=1e-15)
    assert gear["tau"] * w == pytest.approx(gear["tau_g"] * gear["w_o"], rel=1e-9, abs=1e-12)
