"""Naming: terms added one by one, each fitted with everything else free, while the evidence demands it; then what cannot be told apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from orchestrator.diagnosis.diagnosis import Candidate
from orchestrator.diagnosis.fit import Active, Fit, Hypothesis, difference, fit
from orchestrator.diagnosis.problem import Problem, Vector
from orchestrator.diagnosis.scan import Column, Scan, Score, scores

EVIDENCE = 100.0  # chi-square that a term must take away; healthy campaigns reach 30 (docs/diagnosis-calibration.md)
LEADERS = 4  # of a scan's ranking that are fitted with everything else free
MOST_TERMS = 4
ALIKE = 30.0  # chi-square by which a term's fit may be worse and still not be told apart
ALIKE_SHARE = 0.05  # the same, as a share of what the best fit leaves
SHARE = 0.01  # of what is to be explained, that a term promises at least if it is to be tried
ROUGHLY = 0.01  # precision of fits that only compete, as a share of what is above noise

Progress = Callable[[str], None]


@dataclass
class Named:
    """A term that is on, and what it stands for."""

    term: str
    gain: float  # chi-square that the fit loses without it
    alike: dict[str, float] = field(default_factory=dict)  # term -> chi-square by which its fit is worse


@dataclass
class Naming:
    """The best fit found, its terms, and what every round looked at."""

    fit: Fit
    named: list[Named]
    ranking: list[list[Candidate]]
    columns: list[Column]
    rivals: dict[str, Fit]  # term (instead of the last one added) -> fit


class Namer:
    """Adds terms to a calibrated base model."""

    def __init__(self, problem: Problem, scan: Scan, progress: Progress) -> None:
        self.problem = problem
        self.scan = scan
        self.progress = progress

    def name(self, calibrated: Fit) -> Naming:
        """From the base model up."""
        best, named, ranking, columns, rivals = calibrated, [], [], [], {}
        while len(best.hypothesis.active) < MOST_TERMS and self.unexplained(best):
            self.progress(f"scan {len(ranking) + 1}: every term that the units know")
            columns = self.scan.columns(best, skip=[a.term.name for a in best.hypothesis.active])
            ranked = scores(self.problem, best, columns)
            ranking.append([Candidate(s.term.name, s.gain, dict(s.values), s.onset) for s in ranked[:10]])
            found = self.compete(best, ranked)
            if not found:
                break
            winner = min(found, key=lambda name: found[name].cost)
            gain = best.cost - found[winner].cost
            if gain < EVIDENCE:
                break
            alike = {
                n: f.cost - found[winner].cost
                for n, f in found.items()
                if n != winner and self.as_good(f, found[winner])
            }
            self.progress(f"{winner} takes {gain:.0f} of {best.chi2 - self.problem.samples:.0f} above noise")
            best, rivals = found[winner], found
            named.append(Named(winner, gain, alike))
        return Naming(best, named, ranking, columns, rivals)

    def unexplained(self, fit: Fit) -> bool:
        """Whether more is left than noise leaves."""
        left = self.problem.excess(fit.residual)
        return left > 3 * self.problem.excess_scatter or fit.chi2 - self.problem.samples > 0.03 * self.problem.samples

    def as_good(self, fit: Fit, best: Fit) -> bool:
        """Whether a fit cannot be told from the best."""
        left = max(self.problem.excess(best.residual), 0.0)
        return fit.cost - best.cost < ALIKE + ALIKE_SHARE * left

    def compete(self, best: Fit, ranked: Sequence[Score], leaders: int = LEADERS) -> dict[str, Fit]:
        """The leaders fitted roughly, then those that come near the best one to the end. Twins are not fitted twice."""
        above = max(best.chi2 - self.problem.samples, 0.0)
        tried = [
            s for s in ranked if s.gain > max(0.3 * EVIDENCE, SHARE * above) and s.term.name not in self.scan.twins
        ][:leaders]
        fits = {}
        for score in tried:
            found = self.fit_with(best, score, roughly=ROUGHLY, settled=20.0)
            if found is not None and found.cost < best.cost:
                found = self.with_onset(found)
                fits[score.term.name] = found
                if (
                    found.chi2 - self.problem.samples < 0.02 * above
                    and self.problem.excess(found.residual) < 3 * self.problem.excess_scatter
                ):
                    break  # nothing left: the next ones promise less
        if not fits:
            return {}
        lowest = min(f.cost for f in fits.values())
        near = {n: f for n, f in fits.items() if f.cost - lowest < 0.5 * max(best.cost - lowest, 0.0)}
        polished = {n: fit_on(self.problem, f, settled=2.0) or f for n, f in near.items()}
        top = min(polished, key=lambda n: polished[n].cost)
        for score in ranked:  # fitted nowhere, yet as good by the score test as what it is a twin of
            leader = self.scan.twins.get(score.term.name)
            if leader in polished and score.term.name not in polished and polished[leader].cost == polished[top].cost:
                polished[score.term.name] = replace(polished[leader], x=polished[leader].x)
        return dict(sorted(polished.items(), key=lambda item: item[1].cost))

    def fit_with(self, best: Fit, score: Score, *, roughly: float, settled: float) -> Fit | None:
        """The best hypothesis with one more term, started from the score test's amplitude and sensitivities."""
        return fit_added(self.problem, best, score.active, score.column, roughly=roughly, settled=settled)

    def with_onset(self, found: Fit) -> Fit:
        """The last term's onset, if it has one: refined by halving, dropped where starting at once is as good."""
        active = found.hypothesis.active[-1]
        if active.onset is None:
            return found
        centre, width = active.onset, float(self.problem.times().max()) / 16
        best = found
        while width > 0.01:
            for onset in (centre - width / 2, centre + width / 2):
                if onset <= 0:
                    continue
                trial = replace_last(best.settled(), replace(best.settled().active[-1], onset=onset))
                moved = fit(
                    self.problem, trial, base_start(trial, best), best.jacobian, settled=20.0, roughly=0.02, most=3
                )
                if moved is not None and moved.cost < best.cost:
                    best = moved
            centre, width = best.hypothesis.active[-1].onset or centre, width / 2
        return best


