"""How often a finding of this kind is right, from campaigns with known answers (docs/diagnosis-calibration.md)."""

from __future__ import annotations

import math

# logistic coefficients, by maximum likelihood over the calibration's findings: see calibration.py, which prints them
INTERCEPT, CLEAN, CROWDED = 3.0, 2.0, 1.0


def confidence(gain: float, left: float, findings: int, _equivalent: bool = False) -> float:
    """0..1.

    gain: chi-square the finding takes away; left: structure above noise that stays unexplained; findings: of this
    diagnosis.
    """
    share = left / max(gain, 1e-9)  # a finding that explains less than what stays unexplained is a patch
    score = INTERCEPT - CLEAN * math.log10(1 + 10 * share) - CROWDED * max(findings - 2, 0)
    return round(1 / (1 + math.exp(-score)), 3)
