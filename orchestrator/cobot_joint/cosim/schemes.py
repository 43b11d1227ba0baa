"""Coupling schemes as data: the master has one loop, and these fields are all that differs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cobot_joint.errors import UserError, among


@dataclass(frozen=True)
class Scheme:
    """How the signals between units are guessed over a communication step.

    sequential     units step in the system's order and later ones see the earlier ones' new outputs, interpolated
                   (Gauss-Seidel); else all of them see the signals continued from the past (Jacobi)
    extrapolation  degree of the polynomial that continues a signal: 0 holds it; output derivatives are used where given
    interpolation  3: cubic Hermite, for signals with output derivatives; 1: a line
    sweeps         most passes per step; each after the first starts from the saved FMU states, on the last pass's
                   interpolants, and only where a signal that feeds back moved by more than
                   `tolerance`*(nominal + |value|)
    adaptive       a step on which a signal strays further than that from its continuation, or on which a unit does
                   not take the energy that its neighbour gives, is taken back and halved; steps double where there
                   is room
    tolerance      1; of `sweeps` and `adaptive`
    monolithic     units of ours are one system of equations, integrated from event to event, and do not step
                   themselves; `tolerance`: error of a step over each state's nominal value
    pace           1/s; of `monolithic`: steps per second of simulated time beyond which a run is given up (UnfitError)
    step           s; the one that is used where none is given; of an adaptive scheme the longest, or the time between
                   rows where that is shorter
    shortest       s; step of an adaptive scheme, or somewhat below, so that doubled steps meet recorded points
    """

    name: str
    description: str
    sequential: bool
    extrapolation: int = 0
    interpolation: int = 1
    sweeps: int = 1
    adaptive: bool = False
    monolithic: bool = False
    tolerance: float = 1e-4
    pace: float = math.inf
    step: float = 5e-4
    shortest: float = 2e-5

    @property
    def holds(self) -> bool:
        """Whether units are told no derivatives of inputs, as by other masters: ours then go on by themselves."""
        return not self.sequential and self.extrapolation == 0

    @property
    def rolls_back(self) -> bool:
        """Whether units have to save and restore their state."""
        return self.sweeps > 1 or self.adaptive


_ALL = (
    Scheme("jacobi", "all units at once, inputs held", sequential=False, step=1e-4),
    Scheme("gauss_seidel", "one unit after the other, later ones see interpolated inputs", sequential=True, step=1e-4),
    Scheme(
        "gauss_seidel_extrapolated",
        "Gauss-Seidel, feedback continued quadratically, cubic interpolation",
        sequential=True,
        extrapolation=2,
        interpolation=3,
    ),
    Scheme(
        "iterative",
        "Gauss-Seidel, swept again from the saved states until the feedback is met",
        sequential=True,
        extrapolation=2,
        interpolation=3,
        sweeps=10,
        tolerance=1e-5,
        step=1e-3,
    ),
    Scheme(
        "adaptive",
        "Gauss-Seidel, the step controlled by the coupling error, with rollback",
        sequential=True,
        extrapolation=2,
        interpolation=3,
        adaptive=True,
        step=16e-3,
    ),
    Scheme(
        "monolithic",
        "units of ours as one system of equations, integrated from event to event",
        sequential=True,
        monolithic=True,
        tolerance=2e-5,
        step=16e-3,
    ),
)

SCHEMES = {scheme.name: scheme for scheme in _ALL}
DEFAULT = "adaptive"
STEPPED = tuple(name for name, scheme in SCHEMES.items() if not scheme.monolithic)  # units step themselves
MONOLITHIC = SCHEMES["monolithic"]
WITHOUT_ROLLBACK = "gauss_seidel_extrapolated"  # instead, where a unit cannot restore its state or vary its step


def scheme_of(scheme: str | Scheme) -> Scheme:
    """A scheme by its name. UserError: there is none of that name."""
    if isinstance(scheme, Scheme):
        return scheme
    if scheme not in SCHEMES:
        raise UserError(f"scheme {scheme!r} is given, allowed are {among(SCHEMES)}")
    return SCHEMES[scheme]