def replace_last(hypothesis: Hypothesis, active: Active) -> Hypothesis:
    """The hypothesis with another last term."""
    return replace(hypothesis, active=(*hypothesis.active[:-1], active))


def base_start(hypothesis: Hypothesis, best: Fit) -> Vector:
    """The start of a hypothesis, base parameters where another fit has them."""
    x = hypothesis.start()
    base = len(hypothesis.free)
    x[:base] = best.x[:base]
    return x


def fit_on(problem: Problem, found: Fit, *, settled: float, most: int = 12) -> Fit | None:
    """The same hypothesis, fitted on from where it stands."""
    return fit(problem, found.hypothesis, found.x, found.jacobian, settled=settled, most=most)


def fit_added(
    problem: Problem, best: Fit, active: Active, column: Column, *, roughly: float, settled: float
) -> Fit | None:
    """The hypothesis of `best` with one more term; its Jacobian is that of `best` and the scanned column, so that no run is wasted."""
    hypothesis = replace(best.settled(), active=(*best.settled().active, active))
    x = base_start(hypothesis, best)
    coordinates = hypothesis.coordinates
    own = [k for k in range(len(best.x), len(coordinates))]
    base = problem.simulate([hypothesis.run(x)])[0]
    if base is None:
        return None
    fresh = difference(problem, hypothesis, x, base, own)
    if fresh is None:
        return None
    J = np.column_stack([_settled_jacobian(best), fresh])
    return fit(problem, hypothesis, x, J, settled=settled, roughly=roughly)


def _settled_jacobian(best: Fit) -> Vector:
    """Jacobian in the coordinates of the settled hypothesis: scales of linear coordinates follow their start values."""
    old, new = best.hypothesis.coordinates, best.settled().coordinates
    J = best.jacobian.copy()
    for k, (a, b) in enumerate(zip(old, new, strict=True)):
        if a.kind in ("linear", "cos", "sin") and a.scale > 0:
            J[:, k] *= b.scale / a.scale
    return J
