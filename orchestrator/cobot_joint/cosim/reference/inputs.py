"""The system's inputs at any time: lines between their samples, or what is held since the last one."""

from __future__ import annotations

from cobot_joint.system.model import Inputs

AT_TICK = 1e-6  # of a step, by which a sample may miss the tick that it is at


class SampledInputs:
    """step: of the clock, s. Inputs are meant by their numbers, samples by theirs."""

    def __init__(self, inputs: Inputs, step: float) -> None:
        self.time = [float(t) for t in inputs.time]
        self.samples = [[float(x) for x in row] for row in inputs.values.values()]
        self.held = [name in inputs.held for name in inputs.values]
        self._near = AT_TICK * step

    def sample_before(self, k: int, t: float) -> int:
        """The last sample that is not later, from sample k on."""
        while k + 1 < len(self.time) and self.time[k + 1] <= t:
            k += 1
        return k

    def at(self, n: int, k: int, t: float) -> float:
        """Of the input n; k: the last sample that is not later."""
        samples = self.samples[n]
        if self.held[n]:
            return samples[self.sample_before(k, t + self._near)]  # the one at a tick, however times are rounded
        if t <= self.time[0]:
            return samples[0]
        if k + 1 >= len(self.time):
            return samples[-1]
        return samples[k] + (samples[k + 1] - samples[k]) * ((t - self.time[k]) / (self.time[k + 1] - self.time[k]))
