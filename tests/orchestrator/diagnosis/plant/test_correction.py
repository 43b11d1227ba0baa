"""A formula or a table becomes parameters of the precompiled correction, and the FMU then computes just that."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest

from cobot_joint.diagnosis.plant.correction import SGN, Factor, formula_parameters, parse, table_parameters
from cobot_joint.diagnosis.repair.export import export_unit
from cobot_joint.errors import UserError
from cobot_joint.units import find_fmu, load_unit


@pytest.mark.parametrize(
    ("form", "constant", "factors"),
    [
        ("1", 1.0, []),
        ("w", 1.0, [Factor("w", "u")]),
        ("-2*w^3", -2.0, [Factor("w", "u3")]),
        ("sin(2*phi_b)*sgn(w_b)", 1.0, [Factor("phi_b", "sin", 2.0), Factor("w_b", "tanh", SGN)]),
        ("tanh(w/0.5)", 1.0, [Factor("w", "tanh", 0.5)]),
        ("cos(phi)*abs(tau)", 1.0, [Factor("phi", "cos"), Factor("tau", "abs")]),
        ("exp(-(i/2)^2)", 1.0, [Factor("i", "gauss", 2.0)]),
        ("eddy(w/140)*abs(w)", 1.0, [Factor("w", "eddy", 140.0), Factor("w", "abs")]),
        ("exp(-abs(w)/3)*sgn(w)", 1.0, [Factor("w", "exp", 3.0), Factor("w", "tanh", SGN)]),
        ("exp(-t/4)*w", 1.0, [Factor("t", "exp", 4.0), Factor("w", "u")]),
        ("sin(24*mr_brake_belt.phi_b)", 1.0, [Factor("mr_brake_belt.phi_b", "sin", 24.0)]),
    ],
)
def test_a_form_is_a_product_of_functions(form: str, constant: float, factors: list[Factor]) -> None:
    assert parse(form) == (constant, factors)


@pytest.mark.parametrize("form", ["log(w)", "w+v", "w^7", "__import__('os')", "sin(w*v)", "exp(w)", ""])
def test_a_form_that_the_unit_cannot_compute_is_refused(form: str) -> None:
    with pytest.raises(UserError, match="is given, a product of"):
        parse(form)


def test_more_than_there_is_room_for_is_refused() -> None:
    with pytest.raises(UserError, match="8 terms in 4 signals at most are allowed"):
        formula_parameters([(1.0, name) for name in "abcde"])
    with pytest.raises(UserError, match="8 terms in 4 signals at most are allowed"):
        formula_parameters([(1.0, "w")] * 9)


def computed(tmp_path: Path, values: dict[str, float], inputs: dict[str, np.ndarray], time: np.ndarray) -> np.ndarray:
    """The exported unit in FMPy, without start values. FMPy holds inputs over a step: y at k + 1 belongs to u at k."""
    path = export_unit(load_unit(find_fmu("correction.fmu")), values, tmp_path / "c.fmu")
    signals = np.rec.fromarrays([time, *inputs.values()], names=["time", *inputs])
    out = fmpy.simulate_fmu(str(path), input=signals, output=["y"], stop_time=time[-1], output_interval=time[1])
    assert np.allclose(out["time"], time)
    return np.asarray(out["y"])[1:]


T = np.arange(201) * 0.01
FORMULAS: list[tuple[list[tuple[float, str]], Callable[[np.ndarray, np.ndarray], np.ndarray]]] = [
    ([(0.5, "a"), (2.0, "b^2")], lambda a, b: 0.5 * a + 2 * b**2),
    ([(0.3, "sin(3*a)*b"), (0.1, "1")], lambda a, b: 0.3 * np.sin(3 * a) * b + 0.1),
    ([(1.0, "tanh(a/0.5)*cos(2*b)"), (-1.0, "a^3")], lambda a, b: np.tanh(a / 0.5) * np.cos(2 * b) - a**3),
    ([(1.0, "exp(-(a/0.7)^2)"), (1.0, "exp(-abs(b)/2)*abs(a)")],
     lambda a, b: np.exp(-((a / 0.7) ** 2)) + np.exp(-abs(b) / 2) * abs(a)),
    ([(2.0, "eddy(a/0.4)")], lambda a, b: 2.0 * (a / 0.4) / (1 + (a / 0.4) ** 2)),
]  # fmt: skip


@pytest.mark.parametrize(("terms", "expected"), FORMULAS)
def test_the_unit_computes_the_formula(
    tmp_path: Path, terms: list[tuple[float, str]], expected: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> None:
    values, signals = formula_parameters(terms)
    given = {"a": np.sin(5 * T), "b": 3 * T - 2}
    inputs = {f"u{k}": given[name] for k, name in enumerate(signals, 1)}
    y = computed(tmp_path, values, inputs, T)
    assert np.allclose(y, expected(given["a"], given["b"])[:-1], atol=1e-12)


@pytest.mark.parametrize("points", [2, 7, 64, 500])
def test_the_unit_computes_the_table_held_outside(tmp_path: Path, points: int) -> None:
    x = np.linspace(-1.5, 1.5, points)
    y = 0.4 * x - 0.1
    values, _ = table_parameters("a", x[::-1], y[::-1])
    u = 4 * T - 4
    y = computed(tmp_path, values, {"u1": u}, T)
    assert np.allclose(y, (0.4 * np.clip(u, -1.5, 1.5) - 0.1)[:-1], atol=1e-12)


def test_a_periodic_table_repeats(tmp_path: Path) -> None:
    x = np.linspace(0, 1, 33)
    values, _ = table_parameters("a", x, np.abs(x - 0.5), period=1.0)
    u = 6 * T - 5.03
    assert np.allclose(computed(tmp_path, values, {"u1": u}, T), np.abs(u % 1 - 0.5)[:-1], atol=1e-12)


def test_time_and_a_signal_that_a_product_has_twice_are_factors_like_others(tmp_path: Path) -> None:
    values, signals = formula_parameters([(2.0, "exp(-t/0.5)*a"), (1.0, "exp(-abs(a)/2)*tanh(a/0.1)")])
    assert signals == ["a", "a"]
    a = np.sin(5 * T)
    y = computed(tmp_path, values, {"u1": a, "u2": a}, T)
    time = T[1:]  # the unit's own clock is not held
    assert np.allclose(y, 2 * np.exp(-time / 0.5) * a[:-1] + np.exp(-np.abs(a) / 2)[:-1] * np.tanh(a / 0.1)[:-1])


def test_a_table_takes_a_direction_and_may_be_over_time(tmp_path: Path) -> None:
    values, signals = table_parameters("t", np.array([0.0, 2.0]), np.array([1.0, 3.0]), factor="sgn(w)")
    assert signals == ["w"]
    assert values["clock.u"] == 2
    values, signals = table_parameters("a", np.array([0.0, 2.0]), np.array([1.0, 3.0]), factor="tanh(w/0.1)")
    assert signals == ["a", "w"]
    a, w = T, np.cos(3 * T)
    y = computed(tmp_path, values, {"u1": a, "u2": w}, T)
    assert np.allclose(y, (1 + a[:-1]) * np.tanh(w / 0.1)[:-1], atol=1e-12)


def test_the_correction_is_added_to_what_passes_and_begins_at_its_onset(tmp_path: Path) -> None:
    values, _ = formula_parameters([(2.0, "a")], onset=1.0)
    y = computed(tmp_path, values, {"x": np.cos(T), "u1": np.ones_like(T)}, T)
    assert np.allclose(y, np.cos(T)[:-1] + 2 * (T[1:] >= 1 - 1e-9), atol=1e-12)
