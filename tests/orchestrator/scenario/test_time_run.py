"""Runs over time: files, columns, levels, memory."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cobot_joint.errors import UserError
from cobot_joint.results.files import read_provenance
from cobot_joint.scenario.model import load_scenario
from cobot_joint.scenario.options import Options
from cobot_joint.scenario.run import run_scenario
from cobot_joint.scenario.time_run import Digest

COLUMNS = [
    "time [s]", "v_command [V]", "i_brake [A]", "tau_hold [N.m]", "i_motor [A]", "w_motor [rad/s]", "phi_motor [rad]",
    "tau_gear [N.m]", "tau_sensor [N.m]", "w_pulley [rad/s]", "phi_pulley [rad]", "w_brake [rad/s]", "tau_belt [N.m]",
]  # fmt: skip


def run(name: str, out: Path, stop_time: float | None = None, options: Options | None = None) -> pa.Table:
    scenario = load_scenario(name, {"stop_time": str(stop_time)} if stop_time else None)
    run_scenario(scenario, out, options or Options())
    return pq.read_table(out / "signals.parquet")


@pytest.mark.parametrize("name", ["load_mr_brake", "no_load"])
def test_signals_have_the_references_columns(name: str, tmp_path: Path) -> None:
    assert run(name, tmp_path, 0.1).column_names == COLUMNS


def test_columns_behind_the_gearhead_are_zero_without_load(tmp_path: Path) -> None:
    table = run("no_load", tmp_path, 2.0)
    assert all(not table[name].to_numpy().any() for name in COLUMNS[8:])
    assert table["w_motor [rad/s]"].to_numpy()[-1] > 100


def test_signals_follow_the_reference(tmp_path: Path, shared: Path) -> None:
    table, reference = run("load_mr_brake", tmp_path), pq.read_table(shared / "reference/load_mr_brake.parquet")
    limits = {"i_motor [A]": 4e-4, "w_motor [rad/s]": 0.03, "tau_sensor [N.m]": 5e-4}
    for name, limit in limits.items():
        difference = table[name].to_numpy() - reference[name].to_numpy()
        assert np.sqrt(np.mean(difference**2)) < limit, name


def test_run_leaves_pictures_and_a_summary(tmp_path: Path) -> None:
    report = run_scenario(load_scenario("no_load", {"stop_time": "0.1"}), tmp_path, Options())
    assert {p.name for p in report.files} == {"signals.parquet", "signals.html", "signals.png", "summary.json"}
    assert all(path.stat().st_size > 0 for path in report.files)


def test_a_page_stands_alone(tmp_path: Path) -> None:
    run_scenario(load_scenario("no_load", {"stop_time": "0.1"}), tmp_path, Options())
    page = (tmp_path / "signals.html").read_text(encoding="utf-8")
    assert "Plotly.newPlot" in page
    assert re.findall(r"<(?:script|link|img)[^>]*(?:src|href)=", page) == []


def test_run_says_where_it_comes_from(tmp_path: Path) -> None:
    options = Options(scheme="jacobi", step=1e-4, parameters={"motor_bldc.winding.R": "0.22"})
    run("load_mr_brake", tmp_path, 0.1, options)
    facts = read_provenance(tmp_path / "signals.parquet")
    assert (facts["scenario"], facts["scheme"], facts["step"]) == ("load_mr_brake", "jacobi", 1e-4)
    assert facts["parameters"] == {"motor_bldc.winding.R": 0.22}
    assert set(facts["fmus"]) == {"motor_bldc", "planetary_gear", "torque_sensor", "mr_brake_belt"}
    assert all(unit["guid"] for unit in facts["fmus"].values())
    assert len(facts["energy"]) == 3


def test_parameter_that_is_set_changes_the_run(tmp_path: Path) -> None:
    doubled = Options(parameters={"motor_bldc.friction.tau_C": "2.4e-3"})
    currents = [run("no_load", tmp_path, 3.0, o)["i_motor [A]"].to_numpy()[-1] for o in (Options(), doubled)]
    # tau_C of the motor at constant acceleration: i rises by 1.2e-3/k
    assert currents[1] - currents[0] == pytest.approx(1.2e-3 / 0.0232, rel=0.01)


def test_level_sets_every_unit_that_has_it(tmp_path: Path) -> None:
    run("load_mr_brake", tmp_path, 0.01, Options(level="simscape"))
    facts = read_provenance(tmp_path / "signals.parquet")
    assert facts["parameters"]["motor_bldc.motor.level"] == 2


def test_three_phases_average_to_the_averaged_motor_without_load(tmp_path: Path) -> None:
    mean = {}
    for level in ("averaged", "simscape", "foc", "switching"):
        table = run("no_load", tmp_path, 5.0, Options(level=level))
        mean[level] = [table[name].to_numpy()[4500:].mean() for name in ("i_motor [A]", "w_motor [rad/s]")]
    np.testing.assert_allclose(mean["simscape"], mean["averaged"], rtol=0.01)
    np.testing.assert_allclose(mean["foc"], mean["averaged"], rtol=1e-4)
    # i is seen at points of its ripple
    assert mean["switching"][1] == pytest.approx(mean["averaged"][1], rel=1e-3)


def test_transfer_function_is_refused_where_it_does_not_hold(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="only frequency_response has it"):
        run("no_load", tmp_path, 0.1, Options(level="transfer_function"))


def test_unknown_level_is_refused_with_the_allowed_ones() -> None:
    with pytest.raises(
        UserError,
        match="'simple' is given, transfer_function, averaged, simscape, comprehensive, foc, switching is allowed",
    ):
        Options(level="simple")


def test_digest_in_pieces_is_the_digest_of_the_whole() -> None:
    rng = np.random.default_rng(1)
    time, x = np.arange(1000) * 1e-3, rng.normal(size=1000)
    digest = Digest(stride=7)
    for piece in np.split(np.arange(1000), [13, 14, 400, 401]):
        digest.take(time[piece], {"x": x[piece]})
    np.testing.assert_array_equal(digest.drawn()[1]["x"], x[::7])
    np.testing.assert_array_equal(digest.drawn()[0], time[::7])
    row = digest.rows({"x": "V"})[0]
    np.testing.assert_allclose(row[1:], [x.min(), x.max(), x.mean(), np.sqrt(np.mean(x**2))])
    assert row[0] == "x [V]"


@pytest.mark.long
def test_memory_does_not_grow_with_the_run(tmp_path: Path) -> None:
    def peak(stop_time: float) -> float:
        """MB"""
        call = [sys.executable, "-m", "cobot_joint", "run", "load_mr_brake", "--out", str(tmp_path)]
        process = subprocess.Popen([*call, "--set", f"stop_time={stop_time}"], cwd=tmp_path, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        assert status == 0
        return usage.ru_maxrss / 1024

    assert peak(900) - peak(60) < 50
