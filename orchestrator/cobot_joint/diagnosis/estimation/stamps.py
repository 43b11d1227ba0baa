"""A channel that is stamped by another clock than it says: recorded(t) = there(t - late - rate*t)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cobot_joint.diagnosis.estimation.effects import Coordinate
from cobot_joint.diagnosis.estimation.problem import Run, Vector

LONGEST, FASTEST = 0.5, 0.05  # s, s per s; what lies beyond is another signal


@dataclass(frozen=True)
class Stamps:
    """An effect on what is recorded, not on the machine. late: s at the beginning of a run; rate: s per s more."""

    channel: str
    late: float = 0.0
    rate: float = 0.0

    @property
    def name(self) -> str:
        """The channel."""
        return self.channel

    @property
    def component(self) -> str:
        """None of the system."""
        return ""

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """Milliseconds, and milliseconds per second."""
        return (
            Coordinate((f"{self.channel}: late",), 0.0, 1e-3, -LONGEST / 1e-3, LONGEST / 1e-3, "linear", ""),
            Coordinate((f"{self.channel}: rate",), 0.0, 1e-3, -FASTEST / 1e-3, FASTEST / 1e-3, "linear", ""),
        )

    def drifts(self, time: Vector) -> bool:
        """Whether the delay grows by more than two samples over a run: (n,)"""
        return bool(abs(self.rate) * (time[-1] - time[0]) > 2 * (time[1] - time[0]))

    def start(self) -> Vector:
        """Where they are."""
        return np.array(
            [(v - c.start) / c.scale for v, c in zip((self.late, self.rate), self.coordinates, strict=True)]
        )

    def apply(self, run: Run, x: Vector) -> Run:
        """With the channel stamped like this."""
        found = self.at(x)
        return replace(run, stamps={**run.stamps, self.channel: (found.late, found.rate)})

    def at(self, x: Vector) -> Stamps:
        """The same at other values."""
        late, rate = (c.start + c.scale * float(v) for c, v in zip(self.coordinates, x, strict=True))
        return replace(self, late=late, rate=rate)
