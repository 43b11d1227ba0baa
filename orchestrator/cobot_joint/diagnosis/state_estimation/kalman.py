"""Linear Gaussian filtering and smoothing of deviations from a reference, sample by sample.

z[k] = F[k] (z[k-1] + jump[k]) + w[k],  r[k] = H[k] z[k] + v[k];  cov w = Q, cov v = R, diagonal.

Filter: Kalman 1960, J. Basic Eng. 82(1). Smoother: the modified form of Bryson and Frazier 1963 by Bierman 1973,
Automatica 9(3), which inverts no covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Steps:
    """n samples of N deviations and m channels. F: (n, N, N), jump: (n, N), H: (n, m, N); r: (n, m), NaN: not recorded."""

    F: Array
    jump: Array
    H: Array
    r: Array

    def __len__(self) -> int:
        return len(self.r)


@dataclass(frozen=True)
class Filtered:
    """What a filter found. Predicted from earlier samples, updated with the present one.

    predicted, updated: (n, N); P: covariance of `predicted`, (n, N, N); e: innovations, (n, m), 0 where not recorded;
    S_inv: inverse of their covariance, (n, m, m), 0 where not recorded; K: (n, N, m); P_end: covariance of the last
    `updated`; log_likelihood: of the innovations.
    """

    predicted: Array
    updated: Array
    P: Array
    e: Array
    S_inv: Array
    K: Array
    P_end: Array
    log_likelihood: float


def forward(steps: Steps, Q: Array, R: Array, z: Array, P: Array, begins: bool = True) -> Filtered:
    """Q: (N, N), R: (m,), z: (N,), P: (N, N). begins: the first sample is where z and P belong, nothing moves before."""
    n, m, N = steps.H.shape
    predicted, updated, Ps = np.empty((n, N)), np.empty((n, N)), np.empty((n, N, N))
    es, S_invs, Ks = np.zeros((n, m)), np.zeros((n, m, m)), np.zeros((n, N, m))
    known = np.isfinite(steps.r)
    complete = known.all(axis=1)
    noise, log_likelihood = np.diag(R), 0.0
    for k in range(n):
        if k > 0 or not begins:
            F = steps.F[k]
            z = F @ (z + steps.jump[k])
            P = F @ P @ F.T + Q
        predicted[k], Ps[k] = z, P
        if complete[k]:
            H = steps.H[k]
            PH = P @ H.T
            S = H @ PH + noise
            S_inv = np.linalg.inv(S)
            e = steps.r[k] - H @ z
            K = PH @ S_inv
            es[k], S_invs[k], Ks[k] = e, S_inv, K
        elif known[k].any():
            on = known[k]
            H = steps.H[k][on]
            PH = P @ H.T
            S = H @ PH + noise[np.ix_(on, on)]
            S_inv = np.linalg.inv(S)
            e = steps.r[k][on] - H @ z
            K = PH @ S_inv
            es[k, on], S_invs[k][np.ix_(on, on)], Ks[k][:, on] = e, S_inv, K
        else:
            updated[k] = z
            continue
        z = z + K @ e
        P = P - K @ PH.T
        P = (P + P.T) / 2
        updated[k] = z
        log_likelihood -= 0.5 * (np.linalg.slogdet(S)[1] + e @ S_inv @ e)
    return Filtered(predicted, updated, Ps, es, S_invs, Ks, P, float(log_likelihood))


def backward(steps: Steps, found: Filtered) -> tuple[Array, Array]:
    """Deviations given all samples, (n, N), and their variances, (n, N).

    a: how the later innovations pull at the present one; with G = I - K H,
    a = H' S^-1 e + G' a+,  M = H' S^-1 H + G' M+ G,  z = z_predicted + P a,  cov z = P - P M P;  a+ = F' a of the next.
    """
    n, _, N = steps.H.shape
    smoothed, variance = np.empty((n, N)), np.empty((n, N))
    a, M, eye = np.zeros(N), np.zeros((N, N)), np.eye(N)
    for k in range(n - 1, -1, -1):
        H, P = steps.H[k], found.P[k]
        G = eye - found.K[k] @ H
        HS = H.T @ found.S_inv[k]
        a = HS @ found.e[k] + G.T @ a
        M = HS @ H + G.T @ M @ G
        smoothed[k] = found.predicted[k] + P @ a
        PM = P @ M
        variance[k] = np.diagonal(P) - np.einsum("ij,ji->i", PM, P)
        F = steps.F[k]
        a, M = F.T @ a, F.T @ M @ F
    return smoothed, np.maximum(variance, 0.0)
