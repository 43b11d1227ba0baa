"""Angles and speeds of a simulated run, put where the recording has them.

A free run that is off in speed drifts away from the recorded angle, and soon knows nothing of the phase at which a
tooth or a magnet was felt; a drag that the model lacks slows the machine down, and is as large as the slower speed has
it. What acts along a motion acts along the recorded one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d

from cobot_joint.cosim import Feedback
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.problem import Problem, Run, Vector
from cobot_joint.diagnosis.plant.plant import Signals

FOLLOWS = 0.02  # of its range, to which a signal goes along with a channel or with the channel's integral
SMOOTHED = 0.02  # s, sigma of what takes the noise from a channel's deviation
PERIOD = 0.02  # s, at which a wave is put at its angle anew: it slips by some rad in as many seconds


def along_recording(recording: Recording, simulated: Signals, motion: Sequence[str]) -> Signals:
    """The signals, those of `motion` (angles, speeds) moved by as much as the channel that each goes along with is off.

    simulated: the recording's channels and these signals, (n,) each. What no channel goes along with stays.
    """
    moved = dict(simulated)
    ways = [way for channel in recording.outputs for way in _ways(recording, simulated, channel)]
    for name in (m for m in motion if m in simulated and np.ptp(simulated[m]) > 0):
        x = simulated[name]
        slopes = [_slope(way, x) for way, _ in ways]
        left = [float(np.ptp(x - slope * way)) for slope, (way, _) in zip(slopes, ways, strict=True)]
        k = int(np.argmin(left)) if left else -1
        if left and left[k] < FOLLOWS * np.ptp(x):
            moved[name] = x + slopes[k] * ways[k][1]
    return moved


def _ways(recording: Recording, simulated: Signals, channel: str) -> list[tuple[Vector, Vector]]:
    """(as simulated, recorded less simulated) of a channel and of its integral. Gaps count as equal."""
    y, step = simulated[channel], recording.step
    off = gaussian_filter1d(np.nan_to_num(recording.outputs[channel] - y), SMOOTHED / step, mode="nearest")
    return [(y, off), (integral(y, step), integral(off, step))]


def integral(x: Vector, step: float) -> Vector:
    """From the first sample on, by trapezoids: (n,)"""
    return np.asarray(cumulative_trapezoid(x, dx=step, initial=0.0))


def _slope(way: Vector, x: Vector) -> float:
    """Of a signal over what a channel says, each less its mean."""
    centred = way - way.mean()
    return float(centred @ x / max(float(centred @ centred), 1e-300))


@dataclass(frozen=True)
class WaveAlongRecording(ActiveTerm):
    """A listed wave that acts at the angle of the recordings, wherever a run of its own has it.

    angle: recording -> (s since it began, recorded angle in rad), (n,) each, every PERIOD.
    """

    angle: Mapping[str, tuple[Vector, Vector]] = field(default_factory=dict)

    def apply(self, run: Run, x: Vector) -> Run:
        """With its parameters in the run, and its phase ahead by as much as the recorded angle is."""
        values, phase, courses = self._values(x), str(self.term.phase), dict(run.courses)
        n = self.term.periods(values)
        for recording, (time, phi) in self.angle.items():
            own = [(t, Feedback(str(self.term.angle), partial(_phase, values[phase], n, recorded)))
                   for t, recorded in zip(time.tolist(), phi.tolist(), strict=True)]  # fmt: skip
            courses[recording] = {**courses.get(recording, {}), phase: own}
        return replace(super().apply(run, x), courses=courses)


def at_recorded_angle(problem: Problem, run: Run, active: ActiveTerm) -> ActiveTerm:
    """A wave where the recordings have its angle, as far as a channel shows how far this run of it is off; another term
    as it is. Raises SimulationError."""
    name = active.term.angle
    if active.term.phase is None or name is None:
        return active
    angles = {}
    for recording, signals in zip(problem.recordings, problem.outputs(run, [name]), strict=True):
        if name in signals:
            time, every = recording.time - recording.time[0], max(round(PERIOD / recording.step), 1)
            angles[recording.name] = time[::every], along_recording(recording, signals, [name])[name][::every]
    return WaveAlongRecording(active.term, active.values, active.onset, angles)


def _phase(phi_0: float, n: float, recorded: float, simulated: float) -> float:
    """n*simulated + it = n*recorded + phi_0, inside -pi..pi"""
    return (phi_0 + n * (recorded - simulated) + np.pi) % (2 * np.pi) - np.pi
