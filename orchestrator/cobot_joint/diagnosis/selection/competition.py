"""Terms that a scan ranks first, fitted with everything else free: at the best of sizes and onsets, then to the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter

import numpy as np
from scipy.optimize import minimize_scalar

from cobot_joint.diagnosis.candidates.score_test import SEGMENTS, Score
from cobot_joint.diagnosis.estimation.fit import Active, Fit, Hypothesis, difference, fit
from cobot_joint.diagnosis.estimation.problem import Problem, Vector

LEADERS = 4  # of a scan's ranking that are fitted with everything else free
ABREAST = 0.9  # of the best promise, from which on twice as many are for a first term: their order says little
SIZES = (0.3, 1.0, 3.0, 10.0)  # multiples of the score test's amplitude that a fit may start from
POLISHED = 2  # of the leaders, that are fitted to the end
CLOSE = 0.98  # of a promise that was kept, from which on another term is tried all the same
RIVAL = 0.3  # of the best promise, that another term's promise must have to be tried against it
ONSET = 1e-3  # s; to which an onset is refined
HOPELESS = 0.6  # of what another term takes, that a term falls short of
ROUGHLY = 0.01  # precision of fits that only compete, as a share of what is above noise

CHI2 = attrgetter("chi2")


class Leaders:
    """Competes terms for a place beside those that a fit has."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def fits(self, best: Fit, ranked: Sequence[Score], least: float) -> dict[str, Fit]:
        """Those that promise `least` (chi-square) fitted roughly, then those that come near the best one to the end.

        By term, the lowest cost first; none that is no better than `best`.
        """
        above = max(best.chi2 - self.problem.samples, 0.0)
        top = max((s.gain for s in ranked), default=0.0)
        worth = [s for s in ranked if s.gain > max(least, RIVAL * top)][: 2 * LEADERS]
        first = not best.hypothesis.active
        tried = [s for k, s in enumerate(worth) if k < LEADERS or (first and s.gain > ABREAST * top)]
        fits: dict[str, Fit] = {}
        enough = -np.inf  # promise from which on a term is tried
        for score in tried:
            if score.gain < enough:
                break
            found = self.with_best_onset(best, score.active, min((f.cost for f in fits.values()), default=np.inf))
            if found is None or found.cost >= best.cost:
                continue
            fits[score.term.name] = found
            if self.problem.excess(found.residual) < max(5 * self.problem.excess_scatter, 0.005 * above):
                enough = max(enough, CLOSE * score.gain)  # nothing left: only one that promises as much may do as well
        if not fits:
            return {}
        lowest = min(f.cost for f in fits.values())
        near = {n: f for n, f in fits.items() if f.cost - lowest < 0.3 * max(best.cost - lowest, 0.0)}
        near = dict(sorted(near.items(), key=lambda item: item[1].cost)[:POLISHED])
        polished = {n: self.polished(f) for n, f in near.items()}
        if len(polished) > 1 and not any(self.problem.unexplained(f.residual) for f in polished.values()):
            ended = {n: fit_on(self.problem, f, settled=2.0, fresh=2) for n, f in polished.items()}
            polished = {n: ended[n] or f for n, f in polished.items()}  # only at their ends can such be told apart
        return dict(sorted(polished.items(), key=lambda item: item[1].cost))

    def polished(self, found: Fit) -> Fit:
        """Fitted to its end; where nothing is left, with the Jacobian at hand."""
        fresh = 3 if self.problem.unexplained(found.residual) else 0
        return fit_on(self.problem, found, settled=10.0, roughly=0.002, fresh=fresh) or found

    def with_best_onset(self, best: Fit, active: Active, lowest: float = np.inf) -> Fit | None:
        """The term from the start, and, where the score test says so, from later on: the better fit of both.

        lowest: cost of another term's fit; where this one comes nowhere near it, its onset need not be exact.
        """
        active = self.sized(best, active)
        rough = partial(fit_added, self.problem, best, most=10, fresh=0, settled=20.0, roughly=ROUGHLY)
        always = rough(replace(active, onset=None))
        if always is not None and active.term.episode:
            return self.with_onset(always)
        if active.onset is None or (
            always is not None and self.problem.excess(always.residual) < 5 * self.problem.excess_scatter
        ):
            return always
        later = rough(active)
        if later is None or (always is not None and always.cost <= later.cost):
            return always
        hopeless = later.cost - lowest > HOPELESS * (best.cost - lowest)
        return later if hopeless else self.with_onset(later)

    def sized(self, best: Fit, active: Active) -> Active:
        """The term at that multiple of the score test's amplitude which fits best as it is.

        Sensitivities at zero mislead far from it.
        """
        tried = [scaled(active, k) for k in SIZES]
        hypotheses = [replace(best.settled(), active=(*best.settled().active, a)) for a in tried]
        found = self.problem.simulate([h.run(base_start(h, best)) for h in hypotheses])
        costs = [np.inf if f is None else float(np.sum((self.problem.recorded - f.white) ** 2)) for f in found]
        return tried[int(np.argmin(costs))]

    def with_onset(self, found: Fit, k: int = -1) -> Fit:
        """Term k's onset, or where it has these its beginning and length, refined with all else as it is.

        A gradient does not see an edge that lies elsewhere. What is missed or too much grows with the distance from
        the true onset, on both sides: a valley, seen from steps of a quarter segment, is gone down by golden section.
        The two edges of an episode are moved by halving.
        """
        active, best = found.settled().active[k], found
        segment = float(self.problem.times().max()) / SEGMENTS

        def left_from(onset: float) -> float:
            nonlocal best
            trial = self.moved(found, k, [replace(active, onset=float(onset))])[0]
            best = best if trial is None else min(best, trial, key=CHI2)
            return np.inf if trial is None else trial.chi2

        if active.onset is not None:
            onsets = active.onset + segment * np.arange(-1.0, 1.1, 0.25)
            others = [replace(active, onset=float(t)) for t in onsets if t > 0 and t != active.onset]
            trials = self.moved(found, k, others)
            best = min((best, *filter(None, trials)), key=CHI2)
            middle = best.hypothesis.active[k].onset or 0.0
            around = max(middle - segment / 4, 0.0), middle + segment / 4
            minimize_scalar(left_from, bounds=around, method="bounded", options={"xatol": ONSET})
        elif active.term.episode:
            width = segment / 2
            while width > ONSET:
                trials = self.moved(found, k, _at_other_times(best.settled().active[k], width))
                nearest = min((best, *filter(None, trials)), key=CHI2)
                width = width / 2 if nearest is best else width
                best = nearest
        else:
            return found
        return fit_on(self.problem, best, settled=5.0, roughly=ROUGHLY, most=4) or best

    def from_start(self, found: Fit, k: int) -> Fit | None:
        """The same terms, term k from the start on."""
        settled = found.settled()
        hypothesis = replaced(settled, k, replace(settled.active[k], onset=None))
        x, J = base_start(settled, found), settled_jacobian(found)
        return fit(self.problem, hypothesis, x, J, settled=5.0, roughly=ROUGHLY, most=10, fresh_most=1)

    def moved(self, found: Fit, k: int, actives: Sequence[Active]) -> list[Fit | None]:
        """A fit with others in term k's place, all else as it is. None: that cannot be simulated."""
        settled = found.settled()
        x, J = base_start(settled, found), settled_jacobian(found)
        hypotheses = [replaced(settled, k, active) for active in actives]
        fits: list[Fit | None] = []
        for hypothesis, simulated in zip(
            hypotheses, self.problem.simulate([h.run(x) for h in hypotheses]), strict=True
        ):
            if simulated is None:
                fits.append(None)
                continue
            rest = self.problem.recorded - simulated.white
            fits.append(Fit(hypothesis, x, float(rest @ rest), rest, simulated, J, 0))
        return fits


