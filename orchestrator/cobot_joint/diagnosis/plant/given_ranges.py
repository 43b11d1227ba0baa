"""Ranges over which a campaign wants shapes scanned, in place of those that units propose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.plant.plant import ScannedShape, TermCandidate

Ranges = Mapping[str, tuple[float, float]]  # `component.term.shape` -> lower, upper


def with_ranges(terms: Sequence[TermCandidate], ranges: Ranges) -> tuple[TermCandidate, ...]:
    """The terms, their shapes scanned and fitted over these ranges where there are such: as many values as before, of
    orders each whole number."""
    return tuple(replace(t, shapes=tuple(_over(s, ranges[s.name]) if s.name in ranges else s for s in t.shapes))
                 for t in terms)  # fmt: skip


def _over(shape: ScannedShape, given: tuple[float, float]) -> ScannedShape:
    lower, upper = given
    if shape.whole:
        values = np.arange(np.ceil(lower), np.floor(upper) + 1)
    else:
        values = (np.geomspace if shape.logarithmic else np.linspace)(lower, upper, len(shape.values))
    return replace(shape, values=tuple(float(v) for v in values), lower=lower, upper=upper, given=True)
