"""What `diagnose` left in a folder, to be read from Python."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cobot_joint.results.result import library

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

VARIANTS = ("nominal", "calibrated", "repaired")  # the systems that a diagnosis compares
ROLES = {"train": "training", "holdout": "held out"}


@dataclass(frozen=True)
class Diagnosed:
    """A diagnosis. `folder`: holds report.html, repaired.ssp, fmus; `content`: diagnosis.json, as docs/campaigns.md."""

    folder: Path
    content: dict[str, Any]

    @property
    def verdict(self) -> str:
        """As diagnosis.json has it: `nothing_missing`, `explained`, `unlisted` or `undecided`."""
        return str(self.content["verdict"])

    @property
    def findings(self) -> list[dict[str, Any]]:
        """One per missing effect: term, component, confidence, onset in s, parameters with intervals, evidence."""
        return list(self.content["findings"])

    @property
    def report(self) -> Path:
        """The report, one HTML file."""
        return self.folder / "report.html"

    @property
    def repaired(self) -> Path:
        """The repaired system: `load_system` and other simulators open it."""
        return self.folder / "repaired.ssp"

    def to_pandas(self) -> pandas.DataFrame:
        """rms of recording - simulation: a row per channel and role. UserError: pandas is not installed."""
        pandas = library("pandas", "to_pandas")
        rows = [{"channel": c, "runs": role, "noise": x["noise"], **x[role]} for c, role, x in self._figures()]
        return pandas.DataFrame(rows).set_index(["channel", "runs"])

    def plot(self) -> Figure:
        """rms of recording - simulation over that of noise, before and after: a matplotlib figure."""
        from matplotlib import pyplot

        from cobot_joint.results.figures import COLOUR

        rows = [row for row in self._figures() if row[2]["noise"]]
        figure, axis = pyplot.subplots(figsize=(10, 1 + 0.7 * len(rows)), layout="constrained")
        for n, variant in enumerate(VARIANTS):
            length = [(x[role][variant] or 0.0) / x["noise"] for _, role, x in rows]
            axis.barh(
                [k + 0.25 * (1 - n) for k in range(len(rows))],
                length,
                height=0.22,
                label=variant,
                color=COLOUR[variant],
            )
        axis.set_yticks(range(len(rows)), [f"{channel}, {ROLES[role]}" for channel, role, _ in rows])
        axis.axvline(1.0, color="0.5", lw=1.0)
        axis.set_xscale("log")
        axis.set_xlabel("rms of recording - simulation, over that of noise [1]")
        axis.legend()
        return figure

    def _figures(self) -> list[tuple[str, str, dict[str, Any]]]:
        channels = self.content["channels"].items()
        return [(name, role, figures) for name, figures in channels for role in ROLES if role in figures]

    def _repr_html_(self) -> str:
        """The verdict and the findings, for notebooks."""
        rows = "".join(
            f"<tr><td>{escape(f['term'])}</td><td>{100 * f['confidence']:.0f} %</td><td>"
            + ", ".join(f"{escape(n)} = {p['value']:.4g} {escape(p['unit'])}" for n, p in f["parameters"].items())
            + "</td></tr>"
            for f in self.findings
        )
        head = "<tr><th>term</th><th>confidence</th><th>parameters</th></tr>"
        return f"<table><caption>{escape(self.verdict)}</caption>{head}{rows}</table>"
