"""How often a finding of this kind is expected to be right (docs/diagnosis-calibration.md says on what ground)."""

from __future__ import annotations

import math

# of the logarithm of the odds, per feature below
INTERCEPT = 3.0
COEFFICIENTS = (0.0, -2.0, -1.0, -0.7)


def features(gain: float, left: float, findings: int, unlisted: bool) -> tuple[float, float, float, float]:
    """Size of the finding, what stays unexplained beside it, how crowded the diagnosis is, and whether a list names it.

    gain: chi-square the finding takes away; left: structure above noise that stays unexplained; findings: of this
    diagnosis.
    """
    share = left / max(gain, 1e-9)  # a finding that explains less than what stays unexplained is a patch
    return math.log10(max(gain, 1.0) / 1e3), math.log10(1 + 10 * share), max(findings - 2, 0), float(unlisted)


def confidence(gain: float, left: float, findings: int, unlisted: bool = False) -> float:
    """0..1; arguments as `features` has them."""
    x = features(gain, left, findings, unlisted)
    score = INTERCEPT + sum(b * f for b, f in zip(COEFFICIENTS, x, strict=True))
    return round(1 / (1 + math.exp(-score)), 3)
