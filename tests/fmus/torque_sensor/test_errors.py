"""Nonlinearity, crosstalk and drift of the reading: closed forms; off at zero."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

C_S, RATED = 955.0, 10.0


@pytest.mark.parametrize("tau", [-10.0, -4.0, 6.0, 10.0])
@pytest.mark.parametrize(("part", "power"), [("quadratic", 2), ("cubic", 3)])
def test_nonlinearity_is_its_share_of_rated_torque_at_rated_torque(
    make: Make, tau: float, part: str, power: int
) -> None:
    sensor = make("torque_sensor", {"phi_o": tau / C_S, f"{part}.a": 2e-3})
    assert sensor["tau_reading"] - tau == pytest.approx(2e-3 * RATED * (tau / RATED) ** power, rel=1e-9)
    assert sensor["tau_s"] == pytest.approx(tau, rel=1e-12)


@pytest.mark.parametrize("phi_p", [0.0, 0.9, 4.0])
def test_bending_that_grows_with_the_torque_is_read_once_per_turn(make: Make, phi_p: float) -> None:
    sensor = make("torque_sensor", {"phi_p": phi_p, "phi_o": phi_p + 5 / C_S, "crosstalk.x": 0.01})
    assert sensor["tau_reading"] == pytest.approx(5 * (1 + 0.01 * np.cos(phi_p)), rel=1e-9)


def test_zero_and_span_drift_with_the_sensor_that_warms_up(make: Make) -> None:
    term = {"warming.dT": 20.0, "warming.T_c": 0.5, "zero_drift.z": 1e-3, "span_drift.s": -2e-4}
    out = make("torque_sensor", {"phi_o": 5 / C_S, **term}).run(1.0, 0.05, ["tau_reading"])
    DT = 20 * (1 - np.exp(-out["time"] / 0.5))
    np.testing.assert_allclose(out["tau_reading"], (1 - 2e-4 * DT) * 5 + 1e-3 * DT, rtol=1e-12)


def test_amplifier_filters_what_the_strain_gauges_show(make: Make) -> None:
    out = make("torque_sensor", {"phi_o": 8 / C_S, "cubic.a": 0.01, "low_pass.T": 0.02}).run(0.1, 0.01, ["tau_reading"])
    shown = 8 + 0.01 * 8**3 / RATED**2
    np.testing.assert_allclose(out["tau_reading"], shown * (1 - np.exp(-out["time"] / 0.02)), atol=1e-5)
