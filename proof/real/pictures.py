"""Before and after, as pictures for docs/proof: python proof/real/pictures.py, after cobot-joint prove proof/real."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from judge import HERE, Vector, signals
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import cobot_joint as cj
from cobot_joint.diagnosis.data.campaign import load_campaign

OUT = HERE.parents[1] / "docs" / "proof"
COLOURS = {"recorded": "black", "calibrated": "tab:orange", "repaired": "tab:blue"}
LABELS = {"recorded": "recorded", "calibrated": "re-fitted, nothing added", "repaired": "with what was named"}


def curves(axes: Axes, time: Vector, x: dict[str, Vector], channel: str, rows: Vector, factor: float = 1.0) -> None:
    """Recorded, re-fitted and repaired."""
    for source, colour in COLOURS.items():
        axes.plot(time[rows], factor * x[f"{channel}.{source}"][rows], color=colour, lw=0.9, label=LABELS[source])


def errors(axes: Axes, time: Vector, x: dict[str, Vector], channel: str, factor: float = 1.0) -> None:
    """Simulated - recorded, before and after."""
    for source in ("calibrated", "repaired"):
        error = factor * (x[f"{channel}.{source}"] - x[f"{channel}.recorded"])
        axes.plot(time, error, color=COLOURS[source], lw=0.5, label=LABELS[source])


def emps(figure: Figure) -> None:
    """Errors of position and voltage over the run with pulses."""
    _, x = signals("emps")
    top, bottom = figure.subplots(2, 1, sharex=True)
    errors(top, x["time"], x, "s", 1e6)
    errors(bottom, x["time"], x, "u")
    top.set_ylabel("position error [um]")
    bottom.set(ylabel="voltage error [V]", xlabel="time [s]")
    top.legend(loc="upper right", fontsize=8)


def xl330_pendulum(figure: Figure) -> None:
    """The four judged runs."""
    run, x = signals("xl330_pendulum")
    for axes, name in zip(figure.subplots(2, 2).flat, dict.fromkeys(run), strict=True):
        curves(axes, x["time"], x, "phi", run == name)
        axes.set_title(name, fontsize=9)
    figure.axes[0].set_ylabel("angle [rad]")
    figure.axes[2].set(ylabel="angle [rad]", xlabel="time [s]")
    figure.axes[0].legend(fontsize=7)


def ak80_9(figure: Figure) -> None:
    """Torque over the second half, and the error that is left."""
    _, x = signals("ak80_9")
    top, bottom = figure.subplots(2, 1, sharex=True)
    curves(top, x["time"], x, "torque", np.full(len(x["time"]), True))
    errors(bottom, x["time"], x, "torque")
    top.set_ylabel("torque [N.m]")
    bottom.set(ylabel="error [N.m]", xlabel="time [s]")
    top.legend(fontsize=8)


def screw_drive_1(figure: Figure) -> None:
    """Friction torque over speed: a mean per file, and both models driven through all speeds in a minute."""
    case = HERE / "screw_drive_1"
    axes, answer = figure.subplots(), json.loads((case / "diagnosis.json").read_text())
    for recording in load_campaign(case).recordings:
        held_out, tau = recording.role == "holdout", recording.outputs["tau"]
        forward = np.isfinite(tau) & (recording.inputs["w"] > 0)
        label = "recorded, held out" if held_out else "recorded, fitted"
        axes.plot(recording.inputs["w"][forward], 1e3 * tau[forward], "o", color=COLOURS["recorded"],
                  mfc="white" if held_out else None, ms=6, label=label)  # fmt: skip
    ramp = cj.Inputs(np.array([0.0, 60.0]), {"w": np.array([0.1, 21.0])})
    for source in ("calibrated", "repaired"):
        values = {name: estimate["value"] for name, estimate in answer[source].items()}
        run = cj.run(HERE / "screw_drive.ssd", cj.Experiment(ramp, 60.0), parameters=values)
        w = np.interp(run.time, [0.0, 60.0], [0.1, 21.0])
        axes.plot(w, 1e3 * run["tau"], color=COLOURS[source], lw=2, label=LABELS[source])
    axes.set(xlabel="speed [rad/s]", ylabel="friction torque [mN.m]")
    axes.legend()


def main() -> int:
    """One PNG per case that has been proved."""
    OUT.mkdir(parents=True, exist_ok=True)
    cases: tuple[Callable[[Figure], None], ...] = (emps, xl330_pendulum, ak80_9, screw_drive_1)
    for draw in cases:
        if not (HERE / draw.__name__ / "verify.parquet").is_file():
            print(f"{draw.__name__}: not proved here, no picture")
            continue
        figure = Figure(figsize=(9, 5), layout="constrained")
        draw(figure)
        figure.savefig(OUT / f"{draw.__name__}.png", dpi=80)
    table = Path(HERE / "thesis_table_c1" / "report.png")
    if table.is_file():
        shutil.copy(table, OUT / "thesis_table_c1.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
