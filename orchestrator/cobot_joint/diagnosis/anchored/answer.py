"""What the search along the recorded motion says, as a diagnosis says it."""

from __future__ import annotations

from collections.abc import Mapping

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.anchored.search import Named, Search, confidence
from cobot_joint.diagnosis.findings import Candidate, Diagnosis, Estimate, Finding


def diagnosis(found: Search, units: Mapping[str, str]) -> Diagnosis:
    """Without where the recordings differ and what would tell more. units: parameter -> unit of measure."""
    repaired = dict(found.repaired)
    for candidate in found.linear:
        for name, value in candidate.values.items():
            repaired[name] = Estimate(
                value, units.get(name, "1"), _interval(candidate.term.amplitude == name, value, candidate)
            )
    findings = [_finding(named, repaired) for named in found.named]
    return Diagnosis(
        verdict="explained" if findings else "nothing_missing",
        findings=sorted(findings, key=lambda f: -f.gain),
        calibrated=found.calibrated,
        repaired=repaired,
        background=found.background,
        ranking=[[Candidate(name, 2 * evidence, {}, None) for name, evidence in rank] for rank in found.ranking],
    )


def _interval(amplitude: bool, value: float, candidate: object) -> tuple[float, float]:
    sigma = float(candidate.added.covariance[0, 0]) ** 0.5 if amplitude else 0.0  # type: ignore[attr-defined]
    return value - 1.96 * sigma, value + 1.96 * sigma


def _finding(named: Named, repaired: Mapping[str, Estimate]) -> Finding:
    return Finding(
        term=named.name,
        equivalent=named.alike[: thresholds.MOST_NAMES - 1],
        confidence=confidence(named),
        onset=named.candidate.onset,
        parameters={name: repaired[name] for name in named.candidate.values if name in repaired},
        where=dict(named.where),
        gain=2 * named.evidence,
    )
