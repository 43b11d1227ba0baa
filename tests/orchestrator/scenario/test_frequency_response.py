"""The frequency response: amplitudes from series, the thesis's numbers, Table C.1 beside them."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from cobot_joint.errors import UserError
from cobot_joint.results.draw import draw
from cobot_joint.scenario.frequency_response import (
    Series,
    fit_first_order,
    log_misfit,
    read_table,
    respond,
    run_frequency_response,
    stop_time,
    sweep,
    variant_system,
)
from cobot_joint.scenario.model import load_scenario
from cobot_joint.scenario.options import Options
from cobot_joint.scenario.report import Report

Calls = list[tuple[float, float]]
FORMULA = Options(level="transfer_function")


@pytest.fixture
def scenario() -> Any:
    return load_scenario("frequency_response")


@pytest.fixture(scope="module")
def with_units(tmp_path_factory: pytest.TempPathFactory) -> tuple[Report, Path]:
    """The shipped scenario, co-simulated: its report and its folder."""
    out = tmp_path_factory.mktemp("frequency_response")
    return run_frequency_response(load_scenario("frequency_response"), out, Options(), None), out


@pytest.fixture(scope="module")
def with_formula(tmp_path_factory: pytest.TempPathFactory) -> tuple[Report, Calls]:
    """The shipped scenario at the level of the transfer function: its report, and what it said of its progress."""
    calls: Calls = []
    out = tmp_path_factory.mktemp("transfer_function")
    report = run_frequency_response(
        load_scenario("frequency_response"), out, FORMULA, lambda done, total: calls.append((done, total))
    )
    return report, calls


def amplitude(scenario: Any, omega: float, options: Options) -> float:
    """rad/s, first variant"""
    variant = scenario.variants[0]
    system = variant_system(scenario, variant, options, "here")
    (series,) = sweep(scenario, variant, system, options, np.array([omega]))
    return respond(series, scenario.settle).fundamental


def test_table_c1_has_its_29_frequencies(shared: Path) -> None:
    table = load_scenario("frequency_response").path.parent / "table_c1.csv"
    omega, measured = read_table(table)
    assert (len(omega), omega[0], omega[-1]) == (29, 0.1, 100)
    np.testing.assert_array_equal(
        (omega, measured), read_table(shared / "recordings/real/thesis_table_c1/table_c1.csv")
    )


def test_amplitude_and_phase_of_a_known_series_are_found() -> None:
    t = np.linspace(0, 10, 2001)
    w = 3 * np.sin(2 * t - 0.7) + 5 + 100 * np.exp(-10 * t)
    found = respond(Series(2.0, t, t, t, w), settle=4.0)
    assert found.fundamental == pytest.approx(3, rel=1e-6)
    assert found.phase == pytest.approx(-0.7, abs=1e-6)
    assert found.half_swing == pytest.approx(3, rel=1e-4)


def test_first_order_fit_finds_what_made_the_amplitudes() -> None:
    omega = np.geomspace(0.1, 100, 29)
    fit = fit_first_order(omega, 1289.0 / np.hypot(1, omega / 2.59))
    assert (fit.K, fit.omega_c) == (pytest.approx(1289), pytest.approx(2.59))
    assert fit.gain == pytest.approx(62.205, abs=1e-3)


def test_misfit_is_the_rms_of_the_log_ratio() -> None:
    assert log_misfit(np.array([np.e, 1.0]), np.array([1.0, np.e])) == pytest.approx(1)


@pytest.mark.parametrize("omega", [0.3, 2.6, 100.0])
def test_transfer_functions_series_has_the_amplitude_of_eq_4_6(scenario: Any, omega: float) -> None:
    # eq. 4.6 as it is meant, 232/(0.0695 s + 0.18); printed with 2.32, 40 dB too low
    assert amplitude(scenario, omega, FORMULA) == pytest.approx(0.3 * 232 / abs(0.0695j * omega + 0.18), rel=1e-4)


def test_transfer_function_reproduces_gain_and_cut_off_of_the_thesis(with_formula: tuple[Report, Calls]) -> None:
    values = with_formula[0].values
    assert values["thesis fit: gain [dB]"] == pytest.approx(62.17, rel=0.01)
    assert values["thesis fit: cut-off [rad/s]"] == pytest.approx(2.59, rel=0.01)
    assert values["thesis fit: misfit, rms of log ratio [%]"] == pytest.approx(16.4, abs=0.1)  # the thesis's own misfit
    assert values["catalogue: cut-off [rad/s]"] == pytest.approx(0.18 / 0.0631, rel=0.01)  # eq. 4.7


def test_units_reproduce_gain_and_cut_off_of_the_thesis(with_units: tuple[Report, Path]) -> None:
    values = with_units[0].values
    assert values["thesis fit: gain [dB]"] == pytest.approx(62.17, rel=0.01)
    assert values["thesis fit: cut-off [rad/s]"] == pytest.approx(2.59, rel=0.01)
    assert values["catalogue: cut-off [rad/s]"] == pytest.approx(0.18 / 0.0631, rel=0.01)


def test_misfit_per_frequency_stands_beside_the_measured_amplitude(with_units: tuple[Report, Path]) -> None:
    with (with_units[1] / "frequency_response.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 29
    for row in rows:
        ratio = float(row["simulated: thesis fit [rad/s]"]) / float(row["measured [rad/s]"])
        assert float(row["misfit: thesis fit [%]"]) == pytest.approx(100 * (ratio - 1), abs=1e-6)


def test_series_are_kept_with_their_frequency(with_units: tuple[Report, Path]) -> None:
    table = pq.read_table(with_units[1] / "signals.parquet")
    assert table.column_names == ["time [s]", "omega [rad/s]", "i_command [A]", "i_motor [A]", "w_motor [rad/s]"]
    omega = table["omega [rad/s]"].to_numpy()
    assert len(np.unique(omega)) == 29
    at = omega == 5
    t, w = table["time [s]"].to_numpy()[at], table["w_motor [rad/s]"].to_numpy()[at]
    found = respond(Series(5.0, t, t, t, w), 5.0).fundamental
    with (with_units[1] / "frequency_response.csv").open() as file:
        row = next(row for row in csv.DictReader(file) if float(row["omega [rad/s]"]) == 5)
    assert found == pytest.approx(float(row["simulated: thesis fit [rad/s]"]), rel=1e-6)


def test_bode_plot_shows_measured_simulated_and_misfit(with_units: tuple[Report, Path]) -> None:
    report, out = with_units
    written = {path.name for picture in report.pictures for path in draw(picture)}
    assert written >= {"frequency_response.html", "frequency_response.png"}
    page = (out / "frequency_response.html").read_text()
    for label in ("measured, Table C.1", "thesis fit", "catalogue", "formulas, eq. 4.6 and eq. 4.7"):
        assert label in page


def test_energy_balances_at_every_frequency(with_units: tuple[Report, Path]) -> None:
    (table,) = [t for t in with_units[0].tables if t.title == "energy"]
    assert [row[0] for row in table.rows] == ["motor_bldc.shaft -> planetary_gear.input"]
    assert all(float(row[1]) < 0.1 for row in table.rows)


def test_bias_that_follows_the_speed_cancels_friction_and_the_commanded_direction_does_not(scenario: Any) -> None:
    measured = amplitude(scenario, 10, Options())
    scenario.bias_from = "commanded_current"
    commanded = amplitude(scenario, 10, Options())
    formula = amplitude(scenario, 10, FORMULA)
    assert measured == pytest.approx(formula, rel=0.01)
    assert commanded > 1.1 * formula  # the bias leads the motion by 90 degrees and drives


def test_caller_has_the_last_word_on_parameters(scenario: Any) -> None:
    options = Options(parameters={"motor_bldc.bias.i_0": "0"})
    system = variant_system(scenario, scenario.variants[0], options, "here")
    assert system is not None
    assert system.component("motor_bldc").parameters["bias.i_0"] == 0
    assert amplitude(scenario, 10, options) < 0.75 * amplitude(scenario, 10, Options())  # friction takes its share


def test_parameters_are_refused_where_there_are_no_units(scenario: Any) -> None:
    options = Options("transfer_function", parameters={"motor_bldc.bias.i_0": "0"})
    with pytest.raises(UserError, match="which has J, B and k in here only"):
        variant_system(scenario, scenario.variants[0], options, "here")


def test_system_without_a_bias_current_is_refused(scenario: Any) -> None:
    scenario.system = "current_sensor_calibration"
    with pytest.raises(UserError, match="current_sensor_calibration has no unit with a bias current"):
        variant_system(scenario, scenario.variants[0], Options(), "here")


@pytest.mark.parametrize("text", ["omega,w\n1,2\n3", "omega,w\n1,fast", ""])
def test_table_that_is_none_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(UserError, match=r"table\.csv: a table of frequency and amplitude is needed"):
        read_table(tmp_path / "table.csv")


def test_progress_reaches_the_whole(scenario: Any, with_formula: tuple[Report, Calls]) -> None:
    done, total = with_formula[1][-1]
    assert done == pytest.approx(total)
    omegas, _ = read_table(scenario.path.parent / scenario.table)
    assert total == pytest.approx(2 * sum(stop_time(scenario, omega) for omega in omegas))


@pytest.mark.long
def test_three_phase_level_gives_the_same_response(tmp_path: Path) -> None:
    from cobot_joint.scenario.run import run_scenario

    run_scenario(load_scenario("frequency_response"), tmp_path, Options(level="simscape"))
    values = json.loads((tmp_path / "summary.json").read_text())
    assert values["thesis fit: gain [dB]"] == pytest.approx(62.17, rel=0.01)
    assert values["thesis fit: cut-off [rad/s]"] == pytest.approx(2.59, rel=0.01)
