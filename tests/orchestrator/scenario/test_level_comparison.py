"""The thesis's tests at every level, and its figures beside ours."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from cobot_joint import paths
from cobot_joint.errors import UserError
from cobot_joint.scenario.level_comparison import by_part
from cobot_joint.scenario.model import load_scenario
from cobot_joint.scenario.options import Options
from cobot_joint.scenario.run import run_scenario


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Path]:
    """The no-load test of scenario `thesis` alone, to 5 s: (report, folder)."""
    out = tmp_path_factory.mktemp("thesis")
    scenario = load_scenario("thesis")
    test = scenario.tests[0].model_copy(update={"stop_time": 5.0})
    phases = scenario.phases.model_copy(update={"begin": 4.9, "end": 4.94})
    scenario = scenario.model_copy(update={"tests": [test], "also": [], "phases": phases})
    return run_scenario(scenario, out, Options()), out


def test_errors_are_split_where_the_transient_ends() -> None:
    time = np.arange(10) * 0.1
    error = np.where(time < 0.4, 2.0, 1.0)
    found = by_part(time, error, 0.4)
    assert found == pytest.approx({"transient": 2.0, "steady": 1.0, "combined": np.sqrt((4 * 4 + 6) / 10)})


def test_printed_parts_agree_with_the_printed_whole_where_the_transient_ends_as_assumed() -> None:
    """4.1 and 4.2: combined^2 = p*transient^2 + (1 - p)*steady^2 gives p, the share of the transient's samples."""
    scenario = load_scenario("thesis")
    test = scenario.tests[0]
    p = test.transient / test.stop_time
    for row in [r for r in scenario.reported if r.test == test.name]:
        for printed in row.errors.values():
            whole = np.sqrt(p * printed["transient"] ** 2 + (1 - p) * printed["steady"] ** 2)
            assert whole == pytest.approx(printed["combined"], rel=0.015)


def test_every_figure_of_the_thesis_has_a_row() -> None:
    given = tomllib.loads((paths.folder("scenarios") / "thesis.toml").read_text())
    tests, levels = {test["name"] for test in given["tests"]}, set(given["levels"])
    assert all(row["test"] in tests and row["level"] in levels for row in given["reported"])


def test_the_speed_of_every_level_agrees_with_the_bench_but_for_friction_and_noise(short: tuple[Any, Path]) -> None:
    """of the bench: white noise, the converter's steps, and counts of the encoder per ms through the drive's filter"""
    report, _ = short
    a, count = 1 - np.exp(-1e-3 / 0.005), 2 * np.pi / 2000 / 1e-3  # of the filter; rad/s of one count
    steps = np.array([10 / 4096 / 0.006366197723675814, count * a * np.sqrt(2 / (2 - a))]) / np.sqrt(12)
    noise = np.linalg.norm([0.3, *steps]) / (338 / 3)  # rad/s at the output
    value = {
        level: report.values[f"no load, {level}: speed, steady [rad/s]"] for level in ("averaged", "comprehensive")
    }
    assert value["comprehensive"] == pytest.approx(noise, rel=0.1)
    assert noise < value["averaged"] < 0.0088  # the thesis's distance from its measurement, without load


def test_the_table_has_the_thesis_s_figures_beside_what_is_simulated_and_says_which_is_which(
    short: tuple[Any, Path],
) -> None:
    (table,) = short[0].tables
    assert "simulated bench" in table.title
    assert list(table.headers) == ["level", "part", "current [A]", "thesis [A]", "speed [rad/s]", "thesis [rad/s]"]
    assert [(row[1], row[3], row[5]) for row in table.rows[:3]] == [
        ("transient", 0.0162, 0.013),
        ("steady", 7.3559e-4, 0.0038),
        ("combined", 0.0105, 0.0088),
    ]


def test_series_of_bench_and_levels_are_on_one_clock(short: tuple[Any, Path]) -> None:
    table = pq.read_table(short[1] / "signals.parquet")
    assert table.column_names == ["time [s]", "current_bench [A]", "speed_bench [rad/s]"] + [
        f"{name}_{level} [{unit}]"
        for level in ("averaged", "simscape", "comprehensive")
        for name, unit in {"current": "A", "speed": "rad/s"}.items()
    ]
    assert np.allclose(np.diff(table["time [s]"].to_numpy()), 1e-3)


def test_phase_currents_are_drawn_of_every_level(short: tuple[Any, Path]) -> None:
    (phases,) = [p for p in short[0].pictures if "phase" in p.what]
    assert [panel.y_label for panel in phases.panels] == ["i_a [A]", "i_b [A]", "i_c [A]"]
    curves = {curve.label: curve for curve in phases.panels[0].curves}
    assert set(curves) == {"DC equivalent", "Simscape", "comprehensive"}
    assert np.ptp(curves["Simscape"].y) > 0.3  # + and - the no-load current, six steps a turn
    assert np.all(phases.panels[0].curves[0].x >= 4.9)


def test_a_level_is_refused_where_all_are_run(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="which runs averaged, simscape, comprehensive"):
        run_scenario(load_scenario("thesis"), tmp_path, Options(level="averaged"))


@pytest.mark.long
def test_run_thesis_has_every_table_of_chapters_3_and_4_that_can_be_computed(tmp_path: Path) -> None:
    titles = [table.title for table in run_scenario(load_scenario("thesis"), tmp_path, Options()).tables]
    for of in ("no load", "MR brake, four grips", "eight grips", "current_sensor_calibration: ACS712 per phase",
               "torque_calibration: line", "torque_calibration: shunt check", "frequency_response: K/(1 + s/omega_c)",
               "frequency_response: amplitude of the speed"):  # fmt: skip
        assert any(title.startswith(of) for title in titles), of
