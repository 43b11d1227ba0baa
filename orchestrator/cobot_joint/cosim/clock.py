"""Communication points in time, recorded rows among them, and where inputs turn."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim.schemes import Scheme
from cobot_joint.errors import UserError
from cobot_joint.system.model import Inputs

ROUNDING, SLIGHT = 1e-9, 1e-4  # turns of an input, by its size, that are none and that an integrator steps over
MOST_POINTS = 1e10  # of a run: months of computing


@dataclass(frozen=True)
class Clock:
    """Points in time t = start + tick*step; every `per_row`th is recorded; no step is longer than `stride` ticks."""

    start: float
    step: float
    per_row: int
    stride: int
    rows: int  # the one at the start included

    def times(self, first_row: int, end_row: int) -> NDArray[np.float64]:
        """s"""
        return np.float64(self.start) + np.arange(first_row, end_row) * self.per_row * np.float64(self.step)

    def tick_at(self, t: float) -> int:
        """The first communication point not before t."""
        return max(0, math.ceil((t - self.start) / self.step - 1e-6))


def make_clock(scheme: Scheme, start: float, stop: float, step: float | None, output_step: float) -> Clock:
    """`step` of None: the scheme's own, or the next below that divides `output_step`. UserError: times do not fit."""
    if not (output_step > 0 and math.isfinite(stop) and stop >= start):
        raise UserError(f"start {start:g} s, stop {stop:g} s, output step {output_step:g} s: time has to go forward")
    if step is not None and not 0 < step < math.inf:
        raise UserError(f"step {step:g} s is given, it has to be positive")
    if step is not None and start < stop < start + step and step > output_step:
        raise UserError(f"step {step:g} s is given, the run lasts {stop - start:g} s")
    if (points := (stop - start) / min(output_step, step or output_step)) > MOST_POINTS:
        raise UserError(
            f"start {start:g} s, stop {stop:g} s in steps of {min(output_step, step or output_step):g} s are given: "
            f"{points:.2g} points, {MOST_POINTS:g} are allowed"
        )
    longest = step or min(scheme.step, output_step)  # rows inside of steps, interpolated, only where asked for
    rows = math.floor((stop - start) / output_step + 1e-6) + 1
    if scheme.adaptive or scheme.monolithic:  # ticks that divide output_step by powers of two, strides of such powers
        per_row = 2 ** max(0, math.ceil(math.log2(output_step / min(scheme.shortest, longest)) - 1e-9))
        tick = output_step / per_row
        return Clock(start, tick, per_row, 2 ** max(0, math.floor(math.log2(longest / tick) + 1e-9)), rows)
    per_row = max(1, math.ceil(output_step / longest - 1e-9))
    if step is not None and abs(per_row * step - output_step) > 1e-9 * output_step:
        raise UserError(f"step {step:g} s is given, the output step {output_step:g} s has to be a multiple of it")
    return Clock(start, output_step / per_row, per_row, 1, rows)


def turns(inputs: Inputs, clock: Clock, least: float = ROUNDING) -> NDArray[np.int64]:
    """Ticks next to where an input's slope changes by more than `least` of its size per sample: before the first sample
    and after the last it is 0. One that holds its samples turns wherever it jumps."""
    t, found = inputs.time, np.zeros(len(inputs.time), dtype=bool)
    for name, samples in inputs.values.items():
        if name in inputs.held:
            found[1:] |= np.diff(samples) != 0
            continue
        slopes = np.concatenate([[0.0], np.diff(samples) / np.diff(t), [0.0]])
        slight = least * np.max(np.abs(samples), initial=0.0) / np.min(np.diff(t), initial=np.inf)
        found |= np.abs(np.diff(slopes)) > slight
    ticks = (t[found] - clock.start) / clock.step
    near = np.round(ticks)
    exact = np.abs(ticks - near) < 1e-6
    return np.unique(np.concatenate([near[exact], np.floor(ticks[~exact]), np.ceil(ticks[~exact])])).astype(np.int64)


def halfway(inputs: Inputs, clock: Clock, names: Collection[str]) -> NDArray[np.int64]:
    """Ticks from which on an input is nearer to its next sample than to the last: whoever reads whole numbers sees it
    jump there."""
    middle = (inputs.time[1:] + inputs.time[:-1]) / 2
    jumps = np.zeros(len(middle), dtype=bool)
    for name in set(names) - inputs.held:
        jumps |= np.diff(inputs.values[name]) != 0
    return np.ceil((middle[jumps] - clock.start) / clock.step - 1e-6).astype(np.int64)
