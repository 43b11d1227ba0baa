"""What a term is worth beside the latent forces: its answer in the filter's innovations, and the likelihoods' ratio.

Along the trajectory that the recording shows, a switched-off term is a signal: what a unit of its amplitude adds to the
derivatives of states and to readings, at the states that the filter has estimated. No run is simulated for it. The
filter's innovations are white; what a known signal would add to them is a regressor, with everything that the latent
forces would have taken for their own already gone from it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.plant.at_once import at_once
from cobot_joint.diagnosis.plant.plant import TermCandidate
from cobot_joint.diagnosis.state_estimation.estimator import StateEstimator, Tracked
from cobot_joint.diagnosis.state_estimation.linearisation import POINTS, TURN
from cobot_joint.diagnosis.state_estimation.native.effect import Answer
from cobot_joint.diagnosis.state_estimation.native.kalman import respond
from cobot_joint.system.model import Value

Array = NDArray[np.float64]
TOGETHER = 8  # combinations of shapes in one pass: of 2, 4, 8 and 16 the quickest
SEEN = 1e-6  # of a column's square: less beside the others is none of its own
ROUNDS = 4  # of estimating the latent forces' sizes again


@dataclass(frozen=True)
class Tracking:
    """A recording's filter run with the filter that made it."""

    estimator: StateEstimator
    tracked: Tracked


@dataclass(frozen=True)
class Effect:
    """Of a unit of something known in each tracking. psi: (n - 1, states, columns), direct: (n, channels, columns)"""

    psi: Sequence[Array]
    direct: Sequence[Array]

    def of(self, number: int) -> tuple[Array, Array]:
        """In the tracking of that number."""
        return self.psi[number], self.direct[number]

    def __getitem__(self, own: slice) -> Effect:
        """Some of the columns."""
        return Effect([p[:, :, own] for p in self.psi], [d[:, :, own] for d in self.direct])


@dataclass(frozen=True)
class TermScore:
    """A switched-off term beside the latent forces, base parameters re-fitted inside their tolerances.

    shapes: as scanned, where it does best. amplitude: most likely, sigma: its standard error; with a phase, phase: rad.
    gain: of twice the log likelihood, the latent forces' sizes as they are without it. evidence: log of the ratio of
    marginal likelihoods, their sizes estimated again with it; None where that was not asked.
    """

    term: str
    shapes: Mapping[str, float]
    amplitude: float
    sigma: float
    phase: float | None
    gain: float
    evidence: float | None = None


