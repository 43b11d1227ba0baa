"""Runs from given states and the tangent along them, against runs of the whole system."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from cobot_joint.cosim.points import UnitFunction
from cobot_joint.diagnosis.state_estimation.linearisation import Lineariser, Tangent
from cobot_joint.diagnosis.state_estimation.native.linear import exponential
from cobot_joint.diagnosis.state_estimation.sampled import SampledSystem
from cobot_joint.diagnosis.state_estimation.states import states_of, why_none
from cobot_joint.errors import UserError
from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.state_estimation.rig import COGGING, SIGMA, bench, clock, inputs, run


def propagate(tangent: Tangent, d: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """What the tangent says the channels do: (n, channels)"""
    x, found = np.zeros(tangent.C.shape[2]), []
    for k in range(len(tangent.C)):
        found.append(tangent.C[k] @ x + tangent.D[k] @ d[k] + tangent.R[k] @ theta)
        if k < len(tangent.Phi):
            x = tangent.Phi[k] @ x + tangent.Gamma[k] @ (d[k] + d[k + 1]) / 2 + tangent.Psi[k] @ theta
    return np.array(found)


def assert_alike(found: np.ndarray, expected: np.ndarray) -> None:
    """Current and speed throughout; the torque where flanks stay in contact: an impact's millisecond is its own.

    A hundredth of the logger's noise is the roughness of two simulations.
    """
    error, size = found - expected, np.std(expected, axis=0)
    assert np.all(np.std(error, axis=0)[:2] < 0.07 * size[:2])
    assert np.std(error[700:1500, 2]) < 0.01 * (size[2] + SIGMA["tau_sensor"])


def test_exponential_and_its_integral_are_those_of_scipy() -> None:
    rng = np.random.default_rng(1)
    A, h = rng.standard_normal((5, 4, 4)) * np.geomspace(1, 3000, 5)[:, None, None], 1e-2
    A[-1] -= 3000 * np.eye(4)
    e, integral = exponential(A, h)
    for k in range(5):
        both = expm(h * np.block([[A[k], np.eye(4)], [np.zeros((4, 8))]]))
        np.testing.assert_allclose(e[k], both[:4, :4], rtol=1e-7, atol=1e-8 * np.abs(both).max())
        np.testing.assert_allclose(integral[k], both[:4, 4:], rtol=1e-7, atol=1e-8 * np.abs(both[:4, 4:]).max())


def test_a_run_cut_at_its_own_states_is_the_run() -> None:
    """Through contact, gap and reversal, to well below the logger's noise."""
    time = clock()
    with SampledSystem(bench()[0], list(SIGMA)) as sampled:
        whole = sampled.run(sampled.start({}), time, inputs(time))
        for first in range(0, len(time) - 100, 100):
            rows = slice(first, first + 101)
            piece = sampled.run(whole.x[first], time[rows], {n: u[rows] for n, u in whole.inputs.items()})
            error = np.abs(piece.y - whole.y[rows]) / list(SIGMA.values())
            assert error.max() < 0.1, first


@pytest.mark.parametrize(
    ("parameter", "step"),
    [("motor_bldc.winding.R", 2e-3), ("motor_bldc.rotor.J", 1e-7), ("mr_brake_belt.brake.k_b", 0.02)],
)
def test_tangent_by_a_parameter_is_the_difference_of_two_runs(parameter: str, step: float) -> None:
    system, _ = bench()
    nominal = {"motor_bldc.winding.R": 0.209, "motor_bldc.rotor.J": 5.38e-6, "mr_brake_belt.brake.k_b": 2.5}[parameter]
    with SampledSystem(system, list(SIGMA)) as sampled:
        base = sampled.run(sampled.start({}), clock(), inputs(clock()))
        tangent = Lineariser(sampled, [], None, [parameter]).tangent(base)
    expected = (run({parameter: nominal + step}).y - run({parameter: nominal - step}).y) / 2
    found = propagate(tangent, np.zeros((len(base.time), 0)), np.array([step]))
    assert_alike(found, expected)


