"""Candidates against each other: each fitted with everything else free, at the best of sizes and onsets."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from operator import attrgetter, itemgetter

import numpy as np
from scipy.optimize import minimize_scalar

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.candidates.score_test import SEGMENTS, Score
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.least_squares import Precision, fit, fit_added, fit_on
from cobot_joint.diagnosis.estimation.multiscale import out_of_local_minimum
from cobot_joint.diagnosis.estimation.problem import Problem, Vector

FITTED = 4  # candidates of a ranking that are fitted with everything else free
SIZES = (0.3, 1.0, 3.0)  # multiples of the score test's amplitude that a fit may start from
LARGER = 10.0  # the same, where the largest of these does best: runs far from the data are the slowest
FINISHED = 2  # of the candidates, that are fitted to the end
OUTDONE, MUCH = 5.0, 0.01  # times what another leaves, or this share of all: what leaves more is not fitted on
ONSET = 1e-3  # s; to which an onset is refined
NEAR, LOOKS = 0.125, 31  # segments about an onset, and how many in them: a valley is 0.02 wide
STEPS = 5  # of ONSET, either way from there
ROUGH = Precision(settled=20.0, roughly=0.01, steps=10, jacobians=0)  # of fits that only compete
NEARBY = Precision(settled=5.0, roughly=0.01, steps=4, jacobians=1)  # of one whose edges were moved
FROM_START = Precision(settled=5.0, roughly=0.01, steps=10, jacobians=1)
TO_THE_END = Precision(settled=2.0, steps=12, jacobians=2)

CHI2 = attrgetter("chi2")


def finished(jacobians: int, steps: int = 12) -> Precision:
    """Of a fit that counts."""
    return Precision(settled=10.0, roughly=0.002, steps=steps, jacobians=jacobians)


class Competition:
    """Candidates for a place beside the effects that a fit has."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def fits(self, best: Fit, ranked: Sequence[Score], least: float) -> dict[str, Fit]:
        """Those whose predicted gain is `least` (chi-square) fitted roughly, then those near the best one finished.

        By term, the lowest cost first; none that is no better than `best`. Where the leading ones leave what stands
        out, sensitivities mislead: others are tried that do well as they are. Where one leaves nothing, only its equals
        are, and the same physics in other units: a gear's Stribeck friction of 94 % was the motor's.
        """
        above = self.problem.above(best.residual)
        top = max((s.gain for s in ranked), default=0.0)
        worth = max(least, thresholds.WORTH_FITTING * top)
        first = not best.hypothesis.effects
        fits: dict[str, Fit] = {}
        enough = -np.inf  # predicted gain from which on a candidate is tried
        lowest_rough = np.inf
        for k, score in enumerate([s for s in ranked if s.gain > least][: 2 * FITTED]):
            if score.gain < enough and not _is_kin(score, fits):
                continue
            lowest = min(fits.values(), key=attrgetter("cost"), default=best)
            leads = score.gain > worth and (k < FITTED or (first and score.gain > thresholds.ABREAST * top))
            if not leads and not self.problem.stands_out(lowest.residual):
                continue
            active, cost = self.sized(best, score.active)
            promised = min(cost, best.cost - score.gain)  # as it is, or by its sensitivity: either may mislead
            if not leads and _is_hopeless(best, promised, lowest.cost):
                continue
            rough = self.roughly(best, active)
            if rough is None:
                continue
            lowest_rough = min(lowest_rough, rough.cost)
            found = self._with_exact_onset(best, rough, lowest.cost if fits else np.inf, lowest_rough)
            if found.cost >= best.cost:
                continue
            fits[score.term.name] = found
            hardly = self._hardly_left, thresholds.HARDLY_LEFT_SHARE * above
            if self.problem.excess(found.residual) < max(hardly):
                enough = max(enough, thresholds.CLOSE * score.gain)  # nothing left: only its equal may do as well
        return self._finished(best, fits) if fits else {}

    @property
    def _hardly_left(self) -> float:
        return thresholds.HARDLY_LEFT * self.problem.excess_scatter

    def _finished(self, best: Fit, fits: dict[str, Fit]) -> dict[str, Fit]:
        lowest = min(f.cost for f in fits.values())
        reach = thresholds.NEAR_BEST * max(best.cost - lowest, 0.0)
        near = sorted(
            (
                (name, fit)
                for name, fit in fits.items()
                if fit.cost - lowest < reach and not self._is_outdone(best, fit.cost, lowest)
            ),
            key=lambda item: item[1].cost,
        )
        found = {name: self.finished(f) for name, f in near[:FINISHED]}
        if len(found) > 1 and not any(self.problem.unexplained(f.residual) for f in found.values()):
            # only at their ends can such be told apart
            found = {name: fit_on(self.problem, f, TO_THE_END) or f for name, f in found.items()}
        return dict(sorted(found.items(), key=lambda item: item[1].cost))

    def finished(self, found: Fit) -> Fit:
        """Fitted to its end; where nothing is left, with the Jacobian at hand."""
        jacobians = 1 if self.problem.unexplained(found.residual) else 0
        ended = fit_on(self.problem, found, finished(jacobians)) or found
        return out_of_local_minimum(self.problem, ended, finished(jacobians)) if jacobians else ended

    def roughly(self, best: Fit, active: ActiveTerm) -> Fit | None:
        """A term that was sized from the start, and, where it sets in later, from then on: the better fit of both."""
        always = fit_added(self.problem, best, [replace(active, onset=None)], ROUGH)
        if active.term.episode or active.onset is None:
            return always
        if always is not None and self.problem.excess(always.residual) < self._hardly_left:
            return always
        later = fit_added(self.problem, best, [active], ROUGH)
        return min(filter(None, (always, later)), key=attrgetter("cost"), default=None)

    def _with_exact_onset(self, best: Fit, rough: Fit, lowest: float, lowest_rough: float) -> Fit:
        """With its onset refined; as it is where it comes nowhere near another term, or takes little of what is above
        noise. lowest: cost of the best so far; lowest_rough: of the best of those before any onset was refined."""
        if self._is_outdone(best, rough.cost, lowest_rough) or _is_hopeless(best, rough.cost, lowest):
            return rough
        little = best.cost - rough.cost < thresholds.WORTH_FITTING * self.problem.above(best.residual)
        return rough if little and not rough.hypothesis.terms[-1].term.episode else self.with_onset(rough)

    def _is_outdone(self, best: Fit, cost: float, lowest: float) -> bool:
        """Whether a candidate leaves much of what is above noise, and many times what another leaves: what either still
        gains is less."""
        base, left, least = (max(x - self.problem.samples, 0.0) for x in (best.cost, cost, lowest))
        return left > OUTDONE * max(least, MUCH * base)

    def setting_in(self, best: Fit, found: Sequence[Score], onset: float) -> Fit | None:
        """The best of those that do best as they are, each off until about `onset`. None: none can be simulated."""
        tried = [self.sized(best, replace(score.active, onset=onset)) for score in found]
        leading = [active for active, _ in sorted(tried, key=itemgetter(1))[:FITTED]]
        fits = [fit for active in leading if (fit := fit_added(self.problem, best, [active], ROUGH)) is not None]
        lowest = min(fits, key=attrgetter("cost"), default=None)
        return self.finished(self.with_onset(lowest)) if lowest is not None else None

    def sized(self, best: Fit, active: ActiveTerm) -> tuple[ActiveTerm, float]:
        """(the term at that multiple of the score test's amplitude, and from that time on, which fit best, chi-square).

        All else as it is. Sensitivities at zero mislead far from it. A run with a term that sets in later is taken for
        the one without it until then, and from then on for the one with it.
        """
        tried = self._as_they_are(best, [scaled(active, k) for k in SIZES])
        if tried[-1] is min(tried, key=itemgetter(0)):
            tried += self._as_they_are(best, [scaled(active, LARGER)])
        _, cost, found = min(tried, key=itemgetter(0))
        return found, cost

    def _as_they_are(self, best: Fit, terms: Sequence[ActiveTerm]) -> list[tuple[float, float, ActiveTerm]]:
        """(chi-square and what an onset has to be worth, chi-square, the term from then on), all else as it is."""
        at = best.settled()
        runs = [at.hypothesis.with_effects(a).run(np.concatenate([at.x, a.start()])) for a in terms]
        without, found = self.problem.recorded - at.simulated.white, []
        for active, simulated in zip(terms, self.problem.simulate(runs), strict=True):
            if simulated is None:
                found.append((np.inf, np.inf, active))
                continue
            rest = self.problem.recorded - simulated.white
            cost = float(rest @ rest)
            found.append((cost, cost, active))
            if self.problem.onsets and not active.term.episode and active.onset is None:
                later, onset = self._best_onset(without, rest)
                least = max(thresholds.LATER, thresholds.WORTH * (later - self.problem.samples))
                found[-1] = min(found[-1], (later + least, later, replace(active, onset=onset)), key=itemgetter(0))
        return found

    def _best_onset(self, without: Vector, with_it: Vector) -> tuple[float, float]:
        """(chi-square, onset) of the best of the borders between segments. Both: residuals."""
        time = self.problem.times()
        onsets = float(time.max()) / SEGMENTS * np.arange(1.0, SEGMENTS - 1)
        taken = _taken_from(onsets, time, without**2 - with_it**2)
        best = int(np.argmax(taken))
        return float(without @ without - taken[best]), float(onsets[best])

    def with_onset(self, found: Fit, k: int = -1) -> Fit:
        """Term k's onset, or where it has these its beginning and length, refined with all else as it is.

        A gradient does not see an edge that lies elsewhere. What is missed or too much grows with the distance from
        the true onset, on both sides: a valley, seen from steps of a quarter segment, is gone down by golden section.
        The two edges of an episode are moved by halving.
        """
        active, best = found.settled().hypothesis.terms[k], found
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
            middle = best.hypothesis.terms[k].onset or 0.0
            around = max(middle - segment / 4, 0.0), middle + segment / 4
            minimize_scalar(left_from, bounds=around, method="bounded", options={"xatol": ONSET})
        elif active.term.episode:
            width = segment / 2
            while width > ONSET:
                trials = self.moved(found, k, _at_other_times(best.settled().hypothesis.terms[k], width))
                nearest = min((best, *filter(None, trials)), key=CHI2)
                width = width / 2 if nearest is best else width
                best = nearest
        else:
            return found
        best = fit_on(self.problem, best, NEARBY) or best
        if active.onset is None or not self.problem.stands_out(best.residual):
            return best
        return min((best, *filter(None, [self._with_onset_by_what_is_slow(best, k)])), key=CHI2)

    def _with_onset_by_what_is_slow(self, found: Fit, k: int) -> Fit | None:
        """Term k from the time on from which it leaves least of what is slow: of a sensor's low-pass that was put a
        tenth of a second late (machine 193/51), which left eighty times as much, one sample of the torque's jump was
        five hundred thousand of chi-square at any onset but the true one."""
        active, end = found.settled().hypothesis.terms[k], float(self.problem.times().max())
        always, never = self.moved(found, k, [replace(active, onset=t) for t in (None, end + 1)])
        if always is None or never is None:
            return None
        times = np.concatenate(self.problem.excess_times())
        more = np.concatenate(self.problem.excess_by_block(never.residual))
        more -= np.concatenate(self.problem.excess_by_block(always.residual))
        onset = float(times[int(np.argmax(_taken_from(times, times, more)))])
        near = onset + end / SEGMENTS * np.linspace(-NEAR, NEAR, LOOKS)
        slowest = self._least(found, k, near, lambda trial: self.problem.excess(trial.residual))
        if slowest is None:
            return None
        exact = np.asarray((slowest.hypothesis.terms[k].onset or 0.0) + ONSET * np.arange(-STEPS, STEPS + 1))
        best = self._least(slowest, k, exact, CHI2)  # a reading that jumps there is hundreds of sigma off for a sample
        return best and (fit_on(self.problem, best, NEARBY) or best)

    def _least(self, found: Fit, k: int, onsets: Vector, left: Callable[[Fit], float]) -> Fit | None:
        """That of some onsets of term k which leaves least, all else as it is."""
        active = found.settled().hypothesis.terms[k]
        trials = self.moved(found, k, [replace(active, onset=float(t)) for t in onsets if t > 0])
        return min(filter(None, trials), key=left, default=None)

    def from_start(self, found: Fit, k: int) -> Fit | None:
        """The same terms, term k from the start on."""
        at = found.settled()
        hypothesis = replaced(at.hypothesis, k, replace(at.hypothesis.terms[k], onset=None))
        return fit(self.problem, hypothesis, at.x, at.jacobian, FROM_START)

    def moved(self, found: Fit, k: int, actives: Sequence[ActiveTerm]) -> list[Fit | None]:
        """A fit with others in term k's place, all else as it is. None: that cannot be simulated."""
        at = found.settled()
        hypotheses = [replaced(at.hypothesis, k, active) for active in actives]
        fits: list[Fit | None] = []
        runs = [h.run(at.x) for h in hypotheses]
        for hypothesis, simulated in zip(hypotheses, self.problem.simulate(runs), strict=True):
            if simulated is None:
                fits.append(None)
                continue
            rest = self.problem.recorded - simulated.white
            fits.append(Fit(hypothesis, at.x, float(rest @ rest), rest, simulated, at.jacobian, 0))
        return fits


