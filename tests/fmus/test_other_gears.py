"""Gears that take the planetary gearhead's place in the bench."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cobot_joint.scenario.model import load_scenario
from cobot_joint.scenario.options import Options
from cobot_joint.scenario.run import run_scenario


@pytest.mark.parametrize(("gear", "N"), [("harmonic_drive", -100.0), ("cycloidal_drive", -59.0)])
def test_it_takes_the_planetary_gearhead_s_place_in_the_bench(
    fmu: Callable[[str], Path], gear: str, N: float, tmp_path: Path
) -> None:
    swap = Options(units={"planetary_gear": str(fmu(gear))})
    report = run_scenario(load_scenario("load_mr_brake", {"stop_time": "5"}), tmp_path, swap)
    signals = {row[0]: row[1:] for row in report.tables[0].rows}
    fastest, backwards = signals["w_motor [rad/s]"][1], signals["w_pulley [rad/s]"][0]
    assert backwards == pytest.approx(fastest / N, rel=0.02)
    residuals = [value for name, value in report.values.items() if name.startswith("energy residual planetary_gear")]
    assert residuals
    assert max(residuals) < 1e-5
