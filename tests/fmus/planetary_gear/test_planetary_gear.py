"""The gearhead alone: ratio, efficiency, backlash, contact, inertia, terms. Its friction is in test_friction.py."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

Make = Callable[..., Any]

N, ETA, C, D_G, B, J_O = 338 / 3, 0.75, 3000.0, 0.5, np.pi / 180, 4e-4
FRICTIONLESS = {"friction.tau_C": 0.0, "friction.d": 0.0}
HELD = {"output.J_o": 1e3}  # an immense inertia holds the output


def in_contact(tau_g: float, w: float, **more: float) -> dict[str, float]:
    """Angles at which the mesh transmits tau_g; the output follows the input, so that nothing is damped."""
    return {"phi": N * (np.sign(tau_g) * B / 2 + tau_g / C), "w": w, "w_o": w / N, **HELD, **FRICTIONLESS, **more}


def test_output_turns_n_times_slower_under_steady_torque(make: Make) -> None:
    gear = make("planetary_gear", {"w": 200.0, "tau_s": 1.0})
    gear.slope("phi", 200.0)
    gear.step(1.0)
    assert gear["w_o"] == pytest.approx(200 / N, rel=1e-6)
    assert gear["delta"] == pytest.approx(B / 2 + 1.0 / C, rel=1e-6)
    assert gear["tau_g"] == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize(("tau_g", "w"), [(5.0, 300.0), (-5.0, -300.0)])
def test_driving_motor_pays_for_the_efficiency(make: Make, tau_g: float, w: float) -> None:
    gear = make("planetary_gear", in_contact(tau_g, w))
    assert gear["tau"] == pytest.approx(tau_g / N / ETA, rel=1e-9)


@pytest.mark.parametrize(("tau_g", "w"), [(5.0, -300.0), (-5.0, 300.0)])
def test_driving_load_pays_for_the_efficiency(make: Make, tau_g: float, w: float) -> None:
    gear = make("planetary_gear", in_contact(tau_g, w))
    assert gear["tau"] == pytest.approx(tau_g / N * ETA, rel=1e-9)


@pytest.mark.parametrize("member", [3, 4])
@pytest.mark.parametrize(("tau_g", "w"), [(5.0, 300.0), (-5.0, -300.0), (5.0, -300.0), (-5.0, 300.0)])
def test_held_carrier_turns_the_output_backwards_and_loses_power_all_the_same(
    make: Make, member: int, tau_g: float, w: float
) -> None:
    """the two rows of Table 2.3 with N < 0: power flows forwards where tau_g and w differ in sign"""
    ratio = {"ratio.from": 2, "ratio.stages": 1, "ratio.member_1": member, "ratio.z_s_1": 15, "ratio.z_r_1": 50}
    n = {3: -50 / 15, 4: -15 / 50}[member]
    start = in_contact(tau_g, w) | {"phi": n * (np.sign(tau_g) * B / 2 + tau_g / C), "w_o": w / n}
    gear = make("planetary_gear", start | ratio)
    eta = 1 / ETA if tau_g * w / n > 0 else ETA
    assert gear["tau_g"] == pytest.approx(tau_g, rel=1e-9)
    assert gear["tau"] == pytest.approx(tau_g / n * eta, rel=1e-9)


def test_mesh_is_ideal_without_power_and_makes_none_around_it(make: Make) -> None:
    """eq. 2.26 with the smooth m gives power away for -0.144 W < tau_g*w < 0"""
    loss = []
    for w in (-0.07, -0.05, -0.02, 0.0, 0.02, 0.05):
        gear = make("planetary_gear", in_contact(2.0, w))
        loss.append((gear["tau"] - 2 / N) * w)
    assert min(loss) >= -1e-12
    assert make("planetary_gear", in_contact(2.0, 0.0))["tau"] == pytest.approx(2 / N, rel=1e-12)


def test_direction_of_power_changes_smoothly_over_p_0(make: Make) -> None:
    gear = make("planetary_gear", in_contact(2.0, 0.25))
    m = (1 + np.tanh(2.0 * 0.25 / 1.0)) / 2
    assert gear["tau"] == pytest.approx(2 / N * (m / ETA + (1 - m) * ETA), rel=1e-9)


def test_power_is_lost_in_both_directions(make: Make) -> None:
    for tau_g, w in [(5.0, 300.0), (5.0, -300.0), (-3.0, 50.0), (-3.0, -50.0)]:
        gear = make("planetary_gear", in_contact(tau_g, w))
        assert gear["tau"] * w > tau_g * w / N


def test_backlash_loses_one_degree_of_motion_at_the_output(make: Make) -> None:
    """there and back, slowly, against a damped load: between pushing forwards and pushing backwards lies the gap"""
    gear = make("planetary_gear", {**FRICTIONLESS, "output.J_o": 1e-2})
    w = 20.0

    def angle(t: float) -> float:
        return w * t if t < 1 else w * (2 - t)

    pushing: list[tuple[float, float]] = []
    for k in range(2000):
        t = k * 1e-3
        speed = w if t < 1 else -w
        gear.set({"phi": angle(t), "w": speed, "tau_s": 0.5 * np.tanh(gear["w_o"] / 0.01)})
        gear.slope("phi", speed)
        gear.step(1e-3)
        if gear["tau_g"] != 0:
            pushing.append((gear["delta"], gear["tau_g"]))
    forwards = np.mean([delta for delta, tau in pushing[-4000:] if tau > 0.2])
    backwards = np.mean([delta for delta, tau in pushing if tau < -0.2])
    assert forwards - backwards == pytest.approx(B + 2 * 0.5 / C, rel=0.05)


def test_no_torque_passes_the_gap(make: Make) -> None:
    for delta in (-0.49 * B, 0.0, 0.49 * B):
        gear = make("planetary_gear", {"phi": N * delta, "w": 0.0, **FRICTIONLESS})
        assert gear["tau_g"] == 0
        assert gear["tau"] == 0


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("e", [1e-4, 1e-3])
def test_contact_is_a_spring_with_a_damper(make: Make, sign: int, e: float) -> None:
    w_o = -sign * 0.3
    gear = make("planetary_gear", {"phi": sign * N * (B / 2 + e), "w_o": w_o})
    assert gear["tau_g"] == pytest.approx(sign * (C * e + D_G * 0.3), rel=1e-9)


@pytest.mark.parametrize("sign", [1, -1])
def test_contact_never_pulls(make: Make, sign: int) -> None:
    """parting fast while still pressed in: the damper would pull"""
    gear = make("planetary_gear", {"phi": sign * N * (B / 2 + 1e-4), "w_o": sign * 3.0})
    assert gear["tau_g"] == 0


@pytest.mark.parametrize("sign", [1, -1])
def test_impact_without_damping_keeps_the_energy(make: Make, sign: int) -> None:
    gear = make("planetary_gear", {"w_o": sign * 2.0, "mesh.d_g": 0.0}, tolerance=1e-8)
    out = gear.run(0.1, 1e-3, ["w_o", "tau_g"])
    free = out["tau_g"] == 0
    np.testing.assert_allclose(np.abs(out["w_o"][free]), 2.0, rtol=1e-5)
    assert np.any(sign * out["w_o"] < -1.9)


def test_impact_with_damping_loses_what_the_closed_form_says(make: Make) -> None:
    """one rebound of J_o e'' + d_g e' + c e = 0 that ends where the force would pull"""
    J, w_0 = 0.1, 1.0
    omega, zeta = np.sqrt(C / J), D_G / (2 * np.sqrt(C * J))
    omega_d = omega * np.sqrt(1 - zeta**2)
    t = np.linspace(0, np.pi / omega_d, 200001)
    decay = np.exp(-zeta * omega * t)
    e = w_0 / omega_d * decay * np.sin(omega_d * t)
    rate = w_0 * decay * (np.cos(omega_d * t) - zeta * omega / omega_d * np.sin(omega_d * t))
    end = np.flatnonzero(C * e[1:] + D_G * rate[1:] <= 0)[0] + 1
    gear = make("planetary_gear", {"w_o": w_0, "output.J_o": J}, tolerance=1e-9)
    out = gear.run(0.05, 1e-4, ["w_o", "tau_g"])
    gone = np.flatnonzero((out["w_o"] < 0) & (out["tau_g"] == 0))[0]
    assert out["w_o"][gone] == pytest.approx(rate[end], rel=1e-4)


