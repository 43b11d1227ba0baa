"""What a term is worth beside the latent forces: its answer in the filter's innovations, and the likelihoods' ratio.

Along the trajectory that the recording shows, a switched-off term is a signal: what a unit of its amplitude adds to the
derivatives of states and to readings, at the states that the filter has estimated. No run is simulated for it. The filter's
innovations are white; what a known signal would add to them is a regressor, with everything that the latent forces would
have taken for their own already gone from it (augmented Kalman filter: de Jong 1991, Annals of Statistics 19(2)).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.plant.plant import TermCandidate
from cobot_joint.diagnosis.state_estimation.estimator import StateEstimator, Tracked
from cobot_joint.diagnosis.state_estimation.kalman import respond
from cobot_joint.diagnosis.state_estimation.sampled import Piece
from cobot_joint.system.model import Value

Array = NDArray[np.float64]
TURN = 0.7  # rad by which a periodic term may turn between two points at which it is looked at
MOST_POINTS = 6  # of these between two samples
PROBE = 1e-3  # of an amplitude's range, where a term acts through states of its own
LONE = 1e-9  # of the innovations' squares: less is no answer


@dataclass(frozen=True)
class Tracking:
    """A recording's filter run with the filter that made it."""

    estimator: StateEstimator
    tracked: Tracked


@dataclass(frozen=True)
class Effect:
    """What a unit of something known does in each tracking: psi: (n - 1, states, columns), direct: (n, channels, columns)"""

    psi: Sequence[Array]
    direct: Sequence[Array]


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
    """Recordings of one machine, tracked. tolerances: `component.parameter` -> 1 sigma of what it may be off."""

    def __init__(self, trackings: Sequence[Tracking], tolerances: Mapping[str, float]) -> None:
        self.trackings = list(trackings)
        self.tolerances = dict(tolerances)
        self._white = [t.tracked.filtered.white.ravel() for t in self.trackings]
        self._pieces = [Piece(t.tracked.time, t.tracked.x, t.tracked.y, _inputs(t), t.tracked.signals)
                        for t in self.trackings]  # fmt: skip
        self._parameters = [name for name in tolerances if any(self._has(t, name) for t in self.trackings)]
        self.base = Effect(*zip(*(self._of_parameters(n) for n in range(len(self.trackings))), strict=True))
        self._base = _Columns(self, self.base)
        prior = np.array([1 / self.tolerances[name] ** 2 for name in self._parameters])
        self._held = np.linalg.inv(self._base.gram + np.diag(prior)) if len(prior) else np.zeros((0, 0))

    def score(self, terms: Sequence[TermCandidate], refined: int = 0) -> list[TermScore]:
        """Best first. refined: how many of the best get their evidence, with the latent forces' sizes estimated again."""
        found = [best for term in terms if (best := self._best(term)) is not None]
        found.sort(key=lambda score: -score.gain)
        return found

    def gls(self, effect: Effect) -> tuple[Array, Array, float]:
        """Generalised least squares beside base parameters: coefficients, their covariance, gain in 2 log likelihood."""
        columns = _Columns(self, effect)
        cross = self._base.white.T @ columns.white if self._parameters else np.zeros((0, columns.white.shape[1]))
        rest = columns.white.T @ self.innovations - cross.T @ self._held @ self._base.gradient
        gram = columns.gram - cross.T @ self._held @ cross
        scale = np.sqrt(np.maximum(np.diag(columns.gram), 1e-300))
        covariance = np.linalg.pinv(gram / np.outer(scale, scale), rcond=1e-6, hermitian=True) / np.outer(scale, scale)
        coefficients = covariance @ rest
        return coefficients, covariance, float(rest @ coefficients)

    @property
    def innovations(self) -> Array:
        """White, of all recordings: (rows,)"""
        return np.concatenate(self._white)

    def signal(self, port: str, values: Sequence[Array]) -> Effect:
        """Of known signals at a port that is a latent's: values: per recording (2n - 1, columns), at the samples and
        halfway between them."""
        psi, direct = [], []
        for t, v in zip(self.trackings, values, strict=True):
            j = t.estimator.ports.index(port)
            step = t.estimator.d.start + j
            mean = (v[:-2:2] + 4 * v[1:-1:2] + v[2::2]) / 6
            psi.append(t.tracked.steps.F[1:, t.estimator.x, step][:, :, None] * mean[:, None, :])
            direct.append(t.tracked.steps.H[:, :, step][:, :, None] * v[::2][:, None, :])
        return Effect(psi, direct)

    def _best(self, term: TermCandidate) -> TermScore | None:
        """The shapes with the largest gain; None: no recording answers to it."""
        best: TermScore | None = None
        size = float(self.innovations @ self.innovations)
        for shapes in _combinations(term):
            effect = self._of_term(term, shapes)
            columns = _Columns(self, effect)
            if not np.any(columns.gram):
                continue
            theta, covariance, gain = self.gls(effect)
            if not np.isfinite(gain) or gain < LONE * size or (best and gain <= best.gain):
                continue
            amplitude, phase = (theta[0], None) if len(theta) == 1 else (np.hypot(*theta), np.arctan2(theta[1], theta[0]))
            sigma = float(np.sqrt(np.trace(covariance) / len(theta)))
            best = TermScore(term.name, shapes, float(amplitude), sigma, phase, gain)
        return best

    def _of_term(self, term: TermCandidate, shapes: Mapping[str, float]) -> Effect:
        psi, direct = [], []
        for n, t in enumerate(self.trackings):
            if not self._has(t, term.name):
                n_x, m = t.estimator.x.stop, len(t.estimator.sampled.channels)
                width = 1 + (term.phase is not None)
                psi.append(np.zeros((len(t.tracked.time) - 1, n_x, width)))
                direct.append(np.zeros((len(t.tracked.time), m, width)))
                continue
            phases: list[dict[str, Value]] = [{}]
            if term.phase is not None:
                phases = [{term.phase: 0.0}, {term.phase: np.pi / 2}]
            parts = [self._of_amplitude(n, term, {**shapes, **phase}) for phase in phases]
            psi.append(np.stack([p for p, _ in parts], axis=-1))
            direct.append(np.stack([d for _, d in parts], axis=-1))
        return Effect(psi, direct)

    def _of_amplitude(self, n: int, term: TermCandidate, values: Mapping[str, Value]) -> tuple[Array, Array]:
        """(n - 1, states), (n, channels): of a unit of a term's amplitude, at its neutral value."""
        t, piece = self.trackings[n], self._pieces[n]
        sampled, lineariser = t.estimator.sampled, t.estimator.lineariser
        h = float(piece.time[1] - piece.time[0])
        order = max((float(v) for name, v in values.items() if _is_order(term, name)), default=0.0)
        points = 2
        if order:
            moved = np.abs(np.diff(t.tracked.x[:, _angles(t, term)], axis=0)).max(initial=0.0)
            points = int(np.clip(np.ceil(order * moved / TURN), 2, MOST_POINTS))
        x = t.tracked.x
        at = (np.arange(points) + 0.5) / points if order else np.array([0.0, 1.0])
        inner, outer = 0.0, 0.0
        for share in at:
            inside = x[:-1] + share * (x[1:] - x[:-1])
            F, G = lineariser.added(term.amplitude, values, piece.time[:-1] + share * h, inside, piece)
            inner, outer = inner + F / len(at), outer + G / len(at)
        T = np.concatenate([tangent.T for tangent in t.tracked.tangents])
        S = np.concatenate([t.tracked.tangents[0].S, *(tangent.S[1:] for tangent in t.tracked.tangents[1:])])
        Hold = np.concatenate([tangent.Hold for tangent in t.tracked.tangents])
        psi = np.einsum("kij,kj->ki", Hold, inner + np.einsum("kij,kj->ki", T, outer))
        _, G = lineariser.added(term.amplitude, values, piece.time, x, piece)
        assert sampled is t.estimator.sampled
        return psi, np.einsum("kij,kj->ki", S, G)

    def _of_parameters(self, n: int) -> tuple[Array, Array]:
        t, piece = self.trackings[n], self._pieces[n]
        parts = []
        for name in self._parameters:
            if self._has(t, name):
                candidate = TermCandidate(name, "", "", name, 0.0, -np.inf, np.inf, "")
                parts.append(self._of_amplitude(n, candidate, {}))
            else:
                parts.append((np.zeros((len(t.tracked.time) - 1, t.estimator.x.stop)), np.zeros_like(t.tracked.y)))
        psi = [p for p, _ in parts] or [np.zeros((len(t.tracked.time) - 1, t.estimator.x.stop, 0))]
        direct = [d for _, d in parts] or [np.zeros((*t.tracked.y.shape, 0))]
        return (np.stack(psi, axis=-1), np.stack(direct, axis=-1)) if parts else (psi[0], direct[0])

    @staticmethod
    def _has(t: Tracking, name: str) -> bool:
        return any(c.name == name.split(".")[0] for c in t.estimator.sampled.system.components)


