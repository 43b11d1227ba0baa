"""What every family of candidates hands on: effects, and what they would take beside a re-fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from cobot_joint.diagnosis.estimation.effects import Effect


class Proposal(Protocol):
    """Effects that could be missing.

    Listed terms: `score_test.Score`; formulas and tables: `port_response.Choice`;
    loads and offsets: `load_histories.Loads`.
    """

    @property
    def effects(self) -> Sequence[Effect]:
        """Where a fit of them would start."""
        ...

    @property
    def gain(self) -> float:
        """Chi-square that they would take, linearly, beyond what a re-fit of the rest takes."""
        ...