@pytest.mark.parametrize("h", [1e-4, 2e-3, 1e-2])
def test_impacts_do_not_depend_on_the_communication_step(make: Make, h: float) -> None:
    fine = make("planetary_gear", {"w_o": 2.0}, tolerance=1e-8).run(0.05, 1e-4, ["w_o", "phi_o"])
    slave = make("planetary_gear", {"w_o": 2.0}, tolerance=1e-8)
    out = slave.run(0.05, h, ["w_o", "phi_o"])
    assert out["w_o"][-1] == pytest.approx(fine["w_o"][-1], abs=1e-5)
    assert out["phi_o"][-1] == pytest.approx(fine["phi_o"][-1], abs=1e-7)


def test_output_shaft_obeys_newton(make: Make) -> None:
    gear = make("planetary_gear", {"tau_s": -0.2, "tau_o_add": 0.1})
    assert gear.rate("w_o") == pytest.approx(0.3 / J_O, rel=1e-9)


def test_added_torque_helps_the_input_shaft(make: Make) -> None:
    gear = make("planetary_gear", {"tau_add": 0.004})
    assert gear["tau"] == pytest.approx(-0.004, rel=1e-12)


def test_reflected_inertia_is_handed_to_the_motor(make: Make) -> None:
    assert make("planetary_gear")["J_coupled"] == 9.3e-7
    assert make("planetary_gear", {"housing.J_coupled": 2e-6})["J_coupled"] == 2e-6


