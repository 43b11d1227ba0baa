"""The monolithic loops against the reference solutions, closed forms and themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from benchmarks.monolith import COLUMNS, INPUTS, Setup, Table, averaged, three_phase

R, K = 0.209, 0.0232


def reference(shared: Path, scenario: str) -> dict[str, Table]:
    table = pyarrow.parquet.read_table(shared / "reference" / f"{scenario}.parquet")
    return {name.split(" ")[0]: np.asarray(table[name]) for name in table.column_names}


def rms(difference: Table) -> float:
    return float(np.sqrt(np.mean(difference**2)))


def steady(v: float, tau: float, duration: float = 3.0) -> Table:
    """Inputs that reach v [V] and then the torque tau [N.m] on the rotor within a second, 1 kHz."""
    time = np.arange(round(duration * 1e3) + 1) * 1e-3
    zero = np.zeros_like(time)
    return np.stack([v * np.clip(2 * time, 0, 1), zero, tau * np.clip(2 * time - 1, 0, 1)], axis=1)


@pytest.mark.parametrize("scenario", ["load_mr_brake", "load_hand", "reversals"])
def test_averaged_loop_at_20_us_meets_the_reference_of_the_loaded_bench(shared: Path, scenario: str) -> None:
    expected = reference(shared, scenario)
    results = averaged(np.stack([expected[name] for name in INPUTS], axis=1), 20e-6)
    limits = dict.fromkeys(COLUMNS, 2e-5)  # the largest, 1.3e-5 N.m, is tau_gear of reversals
    assert {name: rms(results[name] - expected[name]) < limits[name] for name in COLUMNS} == dict.fromkeys(
        COLUMNS, True
    )


def test_averaged_loop_at_1_us_meets_the_reference_of_the_no_load_bench(shared: Path) -> None:
    expected = reference(shared, "no_load")
    results = averaged(np.stack([expected[name] for name in INPUTS], axis=1), 1e-6, Setup.NO_LOAD)  # impacts need it
    assert rms(results["i_motor"] - expected["i_motor"]) < 2e-6
    assert rms(results["w_motor"] - expected["w_motor"]) < 2e-5
    assert not np.any(results["w_pulley"])


def test_averaged_motor_alone_rests_where_torques_balance() -> None:
    results = averaged(steady(12.0, 0.05), 20e-6, Setup.MOTOR_ALONE)
    i, w = results["i_motor"][-1], results["w_motor"][-1]
    assert i * R + K * w == pytest.approx(12.0, abs=1e-9)
    assert K * i == pytest.approx(0.05 + 1.2e-3 * np.tanh(w) + 7.5e-6 * w, abs=1e-9)


def test_located_events_converge_where_the_fixed_step_does_not() -> None:
    inputs = steady(12.0, 0.05, duration=1.5)
    fine = three_phase(inputs, 5e-6, Setup.MOTOR_ALONE, locate=True)
    coarse = three_phase(inputs, 20e-6, Setup.MOTOR_ALONE, locate=True)
    crawl = three_phase(inputs, 1e-6, Setup.MOTOR_ALONE)
    assert rms(coarse["i_a"] - fine["i_a"]) < 5e-6
    assert 1e-4 < rms(crawl["i_a"] - fine["i_a"]) < 5e-2


def test_three_phases_sum_to_zero_and_one_floats() -> None:
    results = three_phase(steady(12.0, 0.05), 50e-6, Setup.MOTOR_ALONE, locate=True)
    phases = np.stack([results[name] for name in ("i_a", "i_b", "i_c")])
    assert np.max(np.abs(phases.sum(axis=0))) < 1e-12
    floating = np.mean(np.min(np.abs(phases), axis=0) == 0.0)
    assert floating > 0.8  # freewheeling takes the rest of the time


@pytest.mark.parametrize("v", [12.0, -12.0])
def test_three_phase_motor_averages_to_the_dc_motor_within_1_percent_up_to_4_a(v: float) -> None:
    w = (abs(v) - R * 4.0) / K
    tau = np.sign(v) * (K * 4.0 - 1.2e-3 - 7.5e-6 * w)  # a load that takes 4 A
    results = three_phase(steady(v, tau), 50e-6, Setup.MOTOR_ALONE, locate=True)
    current, speed = (float(results[name][-1] - results[name][-1001]) for name in ("charge", "phi_motor"))
    assert current == pytest.approx(np.sign(v) * 4.0, rel=0.01)
    assert speed == pytest.approx(np.sign(v) * w, rel=0.01)


def test_a_step_that_does_not_divide_the_sample_is_refused() -> None:
    with pytest.raises(ValueError, match="whole parts of the sample"):
        averaged(np.zeros((2, 3)), 3e-4)
