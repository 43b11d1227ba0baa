"""Which terms a frequency response may lack: what each would take of chi-square, and where a fit of it begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import bounded_step, difference
from cobot_joint.diagnosis.estimation.problem import Problem, Run
from cobot_joint.diagnosis.findings import Candidate
from cobot_joint.diagnosis.plant.plant import TermCandidate

SEEN = (0.5, 50.0)  # whitened length that a probe of a term should have: seen, and not far from linear
MOST = 10.0  # of an amplitude whose range is wider, in its unit: beyond it nothing moves, and simulations take long
DECADES = 4  # below that, of an amplitude that a fit may begin at
WITHIN_REACH = 4.0  # times a chi-square, up to which another is near it: twice the rms
Vector = NDArray[np.float64]


def rank(problem: Problem, base: Fit, terms: Sequence[TermCandidate]) -> list[Candidate]:
    """Every switched-off term by the chi-square that its trace, base parameters projected out, would take away."""
    at = problem.simulate([base.run])[0]
    traces = difference(problem, base.hypothesis, base.x, at) if at is not None else None
    if at is None or traces is None:
        return []
    residual = problem.recorded - at.white
    basis = np.linalg.svd(traces[:, : len(base.hypothesis.base)], full_matrices=False)[0]
    found = []
    for term in terms:
        best = Candidate(term.name, 0.0, {}, None)
        size = 1e-3 * min(term.upper - term.neutral, MOST)
        for values in _points(term):
            trace, size = probe(problem, base, term, values, at.white, size)
            if trace is None:
                continue
            trace = trace - basis @ (basis.T @ trace)
            length, along = float(trace @ trace), float(trace @ residual)
            if length > 1e-6 and (along > 0 or term.lower < term.neutral):
                gain = along**2 / length
                if gain > best.gain:
                    best = Candidate(term.name, gain, values, None)
        found.append(best)
    return sorted(found, key=lambda c: -c.gain)


def _points(term: TermCandidate) -> list[dict[str, float]]:
    """Shape parameters to try; of ripples, which amplitudes average out, the first two orders and one phase."""
    grids = [(s.name, s.values[:2] if s.whole else s.values) for s in term.shapes]
    if term.phase:
        grids.append((term.phase, (0.0,)))
    return [dict(zip([g[0] for g in grids], point, strict=True)) for point in product(*[g[1] for g in grids])]


def probe(
    problem: Problem, base: Fit, term: TermCandidate, shape: Mapping[str, float], at: Vector, size: float
) -> tuple[Vector | None, float]:
    """What a small amplitude of the term adds to the whitened outputs `at`, (rows,), and that amplitude.

    `size`: the one to try first. None: nothing to be seen.
    """
    for _ in range(8):
        if term.neutral + size > term.upper:
            break
        values = {**base.run.values, **shape, term.amplitude: term.neutral + size}
        simulated = problem.simulate([Run(values)])[0]
        if simulated is None:  # too much of it: nothing moves any more
            size *= 0.03
            continue
        trace = simulated.white - at
        length = float(np.linalg.norm(trace))
        if SEEN[0] <= length <= SEEN[1]:
            return trace, size
        if length < 1e-9:
            break
        size *= min(max(5.0 / length, 1e-3), 100.0)
    return None, size


def start(problem: Problem, base: Fit, term: TermCandidate) -> ActiveTerm | None:
    """Where to begin: the shapes and the decade of the amplitude that leave least, base parameters answering linearly.

    An amplitude that leaves far more than none does ends the decades. None: the term cannot be simulated.
    """
    most = min(term.upper - term.neutral, MOST)
    left = _Left(problem, base)
    none, least, best = left({}), np.inf, None
    for shape in _points(term):
        for decade in range(DECADES, -1, -1):
            values = {**shape, term.amplitude: term.neutral + most * 0.1**decade}
            found = left(values)
            if found < least:
                least, best = found, ActiveTerm(term, values)
            if found > WITHIN_REACH * none:
                break
    return best


class _Left:
    """What values of a term leave of chi-square, once the base parameters answer inside their tolerances."""

    def __init__(self, problem: Problem, base: Fit) -> None:
        self.problem, self.base = problem, base
        at = problem.simulate([base.run])[0]
        traces = difference(problem, base.hypothesis, base.x, at) if at is not None else None
        self.J = traces if traces is not None else np.zeros((problem.rows, len(base.x)))
        self.lower = np.array([c.lower for c in base.hypothesis.coordinates]) - base.x
        self.upper = np.array([c.upper for c in base.hypothesis.coordinates]) - base.x

    def __call__(self, values: Mapping[str, float]) -> float:
        simulated = self.problem.simulate([Run({**self.base.run.values, **values})])[0]
        if simulated is None:
            return np.inf
        rest, prior = self.problem.recorded - simulated.white, self.base.hypothesis.prior
        gram, gradient = self.J.T @ self.J + np.diag(prior), self.J.T @ rest - prior * self.base.x
        _, taken = bounded_step(gram, gradient, self.lower, self.upper)
        return float(rest @ rest) - taken
