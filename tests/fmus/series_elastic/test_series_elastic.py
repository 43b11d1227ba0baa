"""The series elastic element alone, against closed forms, and in the torque sensor's place."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cobot_joint.scenario.model import load_scenario
from cobot_joint.scenario.options import Options
from cobot_joint.scenario.run import run_scenario
from cobot_joint.units import find_fmu

Make = Callable[..., Any]

C, D = 150.0, 0.05


@pytest.mark.parametrize("sign", [1, -1])
def test_torque_is_that_of_spring_damper_hardening_and_stop(make: Make, sign: int) -> None:
    spring = make("series_elastic", {"phi_o": 0.3, "phi_p": 0.3 - sign * 0.1, "w_o": 2.0, "w_p": 0.5})
    assert spring["tau_s"] == pytest.approx(sign * 0.1 * C + 1.5 * D, rel=1e-12)
    assert not spring["at_stop"]
    hard = make("series_elastic", {"phi_o": sign * 0.1, "stiffness_hardening.h": 20.0})
    assert hard["tau_s"] == pytest.approx(sign * C * 0.1 * (1 + 20 * 0.01), rel=1e-12)
    beyond = make("series_elastic", {"phi_o": sign * 0.21})
    assert beyond["tau_s"] == pytest.approx(sign * (0.21 * C + 0.01 * 2e4), rel=1e-9)
    assert beyond["at_stop"]


def test_reading_is_the_deflection_that_the_encoder_counts(make: Make) -> None:
    e, counts = 0.01234, 4096
    coarse = make("series_elastic", {"phi_o": e, "reading.counts": counts, "reading.c_r": 140.0})
    q = 2 * np.pi / counts
    assert coarse["tau_reading"] == pytest.approx(140.0 * q * round(e / q), rel=1e-12)
    assert make("series_elastic", {"phi_o": e})["tau_reading"] == pytest.approx(C * e, rel=1e-12)


def test_offset_is_read_without_a_deflection_and_is_no_torque(make: Make) -> None:
    zero = make("series_elastic", {"offset.tau_0": 0.7})
    assert (zero["tau_reading"], zero["tau_s"]) == (0.7, 0.0)


def test_what_the_spring_takes_in_a_cycle_is_the_dampers(make: Make) -> None:
    """pi d omega A^2 per period"""
    A, omega = 0.05, 40.0
    spring = make("series_elastic", {"stiffness_hardening.h": 30.0}, tolerance=1e-9)
    period = 2 * np.pi / omega
    signals = {"phi_o": lambda t: A * np.sin(omega * t), "w_o": lambda t: A * omega * np.cos(omega * t)}
    run = spring.run(2 * period, period / 2000, ["W_in"], signals)
    assert run["W_in"][-1] - run["W_in"][2000] == pytest.approx(np.pi * D * omega * A**2, rel=1e-3)


def test_it_takes_the_torque_sensor_s_place_in_the_bench(tmp_path: Path) -> None:
    swap = Options(units={"torque_sensor": str(find_fmu("series_elastic.fmu"))})
    report = run_scenario(load_scenario("load_mr_brake", {"stop_time": "5"}), tmp_path, swap)
    signals = {row[0]: row[1:] for row in report.tables[0].rows}
    assert signals["tau_sensor [N.m]"][1] > 0.3
    residuals = [value for name, value in report.values.items() if "torque_sensor" in name]
    assert residuals
    assert max(residuals) < 1e-4
