"""Friction of motor and gearhead: base and terms, as the torque that the shaft feels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

TAU_C = {"motor_bldc": 1.2e-3, "planetary_gear": 1.236e-3}
D = {"motor_bldc": 7.5e-6, "planetary_gear": 1.05e-5}
UNITS = tuple(TAU_C)
SPEEDS = (-300.0, -20.0, -0.5, 0.0, 0.5, 20.0, 300.0)


def friction(slave: Any) -> float:
    """Torque that resists, at the input shaft."""
    if slave.unit.name == "planetary_gear":  # no load, in the gap
        return float(slave["tau"])
    return float(-slave.rate("w") * slave["rotor.J"])


def at(make: Make, name: str, w: float, term: dict[str, float] | None = None) -> Any:
    held = {"rotor.J": 1e3, "enable": False} if name == "motor_bldc" else {}
    return make(name, {"w": w, **held, **(term or {})})


def added(make: Make, name: str, w: float, term: dict[str, float]) -> float:
    return friction(at(make, name, w, term)) - friction(at(make, name, w))


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize("w", SPEEDS)
def test_base_is_coulomb_and_viscous(make: Make, name: str, w: float) -> None:
    assert friction(at(make, name, w)) == pytest.approx(TAU_C[name] * np.tanh(w) + D[name] * w, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize("w", [1e-12, 1e-6, 1e-3, 3.0, 19.9, 20.1, 1e5, 1e300])
def test_the_smoothed_sign_is_tanh_to_rounding_and_odd(make: Make, name: str, w: float) -> None:
    only_dry = {"friction.d": 0.0, "friction.w_C": 1.0}
    ahead, back = (friction(at(make, name, v, only_dry)) for v in (w, -w))
    assert ahead == pytest.approx(TAU_C[name] * np.tanh(w), rel=1e-12, abs=3e-16 * TAU_C[name])
    assert back == -ahead


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize("w", SPEEDS)
def test_stribeck_falls_with_speed(make: Make, name: str, w: float) -> None:
    term = {"stribeck.tau_S": 4e-4, "stribeck.w_S": 50.0}
    expected = 4e-4 * np.exp(-((w / 50) ** 2)) * np.tanh(w)
    assert added(make, name, w, term) == pytest.approx(expected, rel=1e-6, abs=1e-15)


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize("w", SPEEDS)
def test_sublinear_viscous_loses_a_share_with_speed(make: Make, name: str, w: float) -> None:
    term = {"sublinear_viscous.x": 0.6, "sublinear_viscous.w_T": 100.0}
    expected = -0.6 * D[name] * w * abs(w) / (100 + abs(w))
    assert added(make, name, w, term) == pytest.approx(expected, rel=1e-6, abs=1e-15)


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize("w", SPEEDS)
def test_windage_grows_with_the_square_of_speed(make: Make, name: str, w: float) -> None:
    assert added(make, name, w, {"windage.c": 1e-8}) == pytest.approx(1e-8 * w * abs(w), rel=1e-6, abs=1e-15)


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize("w", SPEEDS)
def test_asymmetry_resists_forwards_and_helps_backwards(make: Make, name: str, w: float) -> None:
    expected = 1e-4 * np.tanh(w) ** 2
    assert added(make, name, w, {"friction_asymmetry.tau_A": 1e-4}) == pytest.approx(expected, rel=1e-6, abs=1e-15)


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize("w", SPEEDS)
def test_asymmetry_of_one_direction_leaves_the_other_as_it_is(make: Make, name: str, w: float) -> None:
    term = {"friction_asymmetry.tau_A": 1e-4, "friction_asymmetry.m": 1.0}
    expected = 1e-4 * (np.tanh(w) + 1) * np.tanh(w)
    assert added(make, name, w, term) == pytest.approx(expected, rel=1e-6, abs=1e-15)


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize("t", [0.0, 1.0, 4.0, 30.0])
def test_warmup_fades_viscous_friction_with_run_time(make: Make, name: str, t: float) -> None:
    term = {"viscous_warmup.fade": 0.3, "viscous_warmup.T": 4.0}
    warm, plain = at(make, name, 100.0, term), at(make, name, 100.0)
    if t > 0:
        warm.step(t)
        plain.step(t)
    expected = -0.3 * D[name] * 100 * (1 - np.exp(-t / 4))
    assert friction(warm) - friction(plain) == pytest.approx(expected, rel=1e-5, abs=1e-12)


@pytest.mark.parametrize("name", UNITS)
def test_presliding_carries_its_share_by_the_way_travelled(make: Make, name: str) -> None:
    """z = 1 - exp(-phi/phi_s) under forward motion from rest"""
    share, phi_s, w = 0.7, 0.2, 5.0
    slave = at(make, name, w, {"presliding.share": share, "presliding.phi_s": phi_s})
    for k in range(1, 20):
        slave.step(0.01)
        z = 1 - np.exp(-w * 0.01 * k / phi_s)
        coulomb = TAU_C[name] * ((1 - share) * np.tanh(w) + share * z)
        assert friction(slave) == pytest.approx(coulomb + D[name] * w, rel=1e-4)


def test_presliding_springs_back_below_breakaway(make: Make) -> None:
    """a bristle of stiffness tau_C/phi_s holds a torque well below tau_C, where smoothed Coulomb friction creeps"""
    start = {"tau": -2e-4, "enable": False, "friction.d": 2e-3}
    bristle = make("motor_bldc", {**start, "presliding.share": 1.0, "presliding.phi_s": 0.05})
    creep = make("motor_bldc", start)
    bristle.step(20.0)
    creep.step(20.0)
    z = 2e-4 / 1.2e-3
    assert bristle["phi"] == pytest.approx(-0.05 * np.log(1 - z), rel=0.02)
    assert creep["phi"] > 10 * bristle["phi"]


@pytest.mark.parametrize("name", UNITS)
def test_warmup_counts_from_the_start_of_the_run(instantiate: Make, name: str) -> None:
    values = {"w": 100.0, "viscous_warmup.fade": 0.3, "viscous_warmup.T": 4.0}
    values |= {"rotor.J": 1e3, "enable": False} if name == "motor_bldc" else {}
    cold = []
    for start in (0.0, 50.0):
        slave = instantiate(name)
        slave.fmu.setupExperiment(startTime=start)
        slave.set(values)
        slave.fmu.enterInitializationMode()
        slave.fmu.exitInitializationMode()
        cold.append(friction(slave))
    assert cold[1] == cold[0]
