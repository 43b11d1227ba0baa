"""Which experiment would tell apart what these recordings cannot."""

from __future__ import annotations

from collections.abc import Sequence

from orchestrator.diagnosis.diagnosis import Finding
from orchestrator.diagnosis.problem import Problem


def next_experiment(problem: Problem, findings: Sequence[Finding]) -> str | None:
    """In words; None where every finding stands alone."""
    said = [sentence for finding in findings if (sentence := _apart(problem, finding))]
    return " ".join(dict.fromkeys(said)) or None


def _apart(problem: Problem, finding: Finding) -> str | None:
    """Terms of one name in two units share a shaft; others differ by what they depend on."""
    if not finding.equivalent:
        return None
    name = finding.term.split(".")[1]
    units = [t.split(".")[0] for t in (finding.term, *finding.equivalent) if t.split(".")[1] == name]
    others = [t for t in finding.equivalent if t.split(".")[1] != name]
    said = []
    if len(units) > 1:
        said.append(
            f"{name}: {' and '.join(units)} share a shaft that the channels see as one; "
            f"run {units[0]} uncoupled, with the same voltage, and compare."
        )
    if others:
        channels = ", ".join(dict.fromkeys(b.channel for b in problem.blocks))
        said.append(
            f"{finding.term} or {' or '.join(others)}: repeat the stretch where the evidence lies "
            f"({finding.where.get('recording', 'all recordings')}, {finding.where.get('regime', '')}) "
            "at another load and at another speed, "
            f"in both directions, logging {channels}; their sensitivities then differ."
        )
    return " ".join(said)