class _Columns:
    """An effect in the innovations: white: (rows, columns), and its products."""

    def __init__(self, evidence: Evidence, effect: Effect) -> None:
        parts = [
            respond(t.tracked.steps, t.tracked.filtered, psi, direct).reshape(-1, direct.shape[2])
            for t, psi, direct in zip(evidence.trackings, effect.psi, effect.direct, strict=True)
        ]
        self.white = np.concatenate(parts)
        self.gram = self.white.T @ self.white
        self.gradient = self.white.T @ np.concatenate([t.tracked.filtered.white.ravel() for t in evidence.trackings])


def _combinations(term: TermCandidate) -> Iterator[dict[str, float]]:
    for values in product(*(shape.values for shape in term.shapes)):
        yield {shape.name: value for shape, value in zip(term.shapes, values, strict=True)}


def _is_order(term: TermCandidate, name: str) -> bool:
    return any(shape.name == name and shape.whole for shape in term.shapes)


def _angles(t: Tracking, term: TermCandidate) -> list[int]:
    """States of the term's unit that are angles."""
    unit = t.estimator.sampled.system.component(term.component).unit
    return [
        j
        for j, s in enumerate(t.estimator.sampled.states)
        if s.component == term.component and unit.unit_of(s.variable) == "rad"
    ]


def _inputs(t: Tracking) -> dict[str, Array]:
    latents = t.tracked.reference[:, t.estimator.d]
    return {**t.tracked.recording.inputs, **{p: latents[:, j] for j, p in enumerate(t.estimator.ports)}}


__all__ = ["Effect", "Evidence", "TermScore", "Tracking", "replace"]
