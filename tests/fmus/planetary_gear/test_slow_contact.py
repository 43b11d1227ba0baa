"""Flanks that part slowly at a large angle: the event lies within a rounding of the angle, and still comes at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

N, B = 338 / 3, np.pi / 180


@pytest.mark.parametrize("seed", range(30))
def test_flanks_part_though_the_angle_is_too_coarse_to_show_it(make: Make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    phi_o, w_o, wind_up = 50 + 10 * rng.random(), 10 ** rng.uniform(-5, -2), 10 ** rng.uniform(-12, -8)
    start = {"phi_o": phi_o, "w_o": w_o, "phi": N * (phi_o + B / 2 + wind_up), "tau_s": -2.4e-4}
    gear = make("planetary_gear", start)
    for _ in range(20):
        gear.step(1e-4)  # fails after five million steps of its own if the event is always about to come
    assert gear["delta"] < B / 2
    assert gear["tau_g"] == 0.0
