"""The schemes against closed forms of an inertia on a spring and damper; native code against the Python reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from cobot_joint.cosim import SCHEMES, STEPPED, Experiment, Scheme, Simulation, SimulationError, simulate
from cobot_joint.errors import UserError
from cobot_joint.system import Inputs, System

MakeSystem = Callable[..., System]
NOTHING = Inputs(np.array([0.0]))  # inputs keep their start values
FOREIGN = [{"cubic": False}, {"interpolates": False}, {"slopes": False}]
SPRING_C, SPRING_D, J = 1.0, 0.1, 1.0
STOP = 20.0
AT_REST = {"inertia.rotor.phi_0": 0.0}


Z = SPRING_D / (2 * J)
W = np.sqrt(SPRING_C / J - Z * Z)


def let_go(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """phi of J phi'' + d phi' + c phi = 0 from phi = 1 at rest"""
    return np.exp(-Z * t) * (np.cos(W * t) + Z / W * np.sin(W * t))


def ramped(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """phi of J phi'' + d phi' + c phi = t from phi = 0 at rest"""
    lag = SPRING_D / SPRING_C
    return (t - lag + np.exp(-Z * t) * (lag * np.cos(W * t) + (lag * Z - 1) / W * np.sin(W * t))) / SPRING_C


def error_let_go(system: System, scheme: str | Scheme, step: float) -> float:
    result = simulate(system, Experiment(NOTHING, STOP, scheme=scheme, step=step, output_step=0.1))
    return float(np.max(np.abs(result.signals["phi"] - let_go(result.time))))


def error_ramped(system: System, scheme: str | Scheme, step: float) -> float:
    ramp = Inputs(np.array([0.0, STOP]), {"tau_drive": np.array([0.0, STOP])})
    result = simulate(system, Experiment(ramp, STOP, scheme=scheme, step=step, output_step=0.1, parameters=AT_REST))
    return float(np.max(np.abs(result.signals["phi"] - ramped(result.time))))


def test_each_finer_scheme_is_nearer_to_the_closed_form(make_oscillator: MakeSystem) -> None:
    system = make_oscillator()
    schemes = ["jacobi", "gauss_seidel", "gauss_seidel_extrapolated", replace(SCHEMES["iterative"], tolerance=1e-9)]
    errors = [error_let_go(system, scheme, 0.1) for scheme in schemes]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 3 * errors[1]
    assert errors[1] > 10 * errors[2]


@pytest.mark.parametrize(
    ("name", "order"), [("jacobi", 1), ("gauss_seidel", 1), ("gauss_seidel_extrapolated", 3), ("iterative", 3)]
)
def test_the_error_falls_with_the_order_of_the_scheme(make_oscillator: MakeSystem, name: str, order: int) -> None:
    system = make_oscillator()
    scheme = replace(SCHEMES[name], tolerance=1e-12)
    coarse, fine = error_ramped(system, scheme, 0.05), error_ramped(system, scheme, 0.025)
    assert np.log2(coarse / fine) > order - 0.35


@pytest.mark.parametrize("declared", FOREIGN)
def test_units_that_can_less_are_still_coupled_in_second_order(
    make_oscillator: MakeSystem, declared: dict[str, bool]
) -> None:
    system = make_oscillator(declared)
    coarse, fine = (error_ramped(system, "gauss_seidel_extrapolated", step) for step in (0.05, 0.025))
    assert np.log2(coarse / fine) > 1.7


def test_a_smaller_tolerance_makes_adaptive_steps_more_exact(make_oscillator: MakeSystem) -> None:
    system = make_oscillator()
    loose, tight = (
        error_ramped(system, replace(SCHEMES["adaptive"], tolerance=tolerance), 0.1) for tolerance in (1e-2, 1e-6)
    )
    assert tight < loose / 10


def test_an_adaptive_run_takes_back_steps_after_a_jolt_and_rests_at_rest(make_oscillator: MakeSystem) -> None:
    system = make_oscillator()
    jolt = Inputs(np.array([0.0, 0.49, 0.5, 0.6, 0.61]), {"tau_drive": np.array([0.0, 0.0, 40.0, 40.0, 0.0])})
    scheme = replace(SCHEMES["adaptive"], shortest=0.1 / 16)
    with Simulation(system) as simulation:
        simulation.run(Experiment(jolt, 50.0, scheme=scheme, step=1.6, output_step=0.1))
        jolted = simulation.counters
        rest = simulation.run(Experiment(NOTHING, 50.0, scheme=scheme, step=1.6, output_step=0.1, parameters=AT_REST))
        resting = simulation.counters
    assert jolted["rejected"] > 0
    assert jolted["steps"] > 5 * resting["steps"]
    assert resting["steps"] < 60  # 50/1.6, and the way up from the shortest step to the longest
    assert resting["rejected"] == 0
    assert np.all(rest.signals["phi"] == 0)


def test_rows_inside_long_steps_are_as_exact_as_the_steps(make_oscillator: MakeSystem) -> None:
    scheme = replace(SCHEMES["adaptive"], tolerance=1e-5)
    with Simulation(make_oscillator()) as simulation:
        result = simulation.run(Experiment(NOTHING, STOP, scheme=scheme, step=0.5, output_step=0.005))
        assert simulation.counters["steps"] < 0.5 * len(result.time)
    assert np.max(np.abs(result.signals["phi"] - let_go(result.time))) < 3e-5


def test_adaptive_steps_end_where_inputs_turn(make_oscillator: MakeSystem) -> None:
    pulse = Inputs(np.array([0.0, 3.3, 3.31, 3.32]), {"tau_drive": np.array([0.0, 0.0, 10.0, 0.0])})  # 0.1 N.m.s
    result = simulate(
        make_oscillator(),
        Experiment(pulse, 4.0, scheme="adaptive", step=1.6, output_step=0.1, parameters=AT_REST, record=["w"]),
    )
    assert np.max(np.abs(result.signals["w"][:34])) < 1e-12
    assert result.signals["w"][34] == pytest.approx(0.1, rel=0.02)


@pytest.mark.parametrize("name", STEPPED)
@pytest.mark.parametrize("declared", [{}, *FOREIGN])
def test_native_and_reference_give_the_same_bits(
    make_oscillator: MakeSystem, name: str, declared: dict[str, bool]
) -> None:
    system = make_oscillator(declared)
    t = np.linspace(0, 3, 31)
    drive = Inputs(t, {"tau_drive": np.sin(7 * t)})
    scheme = replace(SCHEMES[name], extrapolation=min(SCHEMES[name].extrapolation + 1, 3) if name != "jacobi" else 0)
    for tried in (SCHEMES[name], scheme):
        runs = [
            simulate(
                system,
                Experiment(
                    drive, 3.0, scheme=tried, step=0.05, output_step=0.1, record=["phi", "w", "tau", "tau_drive"]
                ),
                engine=engine,
            )
            for engine in ("native", "reference")
        ]
        for signal, native in runs[0].signals.items():
            assert native.tobytes() == runs[1].signals[signal].tobytes(), signal
        assert runs[0].energy == runs[1].energy


def test_work_given_is_work_taken(make_oscillator: MakeSystem) -> None:
    result = simulate(make_oscillator(), Experiment(NOTHING, STOP, step=0.01, output_step=0.1))
    assert list(result.energy) == ["inertia.shaft -> spring.shaft"]
    given, taken, absolute = result.energy["inertia.shaft -> spring.shaft"]
    assert given == pytest.approx(-0.5 * J * result.signals["w"][-1] ** 2, abs=1e-5)  # it started at rest
    assert abs(given - taken) < 1e-5 * absolute


def test_schemes_that_roll_back_refuse_units_that_cannot(make_oscillator: MakeSystem) -> None:
    system = make_oscillator({"rolls_back": False})
    for name in ("iterative", "adaptive"):
        with pytest.raises(SimulationError, match="inertia, spring cannot get and set the FMU state"):
            simulate(system, Experiment(NOTHING, 1.0, scheme=name))
    simulate(system, Experiment(NOTHING, 1.0))


def test_an_unknown_scheme_is_answered_with_the_known_ones(make_oscillator: MakeSystem) -> None:
    with pytest.raises(UserError, match="'euler' is given, allowed are jacobi, gauss_seidel,"):
        simulate(make_oscillator(), Experiment(NOTHING, 1.0, scheme="euler"))
