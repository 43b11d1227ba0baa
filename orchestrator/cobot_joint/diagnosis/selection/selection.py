"""What was selected: fits term by term, the terms, and what every round looked at."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.findings import Candidate


@dataclass
class Selected:
    """A term that is on, and what it stands for."""

    term: str
    gain: float  # chi-square that the fit loses without it
    alike: dict[str, float] = field(default_factory=dict)  # term -> chi-square by which its fit is worse


@dataclass
class Selection:
    """Fits term by term, the terms, and what every round looked at."""

    history: list[Fit]  # the base model, then after every term
    selected: list[Selected] = field(default_factory=list)
    ranking: list[list[Candidate]] = field(default_factory=list)  # one per round
    indistinguishable: dict[str, str] = field(default_factory=dict)  # term -> the one of another unit that it equals
    probes: dict[str, float] = field(default_factory=dict)  # of the score test, which a later round needs
    done: bool = False

    @property
    def fit(self) -> Fit:
        """The last, with every term."""
        return self.history[-1]

    def taken(self, problem: Problem) -> dict[str, float]:
        """Term -> what it takes, as a share of that and of what nothing explains; never more than its fellows on
        average, since patches take much together and little each."""
        before, left = (problem.above(fit.residual) for fit in (self.history[0], self.fit))
        average = 1 - min(left / before, 1.0) ** (1 / max(len(self.selected), 1))
        return {s.term: min(s.gain / (s.gain + left), average) for s in self.selected}

    @property
    def imitates(self) -> bool:
        """Whether several terms of one unit are on and one ends at what it may be: together they may be another."""
        units = [active.component for active in self.fit.hypothesis.terms]
        return any(units.count(unit) > 1 for unit in self.fit.units_at_bounds)

    def up_to(self, count: int) -> Selection:
        """With the first terms only."""
        return replace(self, history=self.history[: count + 1], selected=self.selected[:count])