def scaled(active: Active, k: float) -> Active:
    """The term k times as large, as far as it may be."""
    term = active.term
    amplitude = term.neutral + k * (active.values[term.amplitude] - term.neutral)
    return replace(active, values={**active.values, term.amplitude: float(np.clip(amplitude, term.lower, term.upper))})


def _at_other_times(active: Active, width: float) -> list[Active]:
    """Either edge of an episode moved, or both; its impulse kept."""
    assert active.term.episode
    begin, length = active.term.episode
    t_0, T_d = active.values[begin], active.values[length]
    moves = [(t_0 + t * width, T_d + T * width) for t, T in ((-1, 0), (1, 0), (0, -1), (0, 1), (1, -1), (-1, 1))]
    moved = [(replace(active, values={**active.values, begin: t, length: T}), T_d / T) for t, T in moves if T > 0]
    return [scaled(other, k) for other, k in moved if other.values[begin] >= 0]


def replaced(hypothesis: Hypothesis, k: int, active: Active) -> Hypothesis:
    """The hypothesis with another term in place of term k."""
    actives = list(hypothesis.active)
    actives[k] = active
    return replace(hypothesis, active=tuple(actives))


def base_start(hypothesis: Hypothesis, best: Fit) -> Vector:
    """The start of a hypothesis, base parameters where another fit has them."""
    x = hypothesis.start()
    base = len(hypothesis.free)
    x[:base] = best.x[:base]
    return x


def fit_on(
    problem: Problem, found: Fit, *, settled: float, roughly: float = 0.0, most: int = 12, fresh: int = 3
) -> Fit | None:
    """The same hypothesis, fitted on from where it stands. fresh: Jacobians by differences at most."""
    hypothesis, x, J = found.hypothesis, found.x, found.jacobian
    return fit(problem, hypothesis, x, J, settled=settled, roughly=roughly, most=most, fresh_most=fresh)


def fit_added(
    problem: Problem, best: Fit, active: Active, *, most: int, fresh: int, settled: float, roughly: float
) -> Fit | None:
    """`best` with one more term; its Jacobian is that of `best` and the new term's own, so that few runs are needed."""
    hypothesis = replace(best.settled(), active=(*best.settled().active, active))
    x = base_start(hypothesis, best)
    own = list(range(len(best.x), len(hypothesis.coordinates)))
    base = problem.simulate([hypothesis.run(x)])[0]
    added = difference(problem, hypothesis, x, base, own) if base is not None else None
    if added is None:
        return None
    J = np.column_stack([settled_jacobian(best), added])
    return fit(problem, hypothesis, x, J, settled=settled, roughly=roughly, most=most, fresh_most=fresh)


def settled_jacobian(best: Fit) -> Vector:
    """Jacobian in the coordinates of the settled hypothesis: scales of linear coordinates follow their start values."""
    old, new = best.hypothesis.coordinates, best.settled().coordinates
    J = best.jacobian.copy()
    for k, (a, b) in enumerate(zip(old, new, strict=True)):
        if a.kind in ("linear", "cos", "sin") and a.scale > 0:
            J[:, k] *= b.scale / a.scale
    return J
