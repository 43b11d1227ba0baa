"""States and latent forces along a recording: an extended Kalman filter that runs the system itself.

The recording is cut into short segments. Each is simulated from the state that the filter has reached, with the latent
forces as they fade from there; along that run the system is linearised, and the filter estimates what the recorded
samples say about the deviation from it. So the linearisation point is never further off than a segment lets it drift,
contacts and friction included, and no drift outlives the next samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.state_estimation.kalman import Filtered, Steps, backward, forward
from cobot_joint.diagnosis.state_estimation.linearisation import Lineariser, Tangent
from cobot_joint.diagnosis.state_estimation.noise import ChannelNoise
from cobot_joint.diagnosis.state_estimation.sampled import Piece, SampledSystem

Array = NDArray[np.float64]
SEGMENT = 0.05  # s, simulated from one estimate
START = 0.01  # 1 sigma of the states at the start, in their nominal values
DRIFT = 1e-5  # the same that they gather in a second beside the latent forces: linearisation is not exact
CHANGE = (1e-2, 1e2)  # of a latent's variance in one round
FASTER = 1.5  # power of that change, since what is not needed fades slowly
SILENT = 1e-12  # of what pulls at a latent that no channel shows, rounding alone


@dataclass(frozen=True)
class Latent:
    """A force, voltage or reading that no model explains, as an Ornstein-Uhlenbeck process at a port.

    cov d(t) d(t+s) = sigma^2 exp(-|s|/tau) (Uhlenbeck and Ornstein 1930, Phys. Rev. 36); sigma in the port's unit,
    tau: s.
    """

    port: str
    sigma: float
    tau: float = 0.05


@dataclass(frozen=True)
class Tracked:
    """A recording's filter run, n samples. z: the followed states, then the latents, then coloured noise.

    reference: (n, N), what the deviations are from, as the segment has it that ends with the sample; x: (n, states) and
    y: (n, channels): simulated from segment to segment; signals: `component.variable` or channel -> (n,).
    """

    recording: Recording
    time: Array
    x: Array
    y: Array
    signals: Mapping[str, Array]
    reference: Array
    steps: Steps
    filtered: Filtered
    tangents: tuple[Tangent, ...]


@dataclass(frozen=True)
class Smoothed:
    """Given all samples. x: followed states, (n, states); d: latents, (n, ports), d_sigma: their 1 sigma."""

    x: Array
    d: Array
    d_sigma: Array


class StateEstimator:
    """The filter of one system. noise: per channel. latents: at inputs of the system, those at a port that has one
    already behind all others. followed: states, by number."""

    def __init__(
        self,
        sampled: SampledSystem,
        noise: Mapping[str, ChannelNoise],
        latents: Sequence[Latent],
        followed: Sequence[int],
        segment: float = SEGMENT,
    ) -> None:
        self.sampled, self.latents, self.segment = sampled, tuple(latents), segment
        self.noise = [noise[channel] for channel in sampled.channels]
        self.followed = list(followed)
        self.ports = tuple(dict.fromkeys(latent.port for latent in latents))
        self._enters = [self.ports.index(latent.port) for latent in latents]
        self.lineariser = Lineariser(sampled, self.ports, followed)
        self._coloured = [j for j, noise in enumerate(self.noise) if noise.coloured]
        n_x, n_d, n_c = len(self.followed), len(self.latents), len(self._coloured)
        self.N = n_x + n_d + n_c
        self.x, self.d, self.c = slice(0, n_x), slice(n_x, n_x + n_d), slice(n_x + n_d, self.N)

    def with_latents(self, latents: Sequence[Latent]) -> StateEstimator:
        """The same filter with other sizes and times of the latent forces."""
        return StateEstimator(self.sampled, dict(zip(self.sampled.channels, self.noise, strict=True)), latents,
                              self.followed, self.segment)  # fmt: skip

    def track(self, recording: Recording) -> Tracked:
        """Filter a recording. SimulationError: a unit fails at an estimated state."""
        time = recording.time - recording.time[0]
        every = max(1, round(self.segment / recording.step))
        x = self.sampled.start(recording.initial)
        d, z, P = np.zeros(len(self.latents)), np.zeros(self.N), self._first_covariance()
        Q, R = self._noises(recording.step)
        recorded = np.column_stack([recording.outputs[c] for c in self.sampled.channels])
        pieces: list[Piece] = []
        fading: list[Array] = []
        steps: list[Steps] = []
        found: list[Filtered] = []
        tangents: list[Tangent] = []
        last = len(time) - 1
        for first in range(0, last, every):
            end = min(first + every, last)
            if last - end < 2:  # no crumb behind
                end = last
            piece = self._run(x, d, time[first : end + 1], {n: u[first : end + 1] for n, u in recording.inputs.items()})
            tangent = self.lineariser.tangent(piece)
            begins = first == 0
            step = self._steps(piece, tangent, recorded[first : end + 1], recording.step)
            if not begins:  # its first sample was the last one of the segment before
                step = Steps(step.F[1:], step.jump[1:], step.H[1:], step.r[1:])
                step.jump[0] = -z  # the new run begins where the old one's deviation led to
                step.jump[0][self.c] = 0
            filtered = forward(step, Q, R, z, P, begins)
            z, P = filtered.updated[-1], filtered.P_end
            x = piece.x[-1].copy()
            x[self.followed] += z[self.x]
            faded = self._faded(d, piece.time)
            d = faded[-1] + z[self.d]
            pieces.append(piece)
            fading.append(faded)
            steps.append(step)
            found.append(filtered)
            tangents.append(tangent)
            if end == last:
                break
        return self._joined(recording, time, pieces, steps, found, tangents, fading)

    def refilter(self, tracked: Tracked) -> Tracked:
        """The filter with these latents' sizes over the linearisation that another one ran along: no simulation."""
        return replace(tracked, filtered=self._filter(tracked.steps, tracked.recording.step))

    def smooth(self, tracked: Tracked) -> Smoothed:
        """States and latent forces given the whole recording."""
        found = backward(tracked.steps, tracked.filtered)
        assert found.smoothed is not None
        assert found.variance is not None
        z = found.smoothed + tracked.reference
        return Smoothed(z[:, self.x], z[:, self.d], np.sqrt(found.variance[:, self.d]))

    def resized(self, tracked: Tracked, rows: slice) -> StateEstimator:
        """The filter with the latents' sizes nearer to the most likely ones, over a stretch of a recording.

        With q the variance of a latent's kicks, dL/dq = 1/2 sum(a^2 - M) (Koopman and Shephard 1992, Biometrika 79(1)):
        where the likelihood L is largest, q = q sum(a^2)/sum(M), which is iterated.
        """
        steps = tracked.steps[rows]
        found = backward(steps, self._filter(steps, tracked.recording.step), states=False)
        pull, certain = np.sum(found.a[1:, self.d] ** 2, axis=0), np.sum(found.M[1:, self.d], axis=0)
        gain = np.divide(pull, certain, out=np.zeros_like(pull), where=certain > SILENT * pull)
        factors = np.clip(gain, *CHANGE) ** (FASTER / 2)
        return self.with_latents(
            [replace(d, sigma=d.sigma * float(f)) for d, f in zip(self.latents, factors, strict=True)]
        )

    def _filter(self, steps: Steps, step: float) -> Filtered:
        Q, R = self._noises(step)
        return forward(steps, Q, R, np.zeros(self.N), self._first_covariance())

    def _run(self, x: Array, d: Array, time: Array, inputs: Mapping[str, Array]) -> Piece:
        faded = self._faded(d, time)
        return self.sampled.run(x, time, {**inputs, **(self.entering(faded) if d.any() else {})})

    def entering(self, d: Array) -> dict[str, Array]:
        """Port -> (n,): of latents, (n, latents)"""
        found = {port: np.zeros(len(d)) for port in self.ports}
        for j, latent in enumerate(self.latents):
            found[latent.port] = found[latent.port] + d[:, j]
        return found

    def _faded(self, d: Array, time: Array) -> Array:
        """Means of the latents over a segment: (n, latents)"""
        tau = np.array([latent.tau for latent in self.latents])
        return np.asarray(d * np.exp(-(time - time[0])[:, None] / tau))

    def _fading(self, step: float) -> Array:
        return np.array([np.exp(-step / latent.tau) for latent in self.latents])

    def _steps(self, piece: Piece, tangent: Tangent, recorded: Array, step: float) -> Steps:
        """F = [[Phi, Gamma, 0], [0, e^(-h/tau), 0], [0, 0, rho]], H = [C, D, 1]"""
        n, m = recorded.shape
        F, H = np.zeros((n, self.N, self.N)), np.zeros((n, m, self.N))
        F[0] = np.eye(self.N)
        F[1:, self.x, self.x], F[1:, self.x, self.d] = tangent.Phi, tangent.Gamma[:, :, self._enters]
        F[1:, self.d, self.d] = np.diag(self._fading(step))
        H[:, :, self.x], H[:, :, self.d] = tangent.C, tangent.D[:, :, self._enters]
        for column, j in enumerate(self._coloured, self.c.start):
            F[1:, column, column] = self.noise[j].rho
            H[:, j, column] = 1.0
        return Steps(F, np.zeros((n, self.N)), H, recorded - piece.y)

    def _noises(self, step: float) -> tuple[Array, Array]:
        """Q: (N,) per sample, R: (channels,)"""
        drift = (DRIFT * self.sampled.nominal[self.followed]) ** 2 * step
        kicks = np.array([latent.sigma**2 for latent in self.latents]) * (1 - self._fading(step) ** 2)
        colour = [self.noise[j].coloured * (1 - self.noise[j].rho ** 2) for j in self._coloured]
        return np.concatenate([drift, kicks, colour]), np.array([n.white for n in self.noise])

    def _first_covariance(self) -> Array:
        states = (START * self.sampled.nominal[self.followed]) ** 2
        latents = [latent.sigma**2 for latent in self.latents]
        return np.diag(np.concatenate([states, latents, [self.noise[j].coloured for j in self._coloured]]))

    def _joined(
        self,
        recording: Recording,
        time: Array,
        pieces: Sequence[Piece],
        steps: Sequence[Steps],
        found: Sequence[Filtered],
        tangents: Sequence[Tangent],
        fading: Sequence[Array],
    ) -> Tracked:
        def whole(parts: Sequence[Array]) -> Array:
            return np.concatenate([parts[0], *(p[1:] for p in parts[1:])])

        x = whole([p.x for p in pieces])
        latents = whole(fading)
        reference = np.concatenate(
            [x[:, self.followed], latents, np.zeros((len(x), self.c.stop - self.c.start))], axis=1
        )
        fields = ("F", "jump", "H", "r")
        joined = Steps(*(np.concatenate([getattr(s, f) for s in steps]) for f in fields))
        predicted, updated, P, e, precision, K = (
            np.concatenate([getattr(f, part) for f in found])
            for part in ("predicted", "updated", "P", "e", "precision", "K")
        )
        likelihood = sum(f.log_likelihood for f in found)
        filtered = Filtered(predicted, updated, P, e, precision, K, found[-1].P_end, likelihood)
        signals = {name: whole([p.signals[name] for p in pieces]) for name in pieces[0].signals}
        return Tracked(recording, time, x, whole([p.y for p in pieces]), signals, reference, joined, filtered,
                       tuple(tangents))  # fmt: skip
