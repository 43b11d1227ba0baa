"""Belt beyond its pretension and over its teeth: closed forms and energy; off at zero."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

J_P, J_B, R, C_B = 2e-3, 3e-4, 4.1, 60.0
FREE = {"belt.d_b": 0.0, "brake.tau_off": 0.0, "brake.d_off": 0.0}
KNEE = 0.5  # N.m, where the slack strand's tension is gone


@pytest.mark.parametrize("stretch", [0.004, 0.02, -0.02])
def test_belt_is_half_as_stiff_once_a_strand_is_slack(make: Make, stretch: float) -> None:
    brake = make("mr_brake_belt", {"stretch_add": stretch, "belt_tension.x": 1 / KNEE})
    both = C_B * abs(stretch)
    tau = both if both < KNEE else KNEE + C_B / 2 * (abs(stretch) - KNEE / C_B)
    assert brake["tau_belt"] == pytest.approx(np.copysign(tau, stretch))


def test_pulley_on_a_slack_belt_keeps_its_energy(make: Make) -> None:
    """the brake held by an immense inertia"""
    start = {"w_p": 6.0, "belt_tension.x": 1 / KNEE, "brake.J_b": 1e3, **FREE}
    out = make("mr_brake_belt", start, tolerance=1e-9).run(0.1, 1e-4, ["phi_p", "w_p", "tau_belt"])
    e, knee = np.abs(R * out["phi_p"]), KNEE / C_B
    beyond = np.maximum(0, e - knee)
    wound = C_B / 2 * np.minimum(e, knee) ** 2 + KNEE * beyond + C_B / 4 * beyond**2
    assert np.max(np.abs(out["tau_belt"])) > 2 * KNEE
    np.testing.assert_allclose(J_P / 2 * out["w_p"] ** 2 + wound, J_P / 2 * 36, rtol=5e-5)


def test_teeth_ripple_the_belt_and_the_pulley_feels_it_by_virtual_work(make: Make) -> None:
    A, z, psi, phi, tau_belt = 2e-3, 82, 0.4, 0.7, 1.5
    start = {"phi_p": phi, "phi_b": R * phi - tau_belt / C_B}
    term = {"belt_mesh.A": A, "belt_mesh.phi_0": psi}
    off, on = make("mr_brake_belt", start), make("mr_brake_belt", {**start, **term})
    assert off["tau_belt"] == pytest.approx(tau_belt)
    with_teeth = tau_belt + C_B * A * (np.sin(z * phi + psi) - np.sin(psi))
    assert on["tau_belt"] == pytest.approx(with_teeth)
    assert on.rate("w_p") == pytest.approx(-(R + A * z * np.cos(z * phi + psi)) * with_teeth / J_P)


def test_belt_over_its_teeth_keeps_its_energy(make: Make) -> None:
    start = {"w_p": 10.0, "w_b": 41.0, "belt_mesh.A": 2e-3, **FREE}
    names = ["phi_p", "w_p", "phi_b", "w_b", "tau_belt"]
    out = make("mr_brake_belt", start, tolerance=1e-9).run(0.2, 1e-3, names)
    energy = J_P / 2 * out["w_p"] ** 2 + J_B / 2 * out["w_b"] ** 2 + out["tau_belt"] ** 2 / (2 * C_B)
    assert np.ptp(out["tau_belt"]) > 0.1
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)


def test_order_of_the_teeth_is_their_number(make: Make) -> None:
    """per turn of the pulley, turned at a constant speed by an immense inertia against one that stands still"""
    start = {"w_p": 2 * np.pi, "w_b": 2 * np.pi * R, "pulley.J_p": 1e3, "belt_mesh.A": 1e-3, "belt_mesh.z": 20, **FREE}
    out = make("mr_brake_belt", {**start, "brake.J_b": 1e3}).run(1.0, 1e-3, ["tau_belt"])
    spectrum = np.abs(np.fft.rfft(out["tau_belt"][:-1] - out["tau_belt"][:-1].mean()))
    assert int(np.argmax(spectrum)) == 20