@pytest.mark.parametrize("own", [False, True], ids=["values of a hypothesis", "the system's own"])
def test_tangent_of_a_wave_that_turns_within_a_sample_is_the_difference_of_two_runs(own: bool) -> None:
    """23 teeth at 350 rad/s turn by 8 rad per sample: their stiffness at the samples says nothing of the step's."""
    teeth = {"motor_bldc.cogging.A": 5e-3, "motor_bldc.cogging.n": 23.0}
    port, d = "motor_bldc.tau_add", 2e-5 * np.sin(2 * np.pi * 3 * clock())
    system, values = bench()[0], {} if own else teeth
    if own:
        parameters = {name.split(".", 1)[1]: value for name, value in teeth.items()}
        components = [replace(c, parameters={**c.parameters, **parameters}) if c.name == "motor_bldc" else c
                      for c in system.components]  # fmt: skip
        system = replace(system, components=components)
    with SampledSystem(system, list(SIGMA), values) as sampled:
        base = sampled.run(sampled.start({}), clock(), inputs(clock()))
        tangent = Lineariser(sampled, [port]).tangent(base)
    expected = (run(teeth, {port: d}).y - run(teeth, {port: -d}).y) / 2
    found = propagate(tangent, d[:, None], np.zeros(0))
    turning = slice(600, 1500)
    error, size = (found - expected)[turning], np.std(expected[turning], axis=0)
    assert np.all(np.std(error, axis=0)[:2] < 0.15 * size[:2])


@pytest.mark.parametrize(
    ("port", "size"), [("motor_bldc.tau_add", 2e-4), ("motor_bldc.v_add", 0.02), ("mr_brake_belt.tau_add", 0.02)]
)
def test_tangent_by_a_port_is_the_difference_of_two_runs(port: str, size: float) -> None:
    system, _ = bench()
    d = size * np.sin(2 * np.pi * 3 * clock())
    with SampledSystem(system, list(SIGMA)) as sampled:
        base = sampled.run(sampled.start({}), clock(), inputs(clock()))
        tangent = Lineariser(sampled, [port]).tangent(base)
    expected = (run(added={port: d}).y - run(added={port: -d}).y) / 2
    found = propagate(tangent, d[:, None], np.zeros(0))
    assert_alike(found, expected)


def test_states_of_the_bench_are_all_there() -> None:
    states = states_of(bench()[0])
    assert states is not None
    assert {"motor_bldc.w", "motor_bldc.x_i", "planetary_gear.phi_o", "mr_brake_belt.tau_m"} <= {s.name for s in states}


def test_a_unit_that_lists_no_derivatives_allows_no_state_to_be_set(axis: Path) -> None:
    system = load_system(axis)
    assert states_of(system) is None
    assert why_none(system) == "axis (axis.fmu) does not list the derivatives of its states"
    with pytest.raises(UserError, match=r"axis\.fmu"):
        SampledSystem(system, [])


def test_a_unit_without_directional_derivatives_is_linearised_by_differences(monkeypatch: pytest.MonkeyPatch) -> None:
    """With values that hold from within the run on."""
    time, ports = clock(0.6), ["motor_bldc.tau_add", "mr_brake_belt.tau_add"]
    cogging, onset = COGGING | {"motor_bldc.cogging.n": 1.0}, {"motor_bldc.cogging.A": 0.3}
    with SampledSystem(bench()[0], list(SIGMA), cogging, onset) as sampled:
        piece = sampled.run(sampled.start({}), time, inputs(time))
        expected = Lineariser(sampled, ports, None, ["motor_bldc.rotor.J"]).tangent(piece)
        own = property(lambda self: self.instance.name != "planetary_gear")
        monkeypatch.setattr(UnitFunction, "gives_derivatives", own)
        found = Lineariser(sampled, ports, None, ["motor_bldc.rotor.J"]).tangent(piece)
    with SampledSystem(bench()[0], list(SIGMA)) as sampled:
        without = Lineariser(sampled, ports).tangent(piece)
    for name in ("Phi", "Gamma", "Psi", "C", "D", "R"):
        one, other = getattr(found, name), getattr(expected, name)
        size = np.abs(other).max(axis=0) + 1e-12
        assert np.quantile(np.abs(one - other) / size, 0.999) < 1e-3, name
    apart = np.abs(expected.A - without.A).max(axis=(1, 2))
    assert apart[:299].max() == 0 < apart[301:].max()
