"""How often a finding of this kind is expected to be right (docs/diagnosis-calibration.md says on what ground)."""

from __future__ import annotations

import math

# of the logarithm of the odds; chosen, not fitted: one finding that leaves nothing unexplained is given 95 %
INTERCEPT, CLEAN, CROWDED = 3.0, 2.0, 1.0


def confidence(gain: float, left: float, findings: int) -> float:
    """0..1.

    gain: chi-square the finding takes away; left: structure above noise that stays unexplained; findings: of this
    diagnosis.
    """
    share = left / max(gain, 1e-9)  # a finding that explains less than what stays unexplained is a patch
    score = INTERCEPT - CLEAN * math.log10(1 + 10 * share) - CROWDED * max(findings - 2, 0)
    return round(1 / (1 + math.exp(-score)), 3)
