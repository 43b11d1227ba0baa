"""Any scenario by its kind."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import Any

from cobot_joint.results.draw import Stills, draw
from cobot_joint.results.figures import write_html
from cobot_joint.results.files import write_text
from cobot_joint.scenario.options import Options
from cobot_joint.scenario.report import Progress, Report

# kind -> module and function, imported when needed: what draws and fits takes longer to import than a short run takes
RUNNERS = {
    "time": ("time_run", "run_over_time"),
    "frequency_response": ("frequency_response", "run_frequency_response"),
    "torque_calibration": ("calibration", "run_torque_calibration"),
    "current_sensor_calibration": ("calibration", "run_current_sensor_calibration"),
    "levels": ("level_comparison", "run_level_comparison"),
}


def run_scenario(
    scenario: Any, out: Path, options: Options, progress: Progress | None = None, stills: Stills | None = None
) -> Report:
    """Run a loaded scenario into `out`: signals.parquet, pictures, summary.json. `stills`: draws the PNGs meanwhile.

    UserError: a name, value or file that is wrong. SimulationError: a unit fails.
    """
    module, function = RUNNERS[scenario.kind]
    runner = getattr(import_module(f"cobot_joint.scenario.{module}"), function)
    report: Report = runner(scenario, out, options, progress)
    for picture in report.pictures:
        if stills:
            stills.draw(picture)
            write_html(picture)
        else:
            draw(picture)
        report.files |= picture.files
    summary = out / "summary.json"
    write_text(summary, json.dumps({"scenario": scenario.name, **report.values}, indent=1) + "\n")
    report.files[summary] = "figures by name"
    return report
