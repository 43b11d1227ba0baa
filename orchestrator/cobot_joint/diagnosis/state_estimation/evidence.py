"""What a term is worth beside the latent forces: its answer in the filter's innovations, and the likelihoods' ratio.

Along the trajectory that the recording shows, a switched-off term is a signal: what a unit of its amplitude adds to the
derivatives of states and to readings, at the states that the filter has estimated. No run is simulated for it. The
filter's innovations are white; what a known signal would add to them is a regressor, with everything that the latent
forces would have taken for their own already gone from it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
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
