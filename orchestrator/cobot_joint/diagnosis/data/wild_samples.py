"""Samples that no machine makes: a bit that fell over on the way. One of them outweighs all others in a fit.

Told by a running median (Hampel 1974, J. Am. Stat. Assoc. 69(346)), since that of five samples follows whatever lasts
for three.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

WINDOW = 5  # samples: one or two in a row are wild, three are motion
FAR = 20.0  # times the range of all but a hundredth of the samples
FEWEST = 50  # samples from which on a range is one


def without_wild(x: NDArray[np.float64]) -> tuple[NDArray[np.float64], str]:
    """The series with NaN (not recorded) for wild samples, (n,), and what was taken out in words; "": nothing."""
    known = np.flatnonzero(np.isfinite(x))
    if len(known) < FEWEST:
        return x, ""
    y = x[known]
    low, high = np.quantile(y, [0.005, 0.995])
    wild = known[np.abs(y - median_filter(y, WINDOW, mode="nearest")) > FAR * (high - low)]
    if high <= low or not len(wild):
        return x, ""
    left = x.copy()
    left[wild] = np.nan
    count = "1 sample lies" if len(wild) == 1 else f"{len(wild)} samples lie"
    return left, f"{count} far outside, first {x[wild[0]]:.4g} among {low:.4g} to {high:.4g}: taken as not recorded"
