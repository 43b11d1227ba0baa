"""Out of local minima that ringing makes: what is slow in the residual is fitted first.

A resonance that is off by some percent is out of step after a few periods, and least squares then damps it rather than
moves it. Averaged over more than a period it is gone from the residual, and the local minimum with it. In seismology
this is cycle skipping, and the way out is the same: Bunks, C., Saleck, F. M., Zaleski, S., Chavent, G. (1995),
Multiscale seismic waveform inversion, Geophysics 60(5), 1457-1473.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.least_squares import Precision, fit, fit_on, predicted_decrease
from cobot_joint.diagnosis.estimation.problem import Problem, Vector

WIDEST = 256  # samples that are averaged: the wider, the fewer local minima. From 128 on, four starts of five ended out
# of step with a brake that lets go late; from 256 on, none did
NARROWER = 4  # times, the window of the next
SLOW = 32  # samples, the same where only the slow part of a residual is asked for
LEAST = 20  # windows that a recording must have
ON_THE_WAY = Precision(settled=10.0, roughly=0.02, steps=8, jacobians=1)  # of the slow parts' fits
FAR = 0.03  # of the slow residual above noise, that a re-fit would take: of 45 calibrations on ../shared 8 have more,
# up to 0.63; there the better of both fits counts, so that it costs time only
LEADS = 0.01  # of what all rows leave above noise, that they must be predicted to lose from there


class Averaged(Problem):
    """A problem of whose rows a fit sees means over a window, times the root of its length: white noise keeps its
    variance. A fit's residual and Jacobian are those of all rows, so that one through another window goes on from it.
    """

    def __init__(self, fine: Problem, window: int) -> None:
        super().__init__(fine.plant, fine.recordings, fine.noise, fine.jobs, fine.step)
        self.budget, self.watch, self._runs, self.window = fine.budget, fine.watch, fine._runs, window

    def seen(self, rows: Vector) -> Vector:
        """Means, block by block: (windows,) or (windows, k)"""
        parts = [_means(rows[block.rows], self.window) for block in self.blocks]
        return np.concatenate(parts) * np.sqrt(self.window)

    @property
    def samples(self) -> int:
        """Windows that carry data."""
        return int(sum(_means(block.weight, self.window).sum() for block in self.blocks))


def out_of_local_minimum(problem: Problem, found: Fit, precision: Precision, times: int = 1) -> Fit:
    """The fit itself, or a better one where its slow part says that it is far from where it belongs.

    The question costs no simulation: the fit's own Jacobian, averaged, predicts what the slow residual would lose.
    times: at most, that it is led out of one minimum after the other.
    """
    slowest_first = scales(problem)
    for _ in range(times):
        better = _led_out(problem, found, slowest_first, precision)
        if better is None or better.cost >= found.cost:
            break
        found = better
    return found


def _led_out(problem: Problem, found: Fit, slowest_first: Sequence[Averaged], precision: Precision) -> Fit | None:
    """From the widest means to the narrowest, then with all rows. None: another form is missing, not another place."""
    if not any(_is_far(slow, found) for slow in slowest_first):
        return None
    at = found
    for slow in slowest_first:
        begun = fit_on(slow, at, ON_THE_WAY)
        if begun is None or (_is_far(slow, found) and not _lost(slow, found, begun.chi2)):
            return None
        at = begun
        if not _leads_on(problem, found, at):
            return None
    return fit_on(problem, at, precision)


def _leads_on(problem: Problem, found: Fit, at: Fit) -> bool:
    """Whether all rows, fitted on from where their slow part is best, are predicted to leave less than before: not
    where another form is missing, as on nearly every machine of which something is."""
    return _predicted(at) < found.cost - LEADS * max(found.cost - problem.samples, 0.0)


def _predicted(at: Fit) -> float:
    """The cost that all rows are predicted to leave from there."""
    there = replace(at, chi2=float(at.residual @ at.residual))
    return there.cost - predicted_decrease(there)


def slow_first(
    problem: Problem, hypothesis: Hypothesis, x: Vector, precision: Precision, most: float = np.inf
) -> Fit | None:
    """A fit that begins far from where it belongs. None: the start cannot be simulated, or where its slow part is best,
    all rows are predicted to leave more than `most`."""
    at: Fit | None = None
    for slow in scales(problem):
        at = fit_on(slow, at, ON_THE_WAY) if at is not None else fit(slow, hypothesis, x, None, ON_THE_WAY)
        if at is None or _predicted(at) > most:
            return None
    return fit_on(problem, at, precision) if at is not None else fit(problem, hypothesis, x, None, precision)


def slow_part(problem: Problem) -> Averaged | None:
    """Means over SLOW samples; None: the recordings are too short."""
    return Averaged(problem, SLOW) if _widest(problem) >= SLOW else None


def scales(problem: Problem) -> list[Averaged]:
    """The widest window that the recordings are long enough for, and a narrower one; none where they are short."""
    widest = min(_widest(problem), WIDEST)
    return [Averaged(problem, window) for window in (widest, widest // NARROWER)] if widest >= SLOW else []


def _widest(problem: Problem) -> int:
    """Samples in a window of which every recording has LEAST; a power of two."""
    shortest = min(len(recording.time) for recording in problem.recordings)
    return 2 ** int(np.log2(max(shortest / LEAST, 1.0)))


def _is_far(slow: Averaged, found: Fit) -> bool:
    """Whether a re-fit would take much of the slow part of the residual."""
    at = replace(found, residual=slow.seen(found.residual), jacobian=slow.seen(found.jacobian))
    noise = thresholds.LEFT_SIGMA * np.sqrt(2 * slow.samples)
    above = _above(slow, found)
    return above > noise and predicted_decrease(at) > FAR * above


def _lost(slow: Averaged, found: Fit, chi2: float) -> bool:
    """Whether that is much less than the fit leaves of its slow part."""
    return _above(slow, found) + slow.samples - chi2 > FAR * _above(slow, found)


def _above(slow: Averaged, found: Fit) -> float:
    """Chi-square above noise of what a fit leaves in its slow part."""
    residual = slow.seen(found.residual)
    return float(residual @ residual) - slow.samples


def _means(rows: Vector, window: int) -> Vector:
    """Over windows; a rest that fills none is left out: (n // window, ...)"""
    count = len(rows) // window
    return np.asarray(rows[: count * window].reshape(count, window, *rows.shape[1:]).mean(axis=1))
