"""A correction of outputs instead of the system, which a baseline may leave beside a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from cobot_joint.diagnosis.archive import DamagedError, load
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.repair.compare import Simulator as Simulate
from cobot_joint.errors import UserError

DISCREPANCY = "discrepancy.npz"


@dataclass(frozen=True)
class Process:
    """A fitted Gaussian process's mean over d signals, from n samples (Rasmussen and Williams 2006, eq. 2.25, 5.1)."""

    mean: NDArray[np.float64]  # of each signal, (d,)
    scale: NDArray[np.float64]  # (d,)
    lengths: NDArray[np.float64]  # of the kernel, in scaled signals, (d,)
    variance: float  # of the kernel
    samples: NDArray[np.float64]  # scaled, (n, d)
    weights: NDArray[np.float64]  # (K + sigma^2 I)^-1 y, (n,)
    offset: float  # of y
    gain: float

    def __call__(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Its mean at z (m, d): (m,)."""
        # k(u, v) = variance*exp(-|(u - v)/lengths|^2/2);  f(u) = offset + gain*sum_j k(u, u_j) weights_j
        u = (z - self.mean) / self.scale / self.lengths
        kernel = self.variance * np.exp(-0.5 * cdist(u, self.samples / self.lengths, "sqeuclidean"))
        return np.asarray(self.offset + self.gain * (kernel @ self.weights))


@dataclass(frozen=True)
class Discrepancy:
    """recording - simulation as a function of inputs and simulated outputs at the same time, per channel."""

    signals: tuple[str, ...]
    models: Mapping[str, Process]  # by channel

    def around(self, simulate: Simulate) -> Simulate:
        """The simulator with the discrepancy added."""

        def corrected(recording: Recording) -> Mapping[str, NDArray[np.float64]]:
            simulated = dict(simulate(recording))
            z = local_signals(self.signals, recording, simulated)
            return {name: y + (self.models[name](z) if name in self.models else 0) for name, y in simulated.items()}

        return corrected


def local_signals(
    names: tuple[str, ...], recording: Recording, simulated: Mapping[str, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """What a discrepancy may depend on: (n, len(names)); 0 where a set-up has no such signal."""
    have = {**recording.inputs, **simulated}
    return np.column_stack([have.get(name, np.zeros(len(recording.time))) for name in names])


def read_discrepancy(folder: Path) -> Discrepancy | None:
    """What a baseline left there, or None. UserError: it is damaged, or a pickle, which nobody should read."""
    path = folder / DISCREPANCY
    if (old := path.with_suffix(".joblib")).is_file() and not path.is_file():
        raise UserError(
            f"{old}: a pickle is given, {DISCREPANCY} is allowed; run cobot-joint diagnose --baseline again"
        )
    try:
        found = load(path, DISCREPANCY)
    except FileNotFoundError:
        return None
    except DamagedError as error:
        raise UserError(f"{path}: {error}; run cobot-joint diagnose --baseline again") from error
    if not isinstance(found, Discrepancy):
        raise UserError(f"{path}: holds no discrepancy; run cobot-joint diagnose --baseline again")
    return found
