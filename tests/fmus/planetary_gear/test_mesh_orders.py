"""Angle errors of each stage's tooth mesh: orders from tooth counts, virtual work; off at zero."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

C = 3000.0
CALM = {"mesh.b": 0.0, "mesh.d_g": 0.0, "friction.tau_C": 0.0, "friction.d": 0.0, "mesh.eta": 1.0}
MEMBERS = {  # which turns: sun, ring, carrier, as (in, out, held)
    "sun_in_carrier_out": ("s", "c", "r"),
    "ring_in_carrier_out": ("r", "c", "s"),
    "sun_in_ring_out": ("s", "r", "c"),
    "ring_in_sun_out": ("r", "s", "c"),
    "carrier_in_ring_out": ("c", "r", "s"),
    "carrier_in_sun_out": ("c", "s", "r"),
}


def error(make: Make, phi_o: float, start: dict[str, float]) -> float:
    """Angle error at an output angle: the twist with the part less the twist without."""
    off = {key: value for key, value in start.items() if not key.startswith("mesh_error")}
    return float(make("planetary_gear", {"phi_o": phi_o, **start})["delta"]
                 - make("planetary_gear", {"phi_o": phi_o, **off})["delta"])  # fmt: skip


@pytest.mark.parametrize(("stage", "order"), [(1, 60 * 6 * 13 / 3), (2, 60 * 6), (3, 60)])
def test_stages_of_the_gearhead_mesh_as_often_as_their_rings_have_teeth_per_turn_of_their_carriers(
    make: Make, stage: int, order: float
) -> None:
    A, phi_0 = 1e-4, 0.3
    for phi_o in (0.0, 0.011, 1.7):
        found = error(make, phi_o, {f"mesh_error_{stage}.A": A, f"mesh_error_{stage}.phi_0": phi_0})
        assert found == pytest.approx(A * np.sin(order * phi_o + phi_0), abs=1e-12)


@pytest.mark.parametrize("members", MEMBERS)
def test_order_is_the_sun_s_teeth_times_its_turns_against_the_carrier(make: Make, members: str) -> None:
    """Willis: w_s z_s + w_r z_r = w_c (z_s + z_r), one member held, per turn of the output"""
    z_s, z_r = 20, 70
    _, output, held = MEMBERS[members]
    rows = {"s": [1, 0, 0], "r": [0, 1, 0], "c": [0, 0, 1]}
    w_s, _, w_c = np.linalg.solve([[z_s, z_r, -(z_s + z_r)], rows[held], rows[output]], [0, 0, 1])
    order, phi_o, A = abs(z_s * (w_s - w_c)), 0.37, 1e-4
    start = {"ratio.stages": 1, "ratio.z_s_1": z_s, "ratio.z_r_1": z_r, "mesh_error_1.A": A}
    start["ratio.member_1"] = [*MEMBERS].index(members) + 1
    assert error(make, phi_o, start) == pytest.approx(A * np.sin(order * phi_o), abs=1e-12)


def test_stage_that_is_not_there_does_not_mesh(make: Make) -> None:
    start = {"ratio.stages": 2, "mesh_error_3.A": 1e-3, "mesh_error_3.phi_0": 0.0}
    assert error(make, 0.37, start) == 0.0


def test_teeth_neither_make_nor_lose_energy(make: Make) -> None:
    """the output turns against an ideal mesh whose input stands: spring and inertia exchange what there is"""
    start = {"mesh_error_2.A": 1e-4, "mesh_error_3.A": 5e-4, "w_o": 0.5, "output.J_o": 0.1, **CALM}
    out = make("planetary_gear", start, tolerance=1e-9).run(0.05, 1e-4, ["w_o", "tau_g"])
    energy = 0.1 * out["w_o"] ** 2 / 2 + out["tau_g"] ** 2 / (2 * C)
    assert np.ptp(out["tau_g"]) > 1
    np.testing.assert_allclose(energy, energy[0], rtol=1e-4)