def test_work_in_is_work_out_and_losses(make: Make) -> None:
    gear = make("planetary_gear", {**FRICTIONLESS, "tau_s": 2.0, "w": 100.0})
    gear.slope("phi", 100.0)
    gear.step(1.0)
    start = {name: gear[name] for name in ("W_in", "W_out")}
    gear.slope("phi", 100.0)
    gear.step(1.0)
    assert gear["W_out"] - start["W_out"] == pytest.approx(2.0 * 100 / N, rel=1e-5)
    assert gear["W_in"] - start["W_in"] == pytest.approx(2.0 * 100 / N / ETA, rel=1e-5)


Z_S, Z_R = 15, 50
ROWS = {  # Table 2.3, Willis' equation
    "sun in, carrier out": (1, 1 + Z_R / Z_S),
    "ring in, carrier out": (2, 1 + Z_S / Z_R),
    "sun in, ring out": (3, -Z_R / Z_S),
    "ring in, sun out": (4, -Z_S / Z_R),
    "carrier in, ring out": (5, Z_R / (Z_R + Z_S)),
    "carrier in, sun out": (6, Z_S / (Z_R + Z_S)),
    "locked": (7, 1.0),
}


def ratio_of(make: Make, start: dict[str, float]) -> float:
    return 1 / float(make("planetary_gear", {"ratio.from": 2, "phi": 1.0, **HELD, **start})["delta"])


@pytest.mark.parametrize("row", ROWS)
def test_one_stage_has_the_ratio_of_its_held_member(make: Make, row: str) -> None:
    member, expected = ROWS[row]
    start = {"ratio.stages": 1, "ratio.member_1": member, "ratio.z_s_1": Z_S, "ratio.z_r_1": Z_R}
    assert ratio_of(make, start) == pytest.approx(expected, rel=1e-12)


def test_sun_held_is_the_smallest_reduction_and_ring_held_the_largest(make: Make) -> None:
    ratios = {row: ratio for row, (_, ratio) in ROWS.items() if ratio > 1}
    assert min(ratios, key=ratios.__getitem__) == "ring in, carrier out"
    assert max(ratios, key=ratios.__getitem__) == "sun in, carrier out"


def test_three_stages_as_built_make_338_over_3(make: Make) -> None:
    """13/3 * 13/3 * 6"""
    assert ratio_of(make, {}) == pytest.approx(338 / 3, rel=1e-12)
    assert make("planetary_gear")["ratio.N"] == pytest.approx(338 / 3, rel=1e-15)


def test_ratio_of_stages_is_their_product(make: Make) -> None:
    start = {"ratio.stages": 2, "ratio.member_1": 3, "ratio.z_s_2": 20, "ratio.z_r_2": 60}
    assert ratio_of(make, start) == pytest.approx(-50 / 15 * 4, rel=1e-12)


def test_stages_as_the_unit_starts_have_planets_with_whole_teeth(load: Callable[[str], Any]) -> None:
    variables = load("planetary_gear").variables
    for k in (1, 2, 3):
        z_s, z_r = (int(variables[f"ratio.z_{x}_{k}"].start) for x in "sr")
        assert (z_r - z_s) % 2 == 0


