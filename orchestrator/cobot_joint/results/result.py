"""What a run recorded, to be looked at, computed with, or handed to pandas and xarray."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cobot_joint.errors import UserError

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure


def library(name: str, wanted_by: str, extra: str = "notebook") -> Any:
    """A library that only some callers want, of that extra. UserError: it is not installed, and how it is."""
    try:
        return import_module(name)
    except ImportError as error:
        raise UserError(
            f"{wanted_by}: {name} is not installed, `pip install cobot-joint[{extra}]` brings it"
        ) from error


@dataclass
class Result:
    """What a run recorded.

    time        float64[m], s
    signals     name -> float64[m], in the unit that `units` gives
    energy      mechanical connection -> (work given, work taken, integral of |power given|), J; each unit at its port
    scheme      of coupling
    step        s, of communication; of an adaptive scheme the longest
    units       signal -> unit as FMI spells it, None where nothing is said
    provenance  of a result from a file: versions, FMUs, parameters
    """

    time: NDArray[np.float64]
    signals: dict[str, NDArray[np.float64]]
    energy: dict[str, tuple[float, float, float]]
    scheme: str
    step: float
    units: Mapping[str, str | None] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """The signal of that name: float64[m]. KeyError: there is none."""
        if name not in self.signals:
            raise KeyError(f"no signal {name!r} was recorded, there are {', '.join(self.signals)}")
        return self.signals[name]

    def energy_residual(self, connection: str) -> float:
        """(given - taken) / integral of |power given| of a mechanical connection; 0 where no power flowed."""
        given, taken, absolute = self.energy[connection]
        return (given - taken) / absolute if absolute else 0.0

    def plot(self, *names: str) -> Figure:
        """The named signals over time, or all of them: a matplotlib figure with panels by unit and size.

        KeyError: a signal that was not recorded.
        """
        from matplotlib import pyplot

        from cobot_joint.results.figures import Picture, over_time
        from cobot_joint.results.png import still

        panels = over_time(self.time, {name: self[name] for name in names or self.signals}, self.units)
        return still(Picture(Path(), "", "", "time [s]", panels), pyplot.figure())

    def to_pandas(self) -> pandas.DataFrame:
        """Signals as columns over an index `time`, units in `attrs`. UserError: pandas is not installed."""
        pandas = library("pandas", "to_pandas")
        frame = pandas.DataFrame(self.signals, index=pandas.Index(self.time, name="time"))
        frame.attrs["units"] = {"time": "s", **self.units}
        return frame

    def to_xarray(self) -> xarray.Dataset:
        """Signals over the dimension `time`, each with its unit as attribute. UserError: xarray is not installed."""
        xarray = library("xarray", "to_xarray")
        signals = {name: ("time", x, {"units": self.units.get(name) or "1"}) for name, x in self.signals.items()}
        return xarray.Dataset(signals, {"time": ("time", self.time, {"units": "s"})}, {"scheme": self.scheme})

    def _repr_html_(self) -> str:
        """Extremes, mean and rms of every signal, for notebooks."""
        rows = [
            f"<tr><td>{escape(name)} [{escape(self.units.get(name) or '1')}]</td>"
            + "".join(f"<td>{value:.5g}</td>" for value in (x.min(), x.max(), x.mean(), np.sqrt(np.mean(x**2))))
            + "</tr>"
            for name, x in self.signals.items()
        ]
        head = "<tr><th>signal</th><th>min</th><th>max</th><th>mean</th><th>rms</th></tr>"
        title = f"{self.time[0]:g} s to {self.time[-1]:g} s, {len(self.time)} rows, scheme {escape(self.scheme)}"
        return f"<table><caption>{title}</caption>{head}{''.join(rows)}</table>"
