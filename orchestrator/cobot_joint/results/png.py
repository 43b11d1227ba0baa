"""Pictures as PNG. As a program: draws those that arrive pickled on its standard input (`draw.Stills` starts it)."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cobot_joint.results.figures import Curve, Picture

COLUMNS = 1000  # about as many as a panel has pixels side by side
LETTER = 0.0072  # of the picture's width


def write_png(picture: Picture) -> Path:
    """`stem`.png"""
    path = picture.stem.with_suffix(".png")
    path.parent.mkdir(parents=True, exist_ok=True)
    still(picture).savefig(path, dpi=110)
    return path


def still(picture: Picture, figure: Figure | None = None) -> Figure:
    """On a figure of its own, or on the given one."""
    height = 1 + 2.4 * len(picture.panels)  # inches
    figure = figure or Figure()
    figure.set_size_inches(10, height)
    # as constrained layout would do it, which draws everything twice
    right = 0.945 - LETTER * max(len(c.label) for panel in picture.panels for c in panel.curves)
    figure.subplots_adjust(left=0.08, right=right, bottom=0.55 / height, top=1 - 0.45 / height, hspace=0.1)
    figure.suptitle(picture.title, y=1 - 0.1 / height)
    axes = np.atleast_1d(figure.subplots(len(picture.panels), 1, sharex=True))
    colours = picture.colours
    for axis, panel in zip(axes, picture.panels, strict=True):
        for curve in panel.curves:
            form = {"line": "-", "dashed": "--", "markers": "o"}[curve.style]
            colour = curve.colour or colours[curve.label]
            axis.plot(*_seen(curve), form, ms=4, lw=1.2, color=colour, label=curve.label or "_not in the legend")
        axis.set_ylabel(panel.y_label)
        axis.grid(alpha=0.3)
        axis.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
        if picture.x_log:
            axis.set_xscale("log")
    axes[-1].set_xlabel(picture.x_label)
    return figure


def _seen(curve: Curve) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of a line with many more points than the picture has columns of pixels: the extremes per column."""
    each = len(curve.x) // COLUMNS
    if each < 4 or curve.style == "markers":
        return curve.x, curve.y
    n = len(curve.x) // each * each
    start = np.arange(0, n, each)
    blocks = curve.y[:n].reshape(-1, each)
    ends = np.sort([start + blocks.argmin(axis=1), start + blocks.argmax(axis=1)], axis=0).T.ravel()
    kept = np.unique(np.concatenate([ends, [0, len(curve.x) - 1]]))
    return curve.x[kept], curve.y[kept]


def main() -> None:
    """Until standard input ends."""
    FigureCanvasAgg(Figure()).draw()  # while the caller is still busy: fonts are looked up
    while True:
        try:
            write_png(pickle.load(sys.stdin.buffer))
        except EOFError:
            return


if __name__ == "__main__":
    main()