def test_ring_smaller_than_its_sun_is_refused(instantiate: Make) -> None:
    gear = instantiate("planetary_gear")
    with pytest.raises(FMICallException):
        gear.initialise({"ratio.from": 2, "ratio.z_s_1": 60, "ratio.z_r_1": 12})
    assert "is not finite" in gear.log[0]


def test_neutral_stage_passes_nothing(make: Make) -> None:
    start = {"ratio.from": 2, "ratio.stages": 1, "ratio.member_1": 8, "phi": 1e4, "w": 500.0, "tau_s": 0.0}
    gear = make("planetary_gear", {**start, **FRICTIONLESS})
    gear.step(0.1)
    assert gear["tau"] == 0
    assert gear["tau_g"] == 0
    assert gear["w_o"] == 0


def test_load_friction_grows_with_the_transmitted_torque(make: Make) -> None:
    for tau_g, w in [(5.0, 300.0), (5.0, -300.0), (-2.0, 300.0)]:
        off = make("planetary_gear", in_contact(tau_g, w))
        on = make("planetary_gear", in_contact(tau_g, w, **{"load_friction.mu": 0.1}))
        expected = 0.1 * abs(tau_g) / N * np.sign(w)
        assert on["tau"] - off["tau"] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("b_x", [0.01, -0.01, -0.05])
def test_extra_backlash_widens_or_narrows_the_gap(make: Make, b_x: float) -> None:
    """never below none at all"""
    half = max(0.0, B + b_x) / 2
    gear = make("planetary_gear", {"phi": N * (half + 1e-3), "backlash.b_x": b_x})
    assert gear["tau_g"] == pytest.approx(C * 1e-3, rel=1e-9)


@pytest.mark.parametrize("n", [1.0, 3.0])
def test_transmission_error_adds_to_the_twist(make: Make, n: float) -> None:
    A, phi_0, phi_o, w_o = 1e-3, 0.3, 0.8, 2.0
    term = {"transmission_error.A": A, "transmission_error.n": n, "transmission_error.phi_0": phi_0}
    start = {"phi_o": phi_o, "w_o": w_o, "phi": N * (phi_o + B / 2 + 2e-3), "w": N * w_o}
    gear = make("planetary_gear", {**start, **term})
    delta = B / 2 + 2e-3 + A * np.sin(n * phi_o + phi_0)
    assert gear["delta"] == pytest.approx(delta, rel=1e-9)
    rate = A * n * w_o * np.cos(n * phi_o + phi_0)
    assert gear["tau_g"] == pytest.approx(C * (delta - B / 2) + D_G * rate, rel=1e-7)


@pytest.mark.parametrize("n", [1.0, 40.0])
def test_transmission_error_neither_makes_nor_loses_energy(make: Make, n: float) -> None:
    """the output turns against an ideal mesh whose input stands: spring and inertia exchange what there is"""
    term = {"transmission_error.A": 2e-3, "transmission_error.n": n, "mesh.b": 0.0, "mesh.d_g": 0.0}
    gear = make("planetary_gear", {**term, **FRICTIONLESS, "w_o": 1.0, "output.J_o": 0.1}, tolerance=1e-9)
    out = gear.run(0.2, 1e-3, ["w_o", "tau_g"])
    energy = 0.1 * out["w_o"] ** 2 / 2 + out["tau_g"] ** 2 / (2 * C)
    assert np.ptp(out["tau_g"]) > 1
    np.testing.assert_allclose(energy, energy[0], rtol=1e-4)


def test_added_angle_winds_the_mesh_up(make: Make) -> None:
    gear = make("planetary_gear", {"phi": N * (B / 2 + 1e-3)})
    gear.set({"delta_add": 5e-4})
    assert gear["delta"] == pytest.approx(B / 2 + 1.5e-3, rel=1e-9)
    assert gear["tau_g"] == pytest.approx(C * 1.5e-3, rel=1e-9)


@pytest.mark.parametrize("sign", [1, -1])
def test_stiffness_hardens_with_the_square_of_the_wind_up(make: Make, sign: int) -> None:
    e, h = 2e-3, 1e5
    gear = make("planetary_gear", {"phi": sign * N * (B / 2 + e), "stiffness_hardening.h": h})
    assert gear["tau_g"] == pytest.approx(sign * C * e * (1 + h * e**2), rel=1e-9)
