"""When a residual changes: change points of its level and of its variance, by recording and channel (ruptures)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import ruptures

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.problem import Problem, Vector

WINDOW = 50  # samples of which level and variance are taken
SHORTEST = 5  # windows between two changes
MOST = 4  # per recording and channel
NEAR, MOVES = 0.3, 0.05  # s, and share of its span by which an input then moves


@dataclass(frozen=True)
class Change:
    """From `before` to `after`: chi-square per sample, 1 is noise.

    driven: an input moves at that time, so that it need not be an onset of anything.
    """

    recording: str
    channel: str
    time: float  # s, on the recording's clock
    before: float
    after: float
    driven: bool

    @property
    def size(self) -> float:
        """How many times more or less"""
        return float(max(self.before, self.after) / max(min(self.before, self.after), 1e-3))

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        return asdict(self)


def changes(problem: Problem, residual: Vector) -> list[Change]:
    """In the recordings' order, then by time. residual: whitened, (rows,)."""
    found = []
    for block in problem.blocks:
        recording = problem.recordings[block.recording]
        ends = _segments(residual[block.rows])
        chi2 = [float(np.mean(residual[block.rows][a:b] ** 2)) for a, b in pairwise([0, *ends])]
        for end, before, after in zip(ends[:-1], chi2[:-1], chi2[1:], strict=True):
            time = float(recording.time[end])
            change = Change(recording.name, block.channel, time, before, after, _driven(recording, time))
            if change.size > 1 + thresholds.NOTABLE_CHANGE:
                found.append(change)
    return found


def _driven(recording: Recording, time: float) -> bool:
    near = np.abs(recording.time - time) < NEAR
    return any(np.ptp(x[near]) > MOVES * np.ptp(x) for x in recording.inputs.values() if np.ptp(x) > 0)


def _segments(r: Vector) -> list[int]:
    """Ends of the stretches between changes, in samples; the last is the end of the recording."""
    windows = len(r) // WINDOW
    if windows < 2 * SHORTEST:
        return [len(r)]
    parts = r[: windows * WINDOW].reshape(windows, WINDOW)
    features = np.column_stack([np.sqrt(WINDOW) * parts.mean(axis=1), _log_variance(parts)])
    search = ruptures.Binseg(model="l2", min_size=SHORTEST, jump=1).fit(features / _scatter(features))
    ends = search.predict(pen=thresholds.CHANGE * np.log(windows))
    if len(ends) > MOST + 1:
        ends = search.predict(n_bkps=MOST)
    return [*(WINDOW * end for end in ends[:-1]), len(r)]


def _log_variance(parts: Vector) -> Vector:
    """Of unit variance where `parts` are white noise."""
    return np.asarray(np.sqrt(WINDOW / 2) * np.log(np.maximum(parts.var(axis=1), 1e-6)))


def _scatter(features: Vector) -> Vector:
    """From window to window: a change has to stand out of that, not of noise alone."""
    steps = np.abs(np.diff(features, axis=0))
    return np.maximum(1.0, 1.4826 * np.median(steps, axis=0) / np.sqrt(2))
