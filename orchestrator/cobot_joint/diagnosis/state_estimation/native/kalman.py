"""Linear Gaussian filtering and smoothing of deviations from a reference, sample by sample: kalman.c.

z[k] = F[k] (z[k-1] + jump[k]) + w[k],  r[k] = H[k] z[k] + v[k];  cov w = diag Q, cov v = diag R.
The last deviations fade by themselves: F = [F_x; 0 diag fade].

Filter: Kalman 1960, J. Basic Eng. 82(1), channel after channel. Smoother: Bryson and Frazier's in the modified form,
which inverts no covariance.
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double, c_int, c_size_t, c_void_p
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import library

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Steps:
    """n samples, N deviations, m channels. F: (n, n_x, N), the upper rows; fade: (N - n_x,), the others' diagonal;
    jump: (n, N), H: (n, m, N); r: (n, m), NaN: not recorded."""

    F: Array
    fade: Array
    jump: Array
    H: Array
    r: Array

    def __getitem__(self, rows: slice) -> Steps:
        """A stretch of them."""
        return Steps(self.F[rows], self.fade, self.jump[rows], self.H[rows], self.r[rows])


@dataclass(frozen=True)
class Filtered:
    """What a filter found. Predicted from earlier samples, updated with the present one.

    predicted, updated: (n, N); P: covariance of `predicted`, (n, N, N); all None where only innovations were asked for.
    Of channels one by one: e: innovations, (n, m), precision: 1/variance, (n, m), both 0 where not recorded, K: gains,
    (n, m, N). P_end: covariance of the last `updated`; log_likelihood: of the innovations, but for its constant.
    """

    predicted: Array | None
    updated: Array | None
    P: Array | None
    e: Array
    precision: Array
    K: Array
    P_end: Array
    log_likelihood: float = 0.0

    @classmethod
    def room(cls, shape: tuple[int, int, int], states: bool = True, covariances: bool = False) -> Filtered:
        """For n samples, m channels, N deviations."""
        n, m, N = shape
        predicted, updated = (np.empty((n, N)) if states else None for _ in range(2))
        P = np.empty((n, N, N)) if covariances else None
        return cls(predicted, updated, P, np.empty((n, m)), np.empty((n, m)), np.empty((n, m, N)), np.empty((N, N)))

    def __getitem__(self, rows: slice) -> Filtered:
        """A stretch of them, without its likelihood."""
        predicted, updated, P = (None if x is None else x[rows] for x in (self.predicted, self.updated, self.P))
        return Filtered(predicted, updated, P, self.e[rows], self.precision[rows], self.K[rows], self.P_end)

    @property
    def white(self) -> Array:
        """Innovations over their standard deviations, independent where the model holds: (n, m)"""
        return np.asarray(self.e * np.sqrt(self.precision))


@dataclass(frozen=True)
class Adjoint:
    """How the innovations from a sample on pull at the prediction there: with G = I - K H, and of the sample after
    a+ = F' a, M+ = F' M F,

    a = H' S^-1 e + G' a+,  M = H' S^-1 H + G' M+ G,  z = z_predicted + P a,  cov z = P - P M P

    a: (n, N); M: its covariance where the model holds, the diagonal, (n, N); smoothed: deviations given all samples,
    (n, N); variance: theirs, (n, N); None where not asked for.
    """

    a: Array
    M: Array
    smoothed: Array | None
    variance: Array | None


class _Steps(ctypes.Structure):
    _fields_ = [
        *((f, c_size_t) for f in ("n", "m", "N", "n_x")),
        *((f, c_void_p) for f in ("F", "fade", "jump", "H", "r")),
    ]


class _Filtered(ctypes.Structure):
    _fields_ = [
        *((f, c_void_p) for f in ("predicted", "updated", "P", "e", "precision", "K")),
        ("log_likelihood", c_double),
    ]


def forward(
    steps: Steps, Q: Array, R: Array, z: Array, P: Array, begins: bool = True, room: Filtered | None = None
) -> Filtered:
    """Q: (N,), R: (m,), z: (N,), P: (N, N). begins: z and P belong to the first sample. room: is filled; None: all."""
    found = room or Filtered.room(steps.H.shape, covariances=True)
    out, arrays = _filtered(found), _contiguous(steps)
    Q, R, z = np.ascontiguousarray(Q), np.ascontiguousarray(R), np.array(z)
    found = replace(found, P_end=np.array(P))
    _check(_typed_library().kalman_forward(
        ctypes.byref(_steps(arrays)), Q.ctypes.data, R.ctypes.data, begins, z.ctypes.data, found.P_end.ctypes.data,
        ctypes.byref(out),
    ))  # fmt: skip
    return replace(found, log_likelihood=float(out.log_likelihood))


def backward(steps: Steps, found: Filtered, states: bool = True) -> Adjoint:
    """The smoother over what the filter has found. states: whether deviations and their variances are asked for, which
    takes its P."""
    assert not states or found.P is not None
    arrays = _contiguous(steps)
    a, M = np.empty_like(steps.jump), np.empty_like(steps.jump)
    out = Adjoint(a, M, np.empty_like(a) if states else None, np.empty_like(a) if states else None)
    _check(_typed_library().kalman_backward(
        ctypes.byref(_steps(arrays)), ctypes.byref(_filtered(found)),
        *(None if x is None else x.ctypes.data for x in out.__dict__.values()),
    ))  # fmt: skip
    return out


def respond(steps: Steps, found: Filtered, psi: Array, direct: Array, out: Array | None = None) -> Array:
    """White innovations that known signals would add, had the filter not known of them: (n, m, p).

    psi: (n - 1, n_x, p), what each adds to the first n_x deviations from sample to sample; direct: to the channels,
    (n, m, p). out: is filled, columns of an array in C order; None: a new one.
    """
    n, m, _ = steps.H.shape
    p, arrays = direct.shape[2], _contiguous(steps)
    out = np.empty((n, m, p)) if out is None else out
    width = out.strides[1] // out.itemsize
    assert out.shape == (n, m, p)
    assert p == 0 or out.strides == (m * width * out.itemsize, width * out.itemsize, out.itemsize)
    psi, direct = np.ascontiguousarray(psi), np.ascontiguousarray(direct)
    _check(_typed_library().kalman_respond(
        ctypes.byref(_steps(arrays)), ctypes.byref(_filtered(found)), p, psi.shape[1], psi.ctypes.data,
        direct.ctypes.data, width, out.ctypes.data,
    ))  # fmt: skip
    return out


def _contiguous(steps: Steps) -> Steps:
    arrays = (steps.F, steps.fade, steps.jump, steps.H, steps.r)
    return Steps(*(np.ascontiguousarray(x, dtype=np.float64) for x in arrays))


def _steps(steps: Steps) -> _Steps:
    """Points into the arrays, which have to outlive it."""
    arrays = (steps.F, steps.fade, steps.jump, steps.H, steps.r)
    return _Steps(*steps.H.shape, steps.F.shape[1], *(x.ctypes.data for x in arrays))


def _filtered(found: Filtered) -> _Filtered:
    arrays = (found.predicted, found.updated, found.P, found.e, found.precision, found.K)
    assert all(x is None or x.flags.c_contiguous for x in arrays)
    return _Filtered(*(None if x is None else x.ctypes.data for x in arrays), 0.0)


def _check(status: int) -> None:
    if status:
        raise MemoryError("the Kalman filter")


@cache
def _typed_library() -> ctypes.CDLL:
    loaded = library.load()
    steps, filtered = POINTER(_Steps), POINTER(_Filtered)
    loaded.kalman_forward.argtypes = [steps, c_void_p, c_void_p, c_int, c_void_p, c_void_p, filtered]
    loaded.kalman_backward.argtypes = [steps, filtered, *[c_void_p] * 4]
    loaded.kalman_respond.argtypes = [steps, filtered, *[c_size_t] * 2, *[c_void_p] * 2, c_size_t, c_void_p]
    return loaded
