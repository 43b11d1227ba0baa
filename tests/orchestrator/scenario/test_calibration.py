"""The bench's two calibrations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cobot_joint.errors import UserError
from cobot_joint.results.result import Result
from cobot_joint.scenario.calibration import settled, staircase
from cobot_joint.scenario.model import Arm, load_scenario
from cobot_joint.scenario.options import Options
from cobot_joint.scenario.run import run_scenario


def test_arm_gives_the_torque_of_eq_3_2() -> None:
    arm = Arm(m_r=0.25, d=0.25, l=0.5, g=10.0)
    assert arm.torque(1.2) == pytest.approx(10 * (0.25 * 0.25 + 1.2 * 0.5))


def test_torque_calibration_finds_the_line_of_eq_3_3(tmp_path: Path) -> None:
    values = run_scenario(load_scenario("torque_calibration"), tmp_path, Options()).values
    assert values["slope"] == pytest.approx(0.9971, abs=1e-6)
    assert values["offset [N.m]"] == pytest.approx(0.05587, abs=1e-6)
    assert 0.02 < values["rms error as read [N.m]"] < 0.056  # the thesis found 0.0504 with its own weights and scatter


def test_line_follows_the_sensor_it_was_measured_on(tmp_path: Path) -> None:
    options = Options(parameters={"torque_sensor.gain.g": "0.02", "torque_sensor.calibration.a": "1"})
    values = run_scenario(load_scenario("torque_calibration"), tmp_path, options).values
    assert values["slope"] == pytest.approx(1 / 1.02, rel=1e-5)


def test_shunt_simulates_72_percent_of_the_range(tmp_path: Path) -> None:
    values = run_scenario(load_scenario("torque_calibration"), tmp_path, Options()).values
    assert values["shunt load [%]"] == pytest.approx(100 * 1.44449 / 1.9982, rel=1e-4)  # thesis 3.1.2
    assert values["shunt load [%]"] == pytest.approx(72, abs=0.5)
    assert values["shunt output [V]"] == pytest.approx(3.6, abs=0.02)


def test_current_sensors_give_their_zero_and_slope(tmp_path: Path) -> None:
    values = run_scenario(load_scenario("current_sensor_calibration"), tmp_path, Options()).values
    step = 10 / 4096  # V, the logger's converter
    for phase in "abc":
        assert values[f"y_{phase}: zero [V]"] == pytest.approx(2.5, abs=step / 2)
        assert values[f"y_{phase}: slope [V/A]"] == pytest.approx(0.185, rel=1e-3)
    readings = pq.read_table(tmp_path / "signals.parquet")["y_a [V]"].to_numpy() / step
    np.testing.assert_allclose(readings, np.round(readings), atol=1e-9)


def test_staircase_is_read_where_it_has_settled() -> None:
    time, value = staircase(np.array([1.0, -2.0]), 0.5)
    t = np.arange(1001) * 1e-3
    result = Result(t, {"y": np.interp(t, time, value)}, {}, "none", 1e-3)
    np.testing.assert_allclose(settled(result, "y", 2, 0.5), [1, -2])


def test_transfer_function_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="only frequency_response has it"):
        run_scenario(load_scenario("torque_calibration"), tmp_path, Options(level="transfer_function"))