class Evidence:
    """Recordings of one machine, tracked with the same values.

    tolerances: `component.parameter` -> (nominal value less the one it has now, 1 sigma that it may be off).
    """

    def __init__(self, trackings: Sequence[Tracking], tolerances: Mapping[str, tuple[float, float]]) -> None:
        self.trackings = list(trackings)
        self.tolerances = dict(tolerances)
        self._parts: dict[int, tuple[Array, Array]] = {}
        self.parameters = [name for name in tolerances if any(self._has(t, name) for t in self.trackings)]
        self.base = self._of_parameters()
        self._prior = np.array([1 / self.tolerances[name][1] ** 2 for name in self.parameters])
        self._centre = np.array([self.tolerances[name][0] for name in self.parameters])

    @cached_property
    def _base(self) -> _Columns:
        return _Columns(self, self.base)

    @cached_property
    def _held(self) -> Array:
        """Covariance of the base parameters."""
        return np.asarray(np.linalg.inv(self._base.gram + np.diag(self._prior)))

    @cached_property
    def _moved(self) -> Array:
        """Where they are most likely."""
        return np.asarray(self._held @ (self._base.gradient + self._prior * self._centre))

    def score(self, terms: Sequence[TermCandidate], refined: int = 0) -> list[TermScore]:
        """Best first. refined: how many get their evidence, with the latent forces' sizes estimated again."""
        found = [(best, term) for term in terms if (best := self._best(term)) is not None]
        found.sort(key=lambda pair: -pair[0].gain)
        if refined:
            base = self._likelihood([])
            found = [(replace(score, evidence=self._likelihood([(term, score)]) - base), term)
                     for score, term in found[:refined]] + found[refined:]  # fmt: skip
            found[:refined] = sorted(found[:refined], key=lambda pair: -(pair[0].evidence or 0.0))
        return [score for score, _ in found]

    @property
    def corrections(self) -> dict[str, float]:
        """`component.parameter` -> by how much it is off, most likely, with the latent forces as they are."""
        return dict(zip(self.parameters, map(float, self._moved), strict=True))

    def gls(self, effect: Effect, groups: Sequence[slice] | None = None) -> list[tuple[Array, Array, float]]:
        """Generalised least squares of groups of columns (each alone; None: all together) beside the base parameters:
        coefficients, their covariance, and the gain in twice the log likelihood, 0 where nothing answers."""
        columns = _Columns(self, effect)
        cross = self._base.white.T @ columns.white
        gradient = columns.gradient - cross.T @ self._moved
        found = []
        for g in groups or [slice(None)]:
            gram = columns.gram[g, g]
            scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
            gram = gram - cross[:, g].T @ self._held @ cross[:, g]
            inverse = np.linalg.pinv(gram / np.outer(scale, scale), rcond=SEEN, hermitian=True) / np.outer(scale, scale)
            seen = float(np.min(scale)) > 1e-100
            found.append((inverse @ gradient[g], inverse, float(gradient[g] @ inverse @ gradient[g]) if seen else 0.0))
        return found

    def signal(self, port: str, values: Sequence[Array]) -> Effect:
        """Of known signals at a latent's port: values: per recording ((n - 1) POINTS, columns), in the middle of the
        parts of each step. Where the port feeds a reading, the first part's value is taken for the sample's."""
        psi, direct = [], []
        for n, (t, v) in enumerate(zip(self.trackings, values, strict=True)):
            column = t.estimator.ports.index(port)
            Phi, Hold = self._part_of_step(n)
            B = t.tracked.tangent.Gamma[:, :, column]
            B = np.asarray(np.linalg.solve(t.tracked.tangent.Hold, B[:, :, None]))  # what it adds to the derivatives
            parts = v.reshape(len(B), POINTS, -1)
            found = np.zeros((len(B), t.estimator.x.stop, parts.shape[2]))
            for k in range(POINTS):
                found = Phi @ found + (Hold @ B) * parts[:, k][:, None, :]
            psi.append(found)
            at_samples = np.concatenate([parts[:, 0], parts[-1:, -1]])
            direct.append(t.tracked.steps.H[:, :, t.estimator.d.start + column][:, :, None] * at_samples[:, None, :])
        return Effect(psi, direct)

    def _best(self, term: TermCandidate) -> TermScore | None:
        """The shapes with the largest gain; None: no recording answers to it."""
        best: TermScore | None = None
        width = 1 if term.phase is None else 2
        every = list(combinations(term))
        for first in range(0, len(every), TOGETHER):
            some = every[first : first + TOGETHER]
            groups = [slice(k * width, (k + 1) * width) for k in range(len(some))]
            for shapes, (theta, covariance, gain) in zip(some, self.gls(self.of_term(term, some), groups), strict=True):
                if gain <= (best.gain if best else 0.0):
                    continue
                sigma = float(np.sqrt(np.trace(covariance) / width))
                if width == 1:
                    best = TermScore(term.name, shapes, float(theta[0]), sigma, None, gain)
                else:
                    phase = float(np.arctan2(theta[1], theta[0]))
                    best = TermScore(term.name, shapes, float(np.hypot(*theta)), sigma, phase, gain)
        return best

    def _likelihood(self, terms: Sequence[tuple[TermCandidate, TermScore]]) -> float:
        """Log of the likelihood with base parameters and terms at their most likely values and the latent forces' sizes
        estimated again, less half the logarithm of the number of readings per coefficient (Schwarz 1978, Ann. Stat. 6).
        """
        parts = [self.base, *(self.of_term(term, [score.shapes]) for term, score in terms)]
        psi = [np.concatenate([p.psi[n] for p in parts], axis=2) for n in range(len(self.trackings))]
        direct = [np.concatenate([p.direct[n] for p in parts], axis=2) for n in range(len(self.trackings))]
        columns = _Columns(self, Effect(psi, direct))
        more = psi[0].shape[2] - len(self._prior)
        gram = columns.gram + np.diag(np.concatenate([self._prior, np.zeros(more)]))
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        gradient = columns.gradient.copy()
        gradient[: len(self._prior)] += self._prior * self._centre
        theta = np.linalg.pinv(gram / np.outer(scale, scale), rcond=SEEN, hermitian=True) @ (gradient / scale) / scale
        total = -0.5 * more * np.log(sum(np.isfinite(t.tracked.steps.r).sum() for t in self.trackings))
        for t, p, d in zip(self.trackings, psi, direct, strict=True):
            steps, found = t.tracked.steps, t.tracked.filtered
            alone = replace(found, K=np.zeros_like(found.K), precision=(found.precision > 0).astype(float))
            explained = respond(steps, alone, p @ theta[:, None], d @ theta[:, None])[:, :, 0]
            tracked = replace(t.tracked, steps=replace(steps, r=steps.r - explained))
            estimator = t.estimator
            for _ in range(ROUNDS):
                estimator = estimator.resized(tracked, slice(None))
            total += estimator.refilter(tracked).filtered.log_likelihood
        return float(total - 0.5 * self._prior @ (theta[: len(self._prior)] - self._centre) ** 2)

    def of_term(self, term: TermCandidate, combinations: Sequence[Mapping[str, float]]) -> Effect:
        """A column, or two a quarter of a period apart, for each combination of shapes."""
        phases: list[dict[str, Value]] = [{}]
        if term.phase is not None:
            phases = [{term.phase: 0.0}, {term.phase: np.pi / 2}]
        values = [{**shapes, **phase} for shapes in combinations for phase in phases]
        whole = [shape.name for shape in term.shapes if shape.whole]
        orders = [max((float(v[name]) for name in whole), default=0.0) for v in values]

        def of_one(n: int) -> tuple[Array, Array]:
            t = self.trackings[n]
            if self._has(t, term.name):
                return self._of_amplitudes(n, term.amplitude, values, orders)
            shape = (*t.tracked.steps.r.shape, len(values))
            return np.zeros((shape[0] - 1, t.estimator.x.stop, len(values))), np.zeros(shape)

        found = at_once(of_one, range(len(self.trackings)))
        return Effect([psi for psi, _ in found], [direct for _, direct in found])

    def _of_amplitudes(
        self, n: int, amplitude: str, values: Sequence[Mapping[str, Value]], orders: Sequence[float]
    ) -> tuple[Array, Array]:
        """(n - 1, states, columns), (n, channels, columns): of a unit of an amplitude, at its neutral value, with other
        values beside it. orders: periods per turn that they have, 0 of none."""
        quick = np.array([self._quick(n, amplitude, order) for order in orders])
        parts = [np.flatnonzero(quick == inside).tolist() for inside in (False, True)]
        found = [self._answer(n, [amplitude], [values[j] for j in part], inside)
                 for part, inside in zip(parts, (False, True), strict=True) if len(part)]  # fmt: skip
        if len(found) == 1:
            return found[0]
        back = np.argsort(np.concatenate(parts))
        psi, direct = (np.concatenate(both, axis=2)[:, :, back] for both in zip(*found, strict=True))
        return psi, direct

    def _quick(self, n: int, name: str, order: float | None = None) -> bool:
        """Whether a periodic term of the component changes within a step (order None: one that is on), and the unit
        can be asked there."""
        t, component = self.trackings[n], name.split(".")[0]
        lineariser = t.estimator.lineariser
        return lineariser.turns(t.tracked.piece, component, order) > TURN and lineariser.gives_derivatives(component)

    def _answer(
        self, n: int, parameters: Sequence[str], values: Sequence[Mapping[str, Value]], inside: bool
    ) -> tuple[Array, Array]:
        """The same; inside: of what changes within a step, summed over parts of it."""
        t = self.trackings[n]
        tangent = t.tracked.tangent
        Phi, Hold = self._part_of_step(n) if inside else (tangent.Phi, tangent.Hold)
        answer = Answer(POINTS * inside, Phi, Hold, tangent.T, tangent.S)
        return t.estimator.lineariser.effect(parameters, values, t.tracked.piece, answer)

    def _part_of_step(self, n: int) -> tuple[Array, Array]:
        """Phi and Hold of a part of each step; kept, since every periodic term asks for them."""
        if n not in self._parts:
            t = self.trackings[n]
            self._parts[n] = t.estimator.lineariser.step(t.tracked.tangent.A, t.tracked.recording.step / POINTS)
        return self._parts[n]

    def _of_parameters(self) -> Effect:
        components = dict.fromkeys(name.split(".")[0] for name in self.parameters)

        def of_one(n: int) -> tuple[Array, Array]:
            t, count = self.trackings[n], len(self.parameters)
            psi = np.zeros((len(t.tracked.time) - 1, t.estimator.x.stop, count))
            direct = np.zeros((*t.tracked.steps.r.shape, count))
            for component in components:
                own = [k for k, name in enumerate(self.parameters) if name.split(".")[0] == component]
                if self._has(t, component):
                    names = [self.parameters[k] for k in own]
                    found = self._answer(n, names, [{}] * len(own), self._quick(n, component))
                    psi[:, :, own], direct[:, :, own] = found
            return psi, direct

        found = at_once(of_one, range(len(self.trackings)))
        return Effect([psi for psi, _ in found], [direct for _, direct in found])

    @staticmethod
    def _has(t: Tracking, name: str) -> bool:
        return any(c.name == name.split(".")[0] for c in t.estimator.sampled.system.components)


class _Columns:
    """An effect in the innovations: white: (rows, columns), and its products."""

    def __init__(self, evidence: Evidence, effect: Effect) -> None:
        parts = [
            np.concatenate(respond(t.tracked.steps, t.tracked.filtered, psi, direct))
            for t, psi, direct in zip(evidence.trackings, effect.psi, effect.direct, strict=True)
        ]
        self.white = np.concatenate(parts)
        self.gram = self.white.T @ self.white
        self.gradient = self.white.T @ np.concatenate([t.tracked.filtered.white.ravel() for t in evidence.trackings])


def combinations(term: TermCandidate) -> Iterator[dict[str, float]]:
    for values in product(*(shape.values for shape in term.shapes)):
        yield {shape.name: value for shape, value in zip(term.shapes, values, strict=True)}
