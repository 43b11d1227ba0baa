"""What a diagnosis says: the content of diagnosis.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.store import plain

Verdict = Literal["nothing_missing", "explained", "unlisted", "undecided"]


@dataclass(frozen=True)
class Estimate:
    """A fitted value with its 95 % interval; `at` says when the fit ended at a bound."""

    value: float
    unit: str
    ci95: tuple[float, float]
    at: Literal["lower", "upper"] | None = None

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        found: dict[str, Any] = {"value": self.value, "unit": self.unit, "ci95": list(self.ci95)}
        return found | ({"at": self.at} if self.at else {})


@dataclass(frozen=True)
class Feature:
    """One summand of an unlisted effect at an additive port: coefficient * form(signals)."""

    form: str  # "sin(2*phi_b)*sgn(w_b)"
    coefficient: Estimate


@dataclass(frozen=True)
class Form:
    """The shape of an unlisted effect.

    It enters at `port` (`component.variable`, an additive input, or the reading of a channel). A formula where one
    holds up; the table is what the data give without one: `signal` (the component's own, or the time `t`) against the
    port's value.
    """

    port: str
    unit: str
    signals: tuple[str, ...]
    formula: str | None
    features: tuple[Feature, ...]
    explains: float  # share of the structure found that the form takes away
    signal: str = ""
    table: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    period: float = 0.0  # of the table's signal: a turn, where it is an angle
    factor: str = ""  # what multiplies the table: the sign of the speed, or nothing

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        found: dict[str, Any] = {
            "port": self.port,
            "unit": self.unit,
            "signals": list(self.signals),
            "formula": self.formula,
            "features": [{"form": f.form, "coefficient": f.coefficient.to_json()} for f in self.features],
            "explains": self.explains,
        }
        if self.table is not None:
            found["table"] = {self.signal: self.table[0], "value": self.table[1]}
            found |= {"period": self.period, "factor": self.factor}
        return found


@dataclass(frozen=True)
class Course:
    """What acted at `port` (`component.variable`, an additive input) while these recordings were made, and only then.

    courses: recording -> (time since its beginning, value), linear in between, 0 outside.
    """

    port: str
    unit: str
    courses: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]]

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        courses = {name: {"t": t, "value": value} for name, (t, value) in self.courses.items()}
        return {"port": self.port, "unit": self.unit, "recordings": courses}


@dataclass(frozen=True)
class Finding:
    """One missing effect."""

    term: str
    equivalent: tuple[str, ...]
    confidence: float
    onset: float | None
    parameters: dict[str, Estimate]
    where: dict[str, Any]
    gain: float  # evidence: chi-square that it takes away, corrected for the noise's colour
    shape: Form | None = None
    course: Course | None = None
    words: str = ""

    @property
    def component(self) -> str:
        """The unit it is in."""
        return self.term.split(".")[0]

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        return {
            "term": self.term,
            "equivalent": list(self.equivalent),
            "component": self.component,
            "confidence": self.confidence,
            "onset": self.onset,
            "parameters": {n.removeprefix(f"{self.term}."): e.to_json() for n, e in self.parameters.items()},
            "where": self.where,
            "evidence": self.gain,
            "words": self.words,
            "shape": self.shape.to_json() if self.shape else None,
        } | ({"course": self.course.to_json()} if self.course else {})


@dataclass(frozen=True)
class Candidate:
    """How a switched-off term fared: for the report's ranking."""

    term: str
    gain: float  # chi-square that it would take away at its best scanned shape
    shape: dict[str, float]
    onset: float | None


@dataclass
class Diagnosis:
    """Answer, the numbers behind it, and what a repaired system needs.

    `calibrated`: base parameters fitted inside their tolerances with nothing added ("before"). `repaired`: every value
    that the repaired system has other than nominal, base parameters and terms ("after"). `onsets`: parameters of
    `repaired` that hold from that time only. `structure`: what the residual's slow structure has above noise.
    """

    verdict: Verdict
    findings: list[Finding]
    calibrated: dict[str, Estimate]
    repaired: dict[str, Estimate]
    onsets: dict[str, float] = field(default_factory=dict)
    ranking: list[list[Candidate]] = field(default_factory=list)  # one per round
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    located: dict[str, Any] = field(default_factory=dict)  # where the difference lies, before it is named
    next_experiment: str | None = None
    notes: list[str] = field(default_factory=list)
    structure: dict[str, float] = field(default_factory=dict)  # chi-square above noise, before and after
    seconds: float = 0.0

    def parameters(self, variant: Literal["nominal", "calibrated", "repaired"]) -> dict[str, float]:
        """Values to simulate that variant with."""
        chosen = {"nominal": {}, "calibrated": self.calibrated, "repaired": self.repaired}[variant]
        return {name: estimate.value for name, estimate in chosen.items()}

    def courses(self) -> dict[str, dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]]:
        """Recording -> port -> (time, value) of what acted on the machine then."""
        found: dict[str, dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]] = {}
        for course in (f.course for f in self.findings if f.course):
            for name, xy in course.courses.items():
                found.setdefault(name, {})[course.port] = xy
        return found

    def to_json(self) -> dict[str, Any]:
        """diagnosis.json: plain numbers, lists and strings."""
        return plain(
            {
                "verdict": self.verdict,
                "findings": [finding.to_json() for finding in self.findings],
                "calibrated": {name: e.to_json() for name, e in self.calibrated.items()},
                "repaired": {name: e.to_json() for name, e in self.repaired.items()},
                "channels": self.channels,
                "located": self.located,
                "next_experiment": self.next_experiment,
                "notes": self.notes,
                "structure": self.structure,
                "seconds": self.seconds,
            }
        )
