"""The picture of error against cost."""

from pathlib import Path

import matplotlib

matplotlib.use("svg")
from matplotlib import pyplot

from benchmarks.bench import ACCURACY, SCENARIO
from benchmarks.rows_cost import Point
from benchmarks.rows_peers import DURATION

MARKS = {"ours": "o", "monolithic loop": "x"}


def draw(points: list[Point], path: Path) -> None:
    """Writes an SVG: one line per master and scheme, its steps as marks."""
    figure, axes = pyplot.subplots(figsize=(9, 6), layout="constrained")
    for who, scheme in dict.fromkeys((point.who, point.scheme) for point in points):
        line = sorted((p.seconds, p.error) for p in points if (p.who, p.scheme) == (who, scheme))
        style = "-" if who == "ours" else ":" if who in MARKS else "--"
        label = f"{who}, {scheme}"
        axes.loglog(*zip(*line, strict=True), style, marker=MARKS.get(who, "s"), markersize=4, label=label)
    axes.axhline(ACCURACY["w_motor"], color="0.7", linewidth=1)
    axes.set_xlabel(f"seconds for {DURATION:g} s of {SCENARIO}")
    axes.set_ylabel("rms error of w_motor [rad/s]")
    axes.grid(True, which="major", alpha=0.3)
    axes.legend(fontsize="small")
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)
