"""What the search along the recorded motion says, as a diagnosis says it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.anchored.search import Named, Search, confidence
from cobot_joint.diagnosis.estimation.fit import NORMAL
from cobot_joint.diagnosis.findings import Candidate, Diagnosis, Estimate, Finding


def diagnosis(found: Search, units: Mapping[str, str]) -> Diagnosis:
    """Without where the recordings differ and what would tell more. units: parameter -> unit of measure."""
    repaired = dict(found.repaired)
    for candidate in found.linear:
        sigma = float(np.sqrt(candidate.added.covariance[0, 0]))
        for name, value in candidate.values.items():
            off = NORMAL * sigma if name == candidate.term.amplitude else 0.0
            repaired[name] = Estimate(value, units.get(name, "1"), (value - off, value + off))
    findings = [_finding(named, repaired) for named in found.named if _acts(named, repaired)]
    return Diagnosis(
        verdict="explained" if findings else "nothing_missing",
        findings=sorted(findings, key=lambda f: -f.gain),
        calibrated=found.calibrated,
        repaired=repaired,
        background=found.background,
        ranking=[[Candidate(name, 2 * evidence, {}, None) for name, evidence in rank] for rank in found.ranking],
    )


def _acts(named: Named, repaired: Mapping[str, Estimate]) -> bool:
    """Whether following the recordings with it left it an amplitude."""
    term = named.candidate.term
    return term.amplitude not in repaired or repaired[term.amplitude].value != term.neutral


def _finding(named: Named, repaired: Mapping[str, Estimate]) -> Finding:
    return Finding(
        term=named.name,
        equivalent=named.alike[: thresholds.MOST_NAMES - 1],
        confidence=confidence(named),
        onset=named.candidate.onset,
        parameters={name: repaired[name] for name in named.candidate.values if name in repaired},
        where=dict(named.where),
        gain=2 * named.evidence,
        ground="recorded motion",
    )
