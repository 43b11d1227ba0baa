"""The communication step for units that cannot take one back: the longest whose own error is small, by its halves."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim.instances import SimulationError
from cobot_joint.results.result import Result

log = logging.getLogger("cobot_joint")
ERROR = 0.01  # of a signal's size: how far off a step may leave it
SMALL = 1e-3  # of its nominal value: a signal's size is its rms, but not less than that
SHORTEST = 7e-6  # s
PROBE = 10.0  # s of a run that the estimate looks at
SECOND_ORDER, FIRST_ORDER = 4.0, 2.0  # by what a halving divides what the next one changes
SLOWEST = 1.4  # the same, where orders cancel: 3.5 times a change is left, 3.3 were measured (docs/decisions/0009)

Change = tuple[float, str]  # of a signal, over its size


def choose_step(run: Callable[[float], Result], longest: float, nominal: Mapping[str, float]) -> float:
    """The longest of `longest`, its half, ..., whose error is estimated at no more than ERROR of any signal's size; s.

    `run`: the start of the experiment at a step; `nominal`: of every signal that it records. A step at which a unit
    fails is too long. Where none will do, the shortest is taken and a warning says so.
    SimulationError: a unit fails at the shortest, too.
    """
    steps = [longest]
    while steps[-1] / 2 >= SHORTEST:
        steps.append(steps[-1] / 2)

    @cache
    def changes(k: int) -> dict[str, float]:
        """What halving step k changes of every signal; infinite where a run failed, nothing behind the shortest."""
        return relative_changes(result(k), result(k + 1), nominal) if k + 1 < len(steps) else {}

    @cache
    def result(k: int) -> Result | None:
        try:
            return run(steps[k])
        except SimulationError:  # diverged; a shorter step decides, and the shortest raises
            return None

    for k, step in enumerate(steps[:-1]):
        error, name = _error(changes(k), partial(changes, k + 1))
        if error <= ERROR:
            log.info("step %.3g ms: %s is off by no more than %.2g %% of its size", 1e3 * step, name, 100 * error)
            return step
    if result(len(steps) - 1) is None:
        run(steps[-1])  # raises what the unit says
    if len(steps) > 1:
        _warn(steps[-1], changes(len(steps) - 2), changes(len(steps) - 3) if len(steps) > 2 else {})
    return steps[-1]


def _warn(step: float, changes: Mapping[str, float], before: Mapping[str, float]) -> None:
    """`changes`: what halving to the shortest step changed; `before`: what the halving before that did."""
    remedy = (
        "a unit that follows its inputs (canInterpolateInputs), or may be stepped in parts "
        "(canHandleVariableCommunicationStepSize), would help"
    )
    change, name = _worst(changes)
    if not np.isfinite(change):
        log.warning(
            "the coupling does not settle: at %.3g ms a unit still fails; %.3g ms, the shortest, is taken, and how far "
            "off that is cannot be told; %s",
            2e3 * step, 1e3 * step, remedy,
        )  # fmt: skip
        return
    ratio = before.get(name, np.inf) / change
    left = _rest(change, ratio if np.isfinite(ratio) else FIRST_ORDER)
    log.warning(
        "the coupling does not settle: halving the step to %.3g ms still changes %s by %.2g %% of its size and "
        "leaves an error of some %.2g %%, %g %% is allowed; %s",
        1e3 * step, name, 100 * change, 100 * left, 100 * ERROR, remedy,
    )  # fmt: skip


def _error(changes: Mapping[str, float], halved: Callable[[], Mapping[str, float]]) -> Change:
    """Of a step. What the second halving changes costs more than all before it: it is not asked where one decides."""
    largest, name = _worst(changes)
    if _left(largest, SECOND_ORDER) > ERROR or _left(largest, SLOWEST) <= ERROR:
        return _left(largest, SLOWEST), name
    return richardson(changes, halved())


def richardson(changes: Mapping[str, float], again: Mapping[str, float]) -> Change:
    """A step's error where it is largest, from what halving it changes (c) and what halving that again changes (c/r):
    c + c/r + c/r^2 + ... = c r/(r - 1), Richardson 1911, with r as measured, from SLOWEST to SECOND_ORDER.

    `again` without a signal: first order is taken.
    """
    ratios = {n: changes[n] / c if c > 0 else SECOND_ORDER for n, c in again.items() if n in changes}
    return _worst({n: _left(c, ratios.get(n, FIRST_ORDER)) for n, c in changes.items()})


def _left(change: float, ratio: float) -> float:
    """Of the step that halving changes."""
    return change + _rest(change, ratio)


def _rest(change: float, ratio: float) -> float:
    """Of its half: c/r + c/r^2 + ..."""
    return change / (min(max(ratio, SLOWEST), SECOND_ORDER) - 1)


def relative_changes(coarse: Result | None, fine: Result | None, nominal: Mapping[str, float]) -> dict[str, float]:
    """rms of the difference over the signal's size; infinite where a run failed."""
    if coarse is None or fine is None:
        return {"everything": np.inf}
    return {
        name: _rms(coarse[name] - signal) / max(_rms(signal), SMALL * nominal[name])
        for name, signal in fine.signals.items()
    }


def _worst(changes: Mapping[str, float]) -> Change:
    name = max(changes, key=lambda n: changes[n], default="")
    return changes.get(name, 0.0), name


def _rms(signal: NDArray[np.float64]) -> float:
    """Infinite where a signal is not finite."""
    rms = float(np.sqrt(np.mean(signal**2)))
    return rms if np.isfinite(rms) else np.inf
