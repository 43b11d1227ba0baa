"""States and latent forces along a recording: an extended Kalman filter that runs the system itself.

The recording is cut into short segments. Each is simulated from the state that the filter has reached, with the latent
forces as they fade from there; along that run the system is linearised, and the filter estimates what the recorded
samples say about the deviation from it. So the linearisation point is never further off than a segment lets it drift,
contacts and friction included, and no drift outlives the next samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.state_estimation.linearisation import OF_SAMPLES, Lineariser, Tangent
from cobot_joint.diagnosis.state_estimation.native.kalman import Filtered, Steps, backward, forward
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

    piece: what was simulated, segment by segment; reference: (n, N), what the deviations are from, both as the segment
    has it that ends with the sample; ends: (segments,), the last sample of each.
    """

    recording: Recording
    piece: Piece
    reference: Array
    steps: Steps
    filtered: Filtered
    tangent: Tangent
    ends: NDArray[np.int64]

    @property
    def time(self) -> Array:
        """(n,), s"""
        return self.piece.time

    @property
    def x(self) -> Array:
        """(n, states)"""
        return self.piece.x

    @property
    def signals(self) -> Mapping[str, Array]:
        """`component.variable` or channel -> (n,)"""
        return self.piece.signals

    def __getitem__(self, segments: slice) -> Tracked:
        """A stretch of it."""
        first, end = (0, *self.ends)[segments.start], int(self.ends[segments.stop - 1]) + 1
        rows = slice(first, end)
        recording = replace(
            self.recording,
            time=self.recording.time[rows],
            inputs={name: u[rows] for name, u in self.recording.inputs.items()},
            outputs={name: y[rows] for name, y in self.recording.outputs.items()},
        )
        return Tracked(recording, self.piece[rows], self.reference[rows], self.steps[rows], self.filtered[rows],
                       self.tangent[rows], self.ends[segments] - first)  # fmt: skip


@dataclass(frozen=True)
class Smoothed:
    """Given all samples. x: followed states, (n, states); d: latents, (n, ports), d_sigma: their 1 sigma."""

    x: Array
    d: Array
    d_sigma: Array


class StateEstimator:
    """The filter of one system. noise: per channel. latents: at inputs of the system, those at a port that has one
    already behind all others. followed: states, by number. reached: (states,), see SampledSystem.along."""

    def __init__(
        self,
        sampled: SampledSystem,
        noise: Mapping[str, ChannelNoise],
        latents: Sequence[Latent],
        followed: Sequence[int],
        reached: Array,
        segment: float = SEGMENT,
    ) -> None:
        self.sampled, self.latents, self.segment = sampled, tuple(latents), segment
        self.reached = reached
        self.noise = [noise[channel] for channel in sampled.channels]
        self.followed = list(followed)
        self.ports = tuple(dict.fromkeys(latent.port for latent in latents))
        self.enters = [self.ports.index(latent.port) for latent in latents]
        self.lineariser = Lineariser(sampled, self.ports, followed)
        self.coloured = [j for j, noise in enumerate(self.noise) if noise.coloured]
        n_x, n_d, n_c = len(self.followed), len(self.latents), len(self.coloured)
        self.N = n_x + n_d + n_c
        self.x, self.d, self.c = slice(0, n_x), slice(n_x, n_x + n_d), slice(n_x + n_d, self.N)

    def with_latents(self, latents: Sequence[Latent]) -> StateEstimator:
        """The same filter with other sizes and times of the latent forces."""
        return StateEstimator(self.sampled, dict(zip(self.sampled.channels, self.noise, strict=True)), latents,
                              self.followed, self.reached, self.segment)  # fmt: skip

    def track(self, recording: Recording) -> Tracked:
        """Filter a recording. SimulationError: a unit fails at an estimated state; LostError: of its kind."""
        recording = recording.centred()
        time = recording.time - recording.time[0]
        x, d, z = self.sampled.start(recording.initial), np.zeros(len(self.latents)), np.zeros(self.N)
        P, (Q, R) = self._first_covariance(), self._noises(recording.step)
        recorded = np.column_stack([recording.outputs[c] for c in self.sampled.channels])
        room, likelihood = _Room(self, recorded, recording.step), 0.0
        ends = self._ends(recording)
        with self.sampled.along(time, recording.inputs, self.reached, self.ports, recording.held) as runs:
            for first, end in pairwise([0, *ends]):
                faded = self._faded(d, time[first : end + 1])
                piece = runs.run(x, slice(first, end + 1), self.entering(faded) if d.any() else None)
                room.put(first, piece, self.lineariser.tangent(piece), faded)
                rows = slice(first + (first > 0), end + 1)  # its first sample was the last one of the segment before
                if first:  # the new run begins where the old one's deviation led to
                    room.steps.jump[rows.start, : self.c.start] = -z[: self.c.start]
                found = forward(room.steps[rows], Q, R, z, P, first == 0, room.filtered[rows])
                likelihood += found.log_likelihood
                assert found.updated is not None
                z, P = found.updated[-1], found.P_end
                x = piece.x[-1].copy()
                x[self.followed] += z[self.x]
                d = faded[-1] + z[self.d]
        filtered = replace(room.filtered, P_end=P, log_likelihood=likelihood)
        assert room.tangent is not None
        whole = self.sampled.piece(time, room.table, {**recording.inputs, **self.entering(room.reference[:, self.d])})
        return Tracked(recording, whole, room.reference, room.steps, filtered, room.tangent, np.array(ends))

    def refilter(self, tracked: Tracked) -> Tracked:
        """The filter with these latents' sizes over the linearisation that another one ran along: no simulation."""
        steps = tracked.steps
        return replace(tracked, filtered=self._filter(steps, tracked.recording.step, Filtered.room(steps.H.shape)))

    def smooth(self, tracked: Tracked) -> Smoothed:
        """States and latent forces given the whole recording."""
        room = Filtered.room(tracked.steps.H.shape, covariances=True)
        found = backward(tracked.steps, self._filter(tracked.steps, tracked.recording.step, room))
        assert found.smoothed is not None
        assert found.variance is not None
        z = found.smoothed + tracked.reference
        return Smoothed(z[:, self.x], z[:, self.d], np.sqrt(found.variance[:, self.d]))

    def resized(self, tracked: Tracked, rows: slice = slice(None), found: Filtered | None = None) -> StateEstimator:
        """The filter with the latents' sizes nearer to the most likely ones, over a stretch of a recording. found: what
        this very filter has found there already.

        With q the variance of a latent's kicks, dL/dq = 1/2 sum(a^2 - M) (Koopman and Shephard 1992, Biometrika 79(1)):
        where the likelihood L is largest, q = q sum(a^2)/sum(M), which is iterated.
        """
        steps = tracked.steps[rows]
        if found is None:
            found = self._filter(steps, tracked.recording.step, Filtered.room(steps.H.shape, states=False))
        pulls = backward(steps, found, states=False)
        pull, certain = np.sum(pulls.a[1:, self.d] ** 2, axis=0), np.sum(pulls.M[1:, self.d], axis=0)
        gain = np.divide(pull, certain, out=np.zeros_like(pull), where=certain > SILENT * pull)
        factors = np.clip(gain, *CHANGE) ** (FASTER / 2)
        return self.with_latents(
            [replace(d, sigma=d.sigma * float(f)) for d, f in zip(self.latents, factors, strict=True)]
        )

    def _filter(self, steps: Steps, step: float, room: Filtered) -> Filtered:
        Q, R = self._noises(step)
        return forward(steps, Q, R, np.zeros(self.N), self._first_covariance(), room=room)

    def _ends(self, recording: Recording) -> list[int]:
        """The last sample of each segment."""
        every, last = max(1, round(self.segment / recording.step)), len(recording.time) - 1
        ends = list(range(every, last, every))
        while ends and last - ends[-1] < 2:  # no crumb behind
            ends.pop()
        return [*ends, last]

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

    def fading(self, step: float) -> Array:
        """What is left of each latent after so many seconds: (latents,)"""
        return np.array([np.exp(-step / latent.tau) for latent in self.latents])

    def _noises(self, step: float) -> tuple[Array, Array]:
        """Q: (N,) per sample, R: (channels,)"""
        drift = (DRIFT * self.sampled.nominal[self.followed]) ** 2 * step
        kicks = np.array([latent.sigma**2 for latent in self.latents]) * (1 - self.fading(step) ** 2)
        colour = [self.noise[j].coloured * (1 - self.noise[j].rho ** 2) for j in self.coloured]
        return np.concatenate([drift, kicks, colour]), np.array([n.white for n in self.noise])

    def _first_covariance(self) -> Array:
        states = (START * self.sampled.nominal[self.followed]) ** 2
        latents = [latent.sigma**2 for latent in self.latents]
        return np.diag(np.concatenate([states, latents, [self.noise[j].coloured for j in self.coloured]]))


