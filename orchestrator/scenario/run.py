"""Any scenario by its kind."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from orchestrator.results import write_text
from orchestrator.scenario.calibration import run_current_sensor_calibration, run_torque_calibration
from orchestrator.scenario.frequency_response import run_frequency_response
from orchestrator.scenario.options import Options
from orchestrator.scenario.report import Progress, Report
from orchestrator.scenario.time_run import run_over_time

RUNNERS: dict[str, Any] = {
    "time": run_over_time,
    "frequency_response": run_frequency_response,
    "torque_calibration": run_torque_calibration,
    "current_sensor_calibration": run_current_sensor_calibration,
}


def run_scenario(scenario: Any, out: Path, options: Options, progress: Progress | None = None) -> Report:
    """Run a loaded scenario into `out`: signals.parquet, pictures, summary.json. UserError: what a person got wrong."""
    report: Report = RUNNERS[scenario.kind](scenario, out, options, progress)
    summary = out / "summary.json"
    write_text(summary, json.dumps({"scenario": scenario.name, **report.values}, indent=1) + "\n")
    report.files[summary] = "figures by name"
    return report
