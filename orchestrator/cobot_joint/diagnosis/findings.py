"""What a diagnosis says: the content of diagnosis.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.plant.correction import Product
from cobot_joint.diagnosis.store import plain

Verdict = Literal["nothing_missing", "explained", "unlisted", "undecided"]
# what stands behind a confidence: the count of drawn machines, or one of those for which none was made
Ground = Literal["drawn machines", "background", "recorded motion", "table", "frequency response", "term not counted"]


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
    """One summand of an unmodelled effect at an additive port: coefficient * form(signals)."""

    form: Product
    coefficient: Estimate


@dataclass(frozen=True)
class Form:
    """The shape of an unmodelled effect.

    It enters at `port` (`component.variable`, an additive input, or the reading of a channel). A formula where one
    holds up; else the table that the data give: `signal` (the component's own, or the time `t`) against the port's
    value.
    """

    port: str
    unit: str
    signals: tuple[str, ...]
    features: tuple[Feature, ...]  # of the formula; none: there is a table
    explains: float  # share of the structure found that the form takes away
    signal: str = ""
    table: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    period: float = 0.0  # of the table's signal: a turn, where it is an angle
    direction: str = ""  # the signal whose sign multiplies the table, or none

    @property
    def formula(self) -> str | None:
        """As an expression of the signals."""
        summands = [(f.coefficient.value, str(f.form)) for f in self.features]
        text = " + ".join(f"{k:.4g}" if form == "1" else f"{k:.4g}*{form}" for k, form in summands)
        return text.replace("+ -", "- ") or None

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        found: dict[str, Any] = {
            "port": self.port,
            "unit": self.unit,
            "signals": list(self.signals),
            "formula": self.formula,
            "features": [{"form": str(f.form), "coefficient": f.coefficient.to_json()} for f in self.features],
            "explains": self.explains,
        }
        if self.table is not None:
            found["table"] = {self.signal: self.table[0], "value": self.table[1]}
            found |= {"period": self.period, "factor": f"sgn({self.direction})" if self.direction else ""}
        return found


@dataclass(frozen=True)
class LoadHistory:
    """External loads at `port` (`component.variable`) while these recordings were made, and only then.

    recordings: name -> (time since its beginning, value), linear in between, 0 outside. frozen: an input that is one
    value during all of them, and hardly by chance.
    """

    port: str
    unit: str
    recordings: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]]
    frozen: str = ""

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        recordings = {name: {"t": t, "value": value} for name, (t, value) in self.recordings.items()}
        frozen = {"frozen": self.frozen} if self.frozen else {}
        return {"port": self.port, "unit": self.unit, "recordings": recordings, **frozen}


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
    shape: Form | None = None  # of an effect that is on no list
    load_history: LoadHistory | None = None
    ground: Ground = "term not counted"
    limited_by: str = ""  # why it is no surer

    def limited(self, to: float, why: str) -> Finding:
        """No surer than that, whatever speaks for it."""
        return replace(self, confidence=to, limited_by=why) if self.confidence > to else self

    def withheld(self, why: str) -> Finding:
        """No claim, whatever speaks for it."""
        return self.limited(thresholds.WITHHELD, why)

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
            "confidence_from": self.ground,
            "onset": self.onset,
            "parameters": {n.removeprefix(f"{self.term}."): e.to_json() for n, e in self.parameters.items()},
            "where": self.where,
            "evidence": self.gain,
            "shape": self.shape.to_json() if self.shape else None,
            **({"limited_by": self.limited_by} if self.limited_by else {}),
            **({"load_history": self.load_history.to_json()} if self.load_history else {}),
        }


@dataclass(frozen=True)
class Misreading:
    """A channel with whose gain and offset re-fitted, recorded = gain*there + offset, nothing else need be missing; or
    with whose stamps, recorded(t) = there(t - late - rate*t).

    column: of the file. takes: share of the slow structure that this takes from the re-fitted base model's residual.
    alike: another channel with which it would be as good, or none.
    """

    channel: str
    column: str
    gain: Estimate
    offset: Estimate
    takes: float
    alike: str = ""
    late: Estimate | None = None
    rate: Estimate | None = None

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        return {
            "channel": self.channel,
            "column": self.column,
            "gain": self.gain.to_json(),
            "offset": self.offset.to_json(),
            "takes": self.takes,
            "alike": self.alike or None,
        } | ({"late": self.late.to_json(), "rate": self.rate.to_json()} if self.late and self.rate else {})


@dataclass(frozen=True)
class Advice:
    """An experiment that would tell two terms apart, as far as simulation says.

    uncouple: the unit to run by itself, of several that share a shaft. Else `experiment` and, where that is not enough,
    `channel` (logged as well) would differ by `chi2` after a re-fit; below what separates, nothing that was tried does.
    """

    terms: tuple[str, ...]
    uncouple: str | None = None
    experiment: str | None = None
    channel: str | None = None
    seconds: float | None = None
    chi2: float | None = None


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
    that the repaired system has other than nominal, base parameters and terms ("after"). `structure`: what the
    residual's slow structure has above noise, before and after. `repair`: withheld where it does not predict.
    """

    verdict: Verdict
    findings: list[Finding]
    calibrated: dict[str, Estimate]
    repaired: dict[str, Estimate]
    ranking: list[list[Candidate]] = field(default_factory=list)  # one per round
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    located: dict[str, Any] = field(default_factory=dict)  # where the difference lies, before it is named
    advice: list[Advice] = field(default_factory=list)  # what to record next
    structure: dict[str, float] = field(default_factory=dict)
    repair: Literal["offered", "withheld"] = "offered"
    background: list[dict[str, Any]] = field(default_factory=list)  # what is worth no name, by port and variable
    seconds: float = 0.0
    crashes: list[str] = field(default_factory=list)  # of units; what was tried then was passed over
    left_out: list[str] = field(default_factory=list)  # for want of time
    misreading: Misreading | None = None  # of a channel, in place of findings or as good as them
    mistimed: list[str] = field(default_factory=list)  # channels that are late beside all that was found, in words
    held: list[str] = field(default_factory=list)  # inputs that leave less if their values are held, in words
    strained: list[str] = field(default_factory=list)  # base parameters at their ends, where these are many
    refuted: list[str] = field(default_factory=list)  # base parameters whose withheld repair does not predict

    def parameters(self, variant: Literal["nominal", "calibrated", "repaired"]) -> dict[str, float]:
        """Values to simulate that variant with."""
        chosen = {"nominal": {}, "calibrated": self.calibrated, "repaired": self.repaired}[variant]
        return {name: estimate.value for name, estimate in chosen.items()}

    def load_histories(self) -> dict[str, dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]]:
        """Recording -> port -> (time, value) of what acted on the machine then."""
        found: dict[str, dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]] = {}
        for history in (f.load_history for f in self.findings if f.load_history):
            for name, xy in history.recordings.items():
                found.setdefault(name, {})[history.port] = xy
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
                "advice": [asdict(advice) for advice in self.advice],
                "structure": self.structure,
                "repair": self.repair,
                "discrepancy": self.background,
                "seconds": self.seconds,
            }
            | ({"crashes": self.crashes} if self.crashes else {})
            | ({"left_out": self.left_out} if self.left_out else {})
            | ({"misreading": self.misreading.to_json()} if self.misreading else {})
            | ({"mistimed": self.mistimed} if self.mistimed else {})
            | ({"held": self.held} if self.held else {})
            | ({"strained": self.strained} if self.strained else {})
            | ({"refuted": self.refuted} if self.refuted else {})
        )
