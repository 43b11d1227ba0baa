"""A channel whose log counts otherwise than it says, or is stamped by another clock: effects on what is recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cobot_joint.diagnosis.estimation.effects import Coordinate
from cobot_joint.diagnosis.estimation.problem import Run, Vector

LEAST, MOST = 0.05, 20.0  # gains; what lies beyond is seen before anything is fitted
LONGEST, FASTEST = 0.5, 0.05  # s, s per s; what lies beyond is another signal


@dataclass(frozen=True)
class OfChannel:
    """What both have: they act on what is recorded, not on a unit."""

    channel: str

    @property
    def name(self) -> str:
        """The channel."""
        return self.channel

    @property
    def component(self) -> str:
        """None of the system."""
        return ""


@dataclass(frozen=True)
class Reading(OfChannel):
    """recorded = gain*there + offset.

    reach: the channel's largest value, of which the offset's natural step is a share. drives: whether it is an input;
    its coordinates are those of there = scale*recorded + shift then, in which what it drives is nearly linear.
    """

    reach: float
    drives: bool
    gain: float = 1.0
    offset: float = 0.0

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """Gain (an input's scale) in tenths, offset (shift) in hundredths of the reach."""
        lower, upper = (LEAST - 1) / 0.1, (MOST - 1) / 0.1
        return (
            Coordinate((f"{self.channel}: gain",), 1.0, 0.1, lower, upper, "linear", ""),
            Coordinate((f"{self.channel}: offset",), 0.0, 0.01 * self.reach, -np.inf, np.inf, "linear", ""),
        )

    def start(self) -> Vector:
        """Where they are."""
        values = inverse(self.gain, self.offset) if self.drives else (self.gain, self.offset)
        return np.array([(v - c.start) / c.scale for v, c in zip(values, self.coordinates, strict=True)])

    def apply(self, run: Run, x: Vector) -> Run:
        """With the channel read like this."""
        found = self.at(x)
        return replace(run, readings={**run.readings, self.channel: (found.gain, found.offset)})

    def at(self, x: Vector) -> Reading:
        """The same at other values."""
        gain, offset = (c.start + c.scale * float(v) for c, v in zip(self.coordinates, x, strict=True))
        gain = min(max(gain, LEAST), MOST)
        gain, offset = inverse(gain, offset) if self.drives else (gain, offset)
        return replace(self, gain=gain, offset=offset)


@dataclass(frozen=True)
class Stamps(OfChannel):
    """recorded(t) = there(t - late - rate*t). late: s at the beginning of a run; rate: s per s more."""

    late: float = 0.0
    rate: float = 0.0

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


def inverse(gain: float, offset: float) -> tuple[float, float]:
    """(scale, shift) of x = scale*y + shift, where y = gain*x + offset."""
    return 1 / gain, -offset / gain
