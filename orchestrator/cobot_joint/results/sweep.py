"""Runs over a grid of parameters, side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from html import escape
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cobot_joint.errors import UserError
from cobot_joint.results.result import Result, library

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Sweep:
    """One result per point of a grid.

    axes     `component.variable` -> float64[n], its values; the last axis varies fastest
    results  one per point, None where the run failed
    errors   index of a run that failed -> why, in one line
    """

    axes: Mapping[str, NDArray[np.float64]]
    results: list[Result | None]
    errors: Mapping[int, str] = field(default_factory=dict)

    def points(self) -> list[dict[str, float]]:
        """`component.variable` -> value, in the order of `results`."""
        return [dict(zip(self.axes, map(float, values), strict=True)) for values in product(*self.axes.values())]

    def __len__(self) -> int:
        return len(self.results)

    def __iter__(self) -> Iterator[tuple[dict[str, float], Result]]:
        """(point, result) of the runs that succeeded."""
        return ((at, result) for at, result in zip(self.points(), self.results, strict=True) if result is not None)

    def plot(self, signal: str) -> Figure:
        """That signal of every run over time: a matplotlib figure. KeyError: it was not recorded."""
        from matplotlib import pyplot

        from cobot_joint.results.figures import COLOURS

        figure, axis = pyplot.subplots(figsize=(10, 4), layout="constrained")
        axis.set_prop_cycle(color=COLOURS)
        for at, result in self:
            axis.plot(result.time, result[signal], lw=1.2, label=", ".join(f"{k} = {v:.4g}" for k, v in at.items()))
            axis.set_ylabel(f"{signal} [{result.units.get(signal) or '1'}]")
        axis.set_xlabel("time [s]")
        axis.grid(alpha=0.3)
        axis.legend(fontsize="small")
        return figure

    def to_pandas(self) -> pandas.DataFrame:
        """Signals as columns over the parameters and `time` as index. UserError: pandas is not installed."""
        pandas = library("pandas", "to_pandas")
        frames = {tuple(at.values()): result.to_pandas() for at, result in self}
        if not frames:
            raise UserError(f"to_pandas: none of {len(self)} runs succeeded; the first says: {self.errors.get(0)}")
        return pandas.concat(frames, names=[*self.axes, "time"])

    def to_xarray(self) -> xarray.Dataset:
        """Signals over the parameters and `time`; NaN where a run failed. UserError: xarray is not installed."""
        xarray = library("xarray", "to_xarray")
        shape = tuple(len(values) for values in self.axes.values())
        first = next((result for result in self.results if result is not None), None)
        if first is None:
            raise UserError(f"to_xarray: none of {len(self)} runs succeeded; the first says: {self.errors.get(0)}")
        signals = {}
        for name in first.signals:
            rows = [np.full_like(first.time, np.nan) if r is None else r[name] for r in self.results]
            attributes = {"units": first.units.get(name) or "1"}
            signals[name] = ([*self.axes, "time"], np.reshape(rows, (*shape, len(first.time))), attributes)
        return xarray.Dataset(signals, {**self.axes, "time": first.time})

    def _repr_html_(self) -> str:
        """The grid, and what failed, for notebooks."""
        axes = "".join(
            f"<tr><td>{escape(name)}</td><td>{len(x)}</td><td>{min(x):.5g}</td><td>{max(x):.5g}</td></tr>"
            for name, x in self.axes.items()
        )
        failed = "".join(f"<li>run {n}: {escape(why)}</li>" for n, why in self.errors.items())
        head = "<tr><th>parameter</th><th>values</th><th>from</th><th>to</th></tr>"
        return f"<table><caption>{len(self)} runs</caption>{head}{axes}</table><ul>{failed}</ul>"