def _taken_from(onsets: Vector, times: Vector, more: Vector) -> Vector:
    """What a term takes that acts from each of these times on. more: at `times`, what is left without it and not with.

    A run with a term that sets in later is taken for the one without it until then, and from then on for the one with.
    """
    order = np.argsort(times, kind="stable")
    before = np.concatenate([[0.0], np.cumsum(more[order])])
    return before[-1] - before[np.searchsorted(times[order], onsets)]


def _is_kin(score: Score, fits: Collection[str]) -> bool:
    """Whether the same term of another unit has been fitted."""
    return any(name.rsplit(".")[-1] == score.term.name.rsplit(".")[-1] for name in fits)


def _is_hopeless(best: Fit, cost: float, lowest: float) -> bool:
    """Whether a candidate takes so little of what the best one takes that it will not win."""
    return cost - lowest > thresholds.HOPELESS * (best.cost - lowest)


def scaled(active: ActiveTerm, k: float) -> ActiveTerm:
    """The term k times as large, as far as it may be."""
    term = active.term
    amplitude = term.neutral + k * (active.values[term.amplitude] - term.neutral)
    return replace(active, values={**active.values, term.amplitude: float(np.clip(amplitude, term.lower, term.upper))})


def _at_other_times(active: ActiveTerm, width: float) -> list[ActiveTerm]:
    """Either edge of an episode moved, or both; its impulse kept."""
    assert active.term.episode
    begin, length = active.term.episode
    t_0, T_d = active.values[begin], active.values[length]
    moves = [(t_0 + t * width, T_d + T * width) for t, T in ((-1, 0), (1, 0), (0, -1), (0, 1), (1, -1), (-1, 1))]
    moved = [(replace(active, values={**active.values, begin: t, length: T}), T_d / T) for t, T in moves if T > 0]
    return [scaled(other, k) for other, k in moved if other.values[begin] >= 0]


def replaced(hypothesis: Hypothesis, k: int, active: ActiveTerm) -> Hypothesis:
    """The hypothesis with another term in place of term k."""
    old = hypothesis.terms[k]
    return replace(hypothesis, effects=tuple(active if e is old else e for e in hypothesis.effects))
