"""Derivatives of states as variables, and Jacobians by states and parameters (FMI 2.0.4, 2.2.8 and 2.1.9)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cobot_joint.units import load_unit

Make = Callable[..., Any]
N, C, D_G, J_O, B = 338 / 3, 3000.0, 0.5, 4e-4, np.pi / 180


def initializing(make: Make, name: str, values: dict[str, float]) -> Any:
    """A unit in initialization mode."""
    slave = make(name)
    slave.fmu.reset()
    slave.fmu.setupExperiment()
    slave.fmu.enterInitializationMode()
    slave.set(values)
    return slave


def test_every_state_is_listed_with_its_derivative(fmu: Callable[[str], Any], name: str) -> None:
    unit = load_unit(fmu(name))
    listed = [unknown.variable for unknown in unit.description.derivatives]
    assert [v.name for v in listed] == [f"der({v.derivative.name})" for v in listed]
    work = {name for flange in unit.flanges for name in (flange.W, flange.W_abs)}
    starts = {n for n, v in unit.variables.items() if v.initial == "exact" and v.causality in ("local", "output")}
    assert [v.derivative.name for v in listed] == [n for n in unit.variables if n in starts | work]


def test_derivatives_are_the_slopes_of_the_states(make: Make, name: str) -> None:
    slave = make(name)
    states = [u.variable.derivative.name for u in slave.unit.description.derivatives]
    inputs = {n: 0.3 * float(slave.unit.variables[n].nominal) for n in slave.inputs()}
    slave.set(inputs)
    slave.step(5e-3)
    slave.set(inputs)
    given = [slave[f"der({state})"] for state in states]
    assert given == pytest.approx([slave.rate(state) for state in states])


def test_jacobian_of_the_gearhead_by_states_and_parameters_meets_its_closed_form(make: Make) -> None:
    """J_o dw_o/dt = c (phi/N - phi_o - b/2) + d_g (w/N - w_o) - tau_s"""
    e = 1e-3
    gear = initializing(make, "planetary_gear", {"phi": N * (B / 2 + e), "w": 0.0, "tau_s": 1.0})
    row = gear.vr("der(w_o)")
    expected = {
        "phi": C / N / J_O,
        "phi_o": -C / J_O,
        "w_o": -D_G / J_O,
        "tau_s": -1 / J_O,
        "mesh.c": e / J_O,
        "mesh.b": -C / 2 / J_O,
        "output.J_o": -(C * e - 1.0) / J_O**2,
        "ratio.N": -C * (B / 2 + e) / N / J_O,
    }
    for name, value in expected.items():
        assert gear.fmu.getDirectionalDerivative(row, gear.vr(name), [1.0])[0] == pytest.approx(value, rel=1e-6), name


def test_voltage_of_the_supply_rises_with_its_capacitors(make: Make) -> None:
    motor = initializing(make, "motor_bldc", {"bus.C": 1e-3, "surge": 2.0})
    given = motor.fmu.getDirectionalDerivative(motor.vr("v_dc"), motor.vr("surge"), [1.0])[0]
    ends = []
    for surge in (1.99, 2.01):
        motor.set({"surge": surge})
        ends.append(motor["v_dc"])
    assert given == pytest.approx((ends[1] - ends[0]) / 0.02, rel=1e-6)
    assert given == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize(("twist", "sign"), [(B / 2 + 1e-3, 1), (-B / 2 - 1e-3, -1), (0.0, 0)])
def test_a_unit_that_is_initializing_knows_its_contact(make: Make, twist: float, sign: int) -> None:
    gear = initializing(make, "planetary_gear", {"phi": N * twist})
    assert gear["tau_g"] == pytest.approx(sign * C * 1e-3, abs=1e-9)
    gear.set({"phi": -N * twist})  # and when it is moved to the other side
    assert gear["tau_g"] == pytest.approx(-sign * C * 1e-3, abs=1e-9)


def test_jacobian_of_every_output_is_that_of_what_is_read(make: Make, name: str) -> None:
    """by every state and input, as a central difference of values that are set and read"""
    slave = initializing(make, name, {})
    variables = slave.unit.variables
    states = [n for n, v in variables.items() if v.initial == "exact" and v.causality in ("local", "output")]
    values = {n: 0.3 * float(variables[n].nominal) for n in (*states, *slave.inputs()) if n != "J_coupled"}
    slave.set(values)
    outputs, wrong = slave.outputs(), {}
    for known, value in values.items():
        step = 1e-5 * float(variables[known].nominal)
        given = np.array(slave.fmu.getDirectionalDerivative(slave.vr(*outputs), slave.vr(known), [1.0]))
        ends = []
        for side in (-1, 1):
            slave.set({known: value + side * step})
            ends.append(slave.reals(outputs))
        slave.set({known: value})
        read = (ends[1] - ends[0]) / (2 * step)
        sizes = np.array([float(variables[n].nominal) for n in outputs]) / float(variables[known].nominal)
        off = np.abs(given - read) > 1e-3 * np.maximum(sizes, np.abs(read))
        wrong |= {(known, n): (a, b) for n, a, b, bad in zip(outputs, given, read, off, strict=True) if bad}
    assert wrong == {}
