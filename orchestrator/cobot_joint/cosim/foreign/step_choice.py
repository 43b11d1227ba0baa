"""The communication step for units that cannot take one back: the longest whose half gives the same signals."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim.instances import SimulationError
from cobot_joint.results.result import Result

log = logging.getLogger("cobot_joint")
CHANGE = 0.005  # of a signal's size, that halving the step may make: the step's own error is at most twice that
SMALL = 1e-3  # of its nominal value: a signal's size is its rms, but not less than that
SHORTEST = 7e-6  # s
PROBE = 10.0  # s of a run that the estimate looks at


def choose_step(run: Callable[[float], Result], longest: float, nominal: Mapping[str, float]) -> float:
    """The longest of `longest`, its half, ..., whose half changes no signal by more than CHANGE of its size; s.

    `run`: the start of the experiment at a step; `nominal`: of every signal that it records. A step at which a unit
    fails is too long. Where none will do, the shortest is taken and a warning says so.
    SimulationError: a unit fails at the shortest, too.
    """
    step, coarse, change, signal = longest, _attempt(run, longest), 0.0, ""
    while step / 2 >= SHORTEST:
        fine = _attempt(run, step / 2)
        change, signal = _largest_change(coarse, fine, nominal)
        if change <= CHANGE:
            return step
        step, coarse = step / 2, fine
    if coarse is None:
        run(step)  # raises what the unit says
    if change > CHANGE:
        log.warning(
            "the coupling does not settle: halving the step to %.3g ms still changes %s by %.2g %% of its size, %g %% "
            "is allowed; a unit that follows its inputs (canInterpolateInputs), or may be stepped in parts "
            "(canHandleVariableCommunicationStepSize), would help", 1e3 * step, signal, 100 * change, 100 * CHANGE,
        )  # fmt: skip
    return step


def _attempt(run: Callable[[float], Result], step: float) -> Result | None:
    try:
        return run(step)
    except SimulationError:  # diverged; a shorter step decides, and the shortest raises
        return None


def _largest_change(coarse: Result | None, fine: Result | None, nominal: Mapping[str, float]) -> tuple[float, str]:
    """(rms of the difference over the signal's size, signal) where that is largest; infinite where a run failed."""
    if coarse is None or fine is None:
        return np.inf, "everything"
    changes = {
        name: _rms(coarse[name] - signal) / max(_rms(signal), SMALL * nominal[name])
        for name, signal in fine.signals.items()
    }
    worst = max(changes, key=lambda name: changes[name], default="")
    return changes.get(worst, 0.0), worst


def _rms(signal: NDArray[np.float64]) -> float:
    """Infinite where a signal is not finite."""
    rms = float(np.sqrt(np.mean(signal**2)))
    return rms if np.isfinite(rms) else np.inf
