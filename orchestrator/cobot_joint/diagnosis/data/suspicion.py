"""What may be wrong with a channel, as far as its recordings say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "factor", "sign", "swapped", "late", "clock drifts", "drift",  # beside the nominal system
    "clipped", "frozen", "held", "outlier", "not excited", "inertia differs",  # from the data alone
]  # fmt: skip

CLIPPED = 0.002  # share of samples at an extreme, in runs that noise would break up
FROZEN = 0.25  # s of one value while others move
HELD = 0.1  # share of samples that repeat the one before in the middle of motion
RESTING = ("rad", "m")  # a shaft may stand still anywhere
OUTLIER = 20.0  # times the rest's range
EXCITED = 3.0  # sigma of the noise that a moving channel exceeds
BLOCKS = 8  # of a run, for the scatter of its inertia
INERTIA, SURE = 0.15, 4.0  # relative difference between runs, and standard errors of it


@dataclass(frozen=True)
class Suspicion:
    """A channel that is not what the campaign takes it for. `wrong`: sure enough that nothing ought to be fitted."""

    recording: str
    channel: str  # connector; several: "a, b"
    kind: Kind
    evidence: str
    wrong: bool = False

    def __str__(self) -> str:
        return f"{self.recording}: {self.channel}: {self.evidence}"


def suspicions(recordings: Sequence[Recording]) -> list[Suspicion]:
    """Of every output of every recording, and of the runs among each other."""
    found = [s for r in recordings for s in _of_recording(r)]


@dataclass(frozen=True)
class Suspicion:
    """A channel that is not what the campaign takes it for. `wrong`: sure enough that nothing ought to be fitted."""

    recording: str
    channel: str  # connector; several: "a, b"
    kind: Kind
    evidence: str
    wrong: bool = False

    def __str__(self) -> str:
        return f"{self.recording}: {self.channel}: {self.evidence}"
