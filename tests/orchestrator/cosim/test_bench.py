"""The schemes on the bench against the monolithic reference solutions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cobot_joint.cosim import DEFAULT, STEPPED, Experiment, Simulation, simulate
from cobot_joint.results.result import Result
from cobot_joint.system import Inputs, load_system

SCENARIOS = ["no_load", "load_mr_brake", "load_hand", "reversals"]
ACCURACY = {"i_motor": 4e-4, "w_motor": 0.03, "tau_sensor": 5e-4}  # rms: A, rad/s, N.m


def run_reference(
    shared: Path, scenario: str, scheme: str, step: float | None = None
) -> tuple[Result, dict[str, np.ndarray]]:
    """A run on the reference solution's inputs, and that solution."""
    table = pq.read_table(shared / "reference" / f"{scenario}.parquet")
    reference = {name.split(" [")[0]: table[name].to_numpy() for name in table.column_names}
    system = load_system("joint_no_load" if scenario == "no_load" else "joint")
    inputs = Inputs(reference["time"], {name: reference[name] for name in system.inputs})
    return simulate(system, Experiment(inputs, 20.0, scheme=scheme, step=step)), reference


@pytest.mark.parametrize("scheme", ["gauss_seidel_extrapolated", "iterative", "adaptive", "monolithic"])
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_bench_is_as_the_reference_solution(shared: Path, scenario: str, scheme: str) -> None:
    result, reference = run_reference(shared, scenario, scheme)
    np.testing.assert_allclose(result.time, reference["time"], rtol=1e-12)
    for name, limit in ACCURACY.items():
        if name in result.signals:
            assert np.sqrt(np.mean((result.signals[name] - reference[name]) ** 2)) <= limit, name


@pytest.mark.parametrize(("step", "limit"), [(1e-4, 4e-4), (2e-4, 1e-3), (1e-3, 2e-2)])
def test_jacobi_couples_as_in_masters_that_tell_no_derivatives(shared: Path, step: float, limit: float) -> None:
    """the README's first row; told that inputs stand still, the joint ran a limit cycle, 0.26 to 5.8 A"""
    result, reference = run_reference(shared, "load_mr_brake", "jacobi", step)
    error = np.interp(reference["time"], result.time, result.signals["i_motor"]) - reference["i_motor"]
    assert np.sqrt(np.mean(error**2)) <= limit
    assert all(abs(result.energy_residual(name)) < 1e-3 for name in result.energy)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_no_energy_is_lost_between_units(shared: Path, scenario: str) -> None:
    result, _ = run_reference(shared, scenario, DEFAULT)
    assert len(result.energy) == (1 if scenario == "no_load" else 3)
    for name, (given, taken, absolute) in result.energy.items():
        assert abs(given - taken) <= 1e-3 * absolute, name


@pytest.mark.parametrize("scheme", STEPPED)
def test_on_the_bench_native_and_reference_give_the_same_bits(scheme: str) -> None:
    system = load_system("joint")
    t = np.array([0.0, 0.02, 0.1, 0.15])
    inputs = Inputs(
        t,
        {
            "v_command": np.array([0.0, 12.0, 12.0, -6.0]),
            "i_brake": np.array([0.0, 0.0, 0.3, 0.3]),
            "tau_hold": np.array([0.0, 0.0, 2.0, 0.0]),
        },
    )
    native, plain = (
        simulate(system, Experiment(inputs, 0.15, scheme=scheme), engine=engine) for engine in ("native", "reference")
    )
    for name, samples in native.signals.items():
        assert np.all(np.isfinite(samples))
        assert samples.tobytes() == plain.signals[name].tobytes(), name
    assert np.ptp(native.signals["w_motor"]) > 10
    assert native.energy == plain.energy


def test_long_adaptive_steps_miss_no_impact(shared: Path) -> None:
    """Without load the gap is crossed in free flight; an impact is over within a millisecond."""
    result, reference = run_reference(shared, "no_load", "adaptive", step=16e-3)
    assert result.step > 15e-3
    assert np.max(np.abs(result.signals["i_motor"] - reference["i_motor"])) <= 1e-3  # A


