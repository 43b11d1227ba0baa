"""Any scenario by its kind."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from orchestrator.results import write_text
from orchestrator.scenario.options import Options
from orchestrator.scenario.report import Progress, Report


def run_scenario(scenario: Any, out: Path, options: Options, progress: Progress | None = None) -> Report:
    """Run a loaded scenario into `out`: signals.parquet, pictures, summary.json. UserError: what a person got wrong."""
    report = _runner(scenario.kind)(scenario, out, options, progress)
    summary = out / "summary.json"
    write_text(summary, json.dumps({"scenario": scenario.name, **report.values}, indent=1) + "\n")
    report.files[summary] = "figures by name"
    return report


def _runner(kind: str) -> Callable[..., Report]:
    """Imported when needed: what draws and fits takes longer to import than a short run takes."""
    if kind == "time":
        from orchestrator.scenario.time_run import run_over_time as runner
    elif kind == "frequency_response":
        from orchestrator.scenario.frequency_response import run_frequency_response as runner
    elif kind == "torque_calibration":
        from orchestrator.scenario.calibration import run_torque_calibration as runner
    else:
        from orchestrator.scenario.calibration import run_current_sensor_calibration as runner
    return runner
