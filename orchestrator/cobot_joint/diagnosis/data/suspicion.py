"""What may be wrong with a channel, as far as its recordings say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "factor", "sign", "swapped", "late", "clock drifts", "drift",  # beside the nominal system
    "clipped", "frozen", "held", "outlier", "not excited", "inertia differs", "duplicate",  # from the data alone
]  # fmt: skip


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
