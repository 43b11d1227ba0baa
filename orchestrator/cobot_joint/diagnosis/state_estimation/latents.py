"""Where latent forces enter and how large they are, before and after a look at a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.state_estimation.estimator import Latent, StateEstimator, Tracked
from cobot_joint.diagnosis.state_estimation.linearisation import Jacobians, Lineariser
from cobot_joint.diagnosis.state_estimation.noise import ChannelNoise
from cobot_joint.diagnosis.state_estimation.sampled import Piece, SampledSystem

Array = NDArray[np.float64]
COARSE = 20  # samples between the points at which a free run is linearised
SLOW, QUICK = 2.0, 20.0  # rad/s; latent forces live up to the latter
STANDING = 0.2  # a port whose slow signals move this much less than quick ones: only what changes there is seen
ALIKE = 0.98  # cosine between two ports' responses from which one stands for both
FIRST = 3.0  # noise sigmas that a latent moves the channels by, before anything is known of it
ROUNDS = 6  # of re-estimating the sizes
STRETCH = 4.0  # s of a recording that they are estimated from


@dataclass(frozen=True)
class Structure:
    """What a system's free run says before filtering.

    followed: states that a channel or an angle depends on, by number. reached: (states,), their largest absolute
    values, no less than nominal. latents: one per port that these channels tell apart. alike: of such a port, the
    others it stands for.
    """

    followed: list[int]
    reached: Array
    latents: tuple[Latent, ...]
    alike: Mapping[str, tuple[str, ...]]


def structure(
    sampled: SampledSystem, piece: Piece, ports: Sequence[str], noise: Mapping[str, ChannelNoise]
) -> Structure:
    """Along a free run of a recording. ports: inputs of the system that are 0 when unused."""
    J = Lineariser(sampled, ports)(piece, slice(None, None, COARSE))
    followed = _followed(J, sampled.places)
    sigma = np.array([noise[c].sigma for c in sampled.channels])
    quick, slow = (_response(J, followed, omega, sampled.nominal, sigma) for omega in (QUICK, SLOW))
    size = np.sqrt(np.mean(np.sum(np.abs(slow) ** 2, axis=1), axis=0))  # (ports,)
    order = [j for j in range(len(ports)) if size[j] > STANDING * _norm(quick)[j] > 0]
    chosen: list[int] = []
    alike: dict[str, tuple[str, ...]] = {}
    for j in order:
        same = next((k for k in chosen if _cosine(quick, j, k) > ALIKE), None)
        if same is None:
            chosen.append(j)
            alike[ports[j]] = ()
        else:
            alike[ports[same]] += (ports[j],)
    reached = np.maximum(np.abs(piece.x).max(axis=0), sampled.nominal)
    return Structure(followed, reached, tuple(Latent(ports[j], FIRST / float(size[j])) for j in chosen), alike)


def with_sizes(estimator: StateEstimator, tracked: Tracked, rounds: int = ROUNDS) -> StateEstimator:
    """The filter with the latents' sizes as a stretch of the recording shows them, where it moves most."""
    n = round(STRETCH / tracked.recording.step)
    speed = np.sum((np.diff(tracked.x, axis=0) / estimator.sampled.nominal) ** 2, axis=1)
    busy = np.convolve(speed, np.ones(n), "valid") if len(speed) > n else np.zeros(1)
    first = int(np.argmax(busy))
    for _ in range(rounds):
        estimator = estimator.resized(tracked, slice(first, first + n))
    return estimator


def _followed(J: Jacobians, places: Sequence[int]) -> list[int]:
    """States that some channel or a shaft's angle depends on, by way of others or not: a wave that is off goes by an
    angle that nothing else may need."""
    A, reached = np.abs(J.A).max(axis=0) > 0, (np.abs(J.C).max(axis=0) > 0).any(axis=0)
    reached[list(places)] = True
    while (more := reached | A[reached].any(axis=0)).sum() > reached.sum():
        reached = more
    return [int(j) for j in np.flatnonzero(reached)]


def _response(J: Jacobians, followed: list[int], omega: float, nominal: Array, sigma: Array) -> NDArray[np.complex128]:
    """C (i omega - A)^-1 B + D over the channels' noise: (points, channels, ports)"""
    scale = nominal[followed]
    A = J.A[:, followed][:, :, followed] * scale / scale[:, None]
    B, C = J.B[:, followed] / scale[:, None], J.C[:, :, followed] * scale
    found = C @ np.linalg.solve(1j * omega * np.eye(len(followed)) - A, B) + J.D
    return np.asarray(found / sigma[:, None])


def _norm(response: NDArray[np.complex128]) -> Array:
    return np.asarray(np.sqrt(np.mean(np.sum(np.abs(response) ** 2, axis=1), axis=0)))


def _cosine(response: NDArray[np.complex128], j: int, k: int) -> float:
    a, b = response[:, :, j].ravel(), response[:, :, k].ravel()
    return float(abs(np.vdot(a, b)) / (np.linalg.norm(a) * np.linalg.norm(b)))