def test_a_parameter_that_changes_a_little_while_time_runs_leaves_no_other_trace() -> None:
    system = load_system("joint")
    inputs = Inputs(np.array([0.0, 0.1]), {"v_command": np.array([0.0, 12.0])})
    events = [(0.4, {"motor_bldc.winding.R": 0.21})]
    before, after = (
        simulate(system, Experiment(inputs, 0.6)),
        simulate(system, Experiment(inputs, 0.6, parameter_events=events)),
    )
    difference = np.abs(after.signals["i_motor"] - before.signals["i_motor"])
    assert np.all(difference[:401] == 0)
    assert 1e-4 < np.max(difference) < 0.005 * np.max(before.signals["i_motor"])  # R changes by 0.5 %


def test_rows_are_recorded_where_steps_end_unless_longer_steps_are_asked_for(shared: Path) -> None:
    """A converter's staircase must not be interpolated."""
    result, _ = run_reference(shared, "no_load", "adaptive")
    assert result.step == pytest.approx(1e-3)


STEPS = Inputs(np.array([0.0, 0.02, 0.5]), {"v_command": np.array([0.0, 6.0, 6.0])})
LONG = {"step": 16e-3, "output_step": 1e-3}
COARSE = {"acquisition.converter.bits": 8, "acquisition.range.v_max": 5.0}


def test_what_is_logged_inside_of_long_steps_is_converted_there() -> None:
    """The logger goes from row to row: no row lies between two of the converter's values."""
    result = simulate(load_system("joint_logged"), Experiment(STEPS, 0.5, scheme="adaptive", parameters=COARSE, **LONG))
    assert result.step > 10 * LONG["output_step"]
    of_one = result.signals["i_motor"] * 1.0 / (2 * 5.0 / 2**8)  # range.k_i = 1 V/A, in the converter's steps
    assert np.ptp(of_one) > 10
    np.testing.assert_allclose(of_one, np.round(of_one), atol=1e-9)


@pytest.mark.parametrize("engine", ["native", "reference"])
def test_of_what_only_listens_nothing_comes_back(engine: str) -> None:
    """The same steps whatever the logger does, and the same readings whatever else is recorded of it."""
    with Simulation(load_system("joint_logged"), engine) as simulation:
        simulation.run(Experiment(STEPS, 0.1, **LONG))
        quiet = dict(simulation.counters)
        alone = simulation.run(Experiment(STEPS, 0.1, parameters=COARSE, record=["i_motor"], **LONG))
        assert simulation.counters == quiet
        among = simulation.run(
            Experiment(
                STEPS, 0.1, parameters=COARSE, record=["i_motor", "acquisition.y_a", "acquisition.y_tau"], **LONG
            )
        )
        assert simulation.counters == quiet
    assert alone.signals["i_motor"].tobytes() == among.signals["i_motor"].tobytes()
    assert np.ptp(among.signals["acquisition.y_a"]) > 0


def test_the_bench_is_recorded_with_12_bits_averaged_current_and_the_encoders_speed() -> None:
    """Every reading is one of the converter's, 10/4096 V; the current's mean is that of the instant value."""
    names = ["i_motor", "w_motor", "y_a", "v_set", "motor_bldc.i"]
    t = np.array([0.0, 0.5, 1.5])
    ramp = Inputs(t, {"v_command": np.array([0.0, 6.0, 6.0])})
    signals = simulate(load_system("joint_no_load_recorded"), Experiment(ramp, 1.5, record=names)).signals
    per_volt = {"i_motor": 1.0, "w_motor": 4 / (6000 * 2 * np.pi / 60), "y_a": 1.0, "v_set": 0.5}
    for name, k in per_volt.items():
        steps = k * signals[name] / (10 / 4096)
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6, err_msg=name)
        assert np.ptp(signals[name]) > 0, name
    late = signals["motor_bldc.i"][800:]  # behind the ramp's end
    filtered = signals["i_motor"][800:]
    assert np.std(filtered) < np.std(late) or np.std(late) < 10 / 4096
    assert np.mean(filtered) == pytest.approx(np.mean(late), abs=2 * 10 / 4096)
    assert signals["w_motor"][-1] == pytest.approx(6 / 0.0232, rel=0.05)
