"""The line through fewer knots has the integral and the edges of what was recorded, and less of its noise."""

from __future__ import annotations

import numpy as np
import pytest

from cobot_joint.diagnosis.plant.knots import on_fewer_knots

T = 1e-3 * np.arange(4001)
SIGMA = 0.02
SLOW = np.sin(2 * np.pi * 0.5 * T)
NOISY = SLOW + np.random.default_rng(1).normal(0, SIGMA, len(T))


def turns(x: np.ndarray) -> float:
    """Share of the samples at which it turns."""
    return float(np.mean(np.abs(np.diff(x, 2)) > 1e-9))


@pytest.mark.parametrize("every", [2, 8, 16])
def test_noise_becomes_a_line_that_turns_at_its_knots_alone(every: int) -> None:
    found = on_fewer_knots(T, NOISY, every)
    assert turns(found) < 1.1 / every
    assert np.std(found - SLOW) < 1.3 * SIGMA / np.sqrt(every)


def test_the_integral_is_that_of_what_was_recorded() -> None:
    """All along, not only at the end: a speed is one."""
    found = on_fewer_knots(T, NOISY, 8)
    apart = np.cumsum(found - NOISY)
    assert np.max(np.abs(apart)) < 4 * SIGMA * np.sqrt(8)
    assert np.max(np.abs(np.cumsum(NOISY - SLOW))) > 4 * SIGMA * np.sqrt(8)  # what is kept is more than what is lost


def test_an_edge_stays_where_it_is() -> None:
    stepped = NOISY + np.where(T > 1.2345, 1.0, 0.0)
    found = on_fewer_knots(T, stepped, 16)
    assert np.max(np.abs(found - stepped)) < 5 * SIGMA


def test_what_has_no_noise_is_left_as_it_is() -> None:
    triangle = np.interp(T, [0, 0.777, 1.5, 4], [0, 1, -1, 0])
    np.testing.assert_allclose(on_fewer_knots(T, triangle, 16), triangle, atol=1e-12)