class _Room:
    """For all samples of a recording, filled from segment to segment."""

    def __init__(self, estimator: StateEstimator, recorded: Array, step: float) -> None:
        """F = [[Phi, Gamma, 0], [0, e^(-h/tau), 0], [0, 0, rho]], H = [C, D, 1]"""
        self.estimator, self.recorded = estimator, recorded
        (n, m), N, n_x = recorded.shape, estimator.N, len(estimator.followed)
        coloured = estimator.coloured
        fade = np.concatenate([estimator.fading(step), [estimator.noise[j].rho for j in coloured]])
        self.steps = Steps(np.zeros((n, n_x, N)), fade, np.zeros((n, N)), np.zeros((n, m, N)), np.empty((n, m)))
        for column, j in enumerate(coloured, estimator.c.start):
            self.steps.H[:, j, column] = 1.0
        self.filtered = Filtered.room((n, m, N))
        self.reference = np.zeros((n, N))
        self.table = np.empty((n, len(estimator.sampled.layout.columns)))
        self.tangent: Tangent | None = None

    def put(self, first: int, piece: Piece, tangent: Tangent, faded: Array) -> None:
        """A segment from a sample on, which as the last one of the segment before is there already."""
        e, begin, end = self.estimator, int(first > 0), first + len(piece.time)
        rows, steps = slice(first + begin, end), slice(first, end - 1)
        if self.tangent is None:
            n = len(self.recorded)
            shapes = {f: (n - (f not in OF_SAMPLES), *M.shape[1:]) for f, M in tangent.__dict__.items()}
            self.tangent = Tangent(**{f: np.empty(shape) for f, shape in shapes.items()})
        for f, M in tangent.__dict__.items():
            if f in OF_SAMPLES:
                getattr(self.tangent, f)[rows] = M[begin:]
            else:
                getattr(self.tangent, f)[steps] = M
        after = slice(first + 1, end)
        self.steps.F[after, :, e.x], self.steps.F[after, :, e.d] = tangent.Phi, tangent.Gamma[:, :, e.enters]
        self.steps.H[rows, :, e.x], self.steps.H[rows, :, e.d] = tangent.C[begin:], tangent.D[begin:, :, e.enters]
        self.steps.r[rows] = self.recorded[rows] - piece.y[begin:]
        self.table[rows] = piece.table[begin:]
        self.reference[rows, e.x], self.reference[rows, e.d] = piece.x[begin:, e.followed], faded[begin:]
