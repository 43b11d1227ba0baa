"""What the diagnosis asks of a simulator: parameters, terms to switch on, ports that take an added signal, and runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import Feedback
from cobot_joint.cosim.instances import SimulationError
from cobot_joint.diagnosis.data.recording import Recording

__all__ = ["Parameter", "Plant", "Port", "ScannedShape", "Signals", "SimulationError", "TermCandidate"]

Signals = dict[str, NDArray[np.float64]]
Courses = Mapping[str, Sequence[tuple[float, float | Feedback]]]  # parameter -> (s since a run began, value)

PROBE = {
    "N.m": 1e-3,
    "N": 0.1,
    "N.m.s2/rad2": 1e-9,
    "1/(N.m)": 1e-3,
    "V": 1e-2,
    "A": 1e-3,
    "Ohm": 1e-2,
    "rad": 1e-4,
    "s": 2e-3,
    "1": 3e-2,
    "1/K": 1e-2,
    "1/A2": 1e-4,
    "1/J": 1e-5,
    "1/rad2": 1e4,
}  # amplitude by unit of measure with which a response is first probed; a scan then adapts it


@dataclass(frozen=True)
class Parameter:
    """`component.name` as the system has it."""

    name: str
    nominal: float
    unit: str
    lower: float  # what the unit allows, not the tolerance
    upper: float


ANY_ORDER = 24  # orders that a unit scans where it can be any: slots, poles, teeth


@dataclass(frozen=True)
class ScannedShape:
    """A shape parameter of a term: unidentifiable while the term is off, so these values are tried."""

    name: str
    values: tuple[float, ...]
    lower: float
    upper: float
    unit: str = "1"
    logarithmic: bool = False
    whole: bool = False  # an order: counted, never fitted
    reached: float = np.inf  # of a speed: the highest that was driven
    given: bool = False  # its range, by the campaign

    @property
    def is_any_order(self) -> bool:
        """Whether the unit names no few orders that its physics has, as a misalignment has one or two."""
        return self.whole and not self.given and len(self.values) >= ANY_ORDER


@dataclass(frozen=True)
class TermCandidate:
    """A switched-off term. With a `phase`, amplitude*sin(.. + phase) makes a pair that is linear in its two parts."""

    name: str  # component.term
    amplitude: str
    neutral: float
    lower: float
    upper: float
    unit: str
    shapes: tuple[ScannedShape, ...] = ()
    phase: str | None = None
    angle: str | None = None  # of a shaft, that a wave goes by; None: of none, or it does not say of which
    turns: float = 1.0  # periods per turn, of a wave without a shape that says how many
    compensated: bool = False  # whether a current loop makes up for it: a candidate only where a campaign lists it

    @property
    def component(self) -> str:
        """The unit that has it."""
        return self.name.split(".")[0]

    def periods(self, values: Mapping[str, float]) -> float:
        """Per turn of its angle, with these values of its shapes."""
        return next((values[s.name] for s in self.shapes if s.whole), self.turns)

    @property
    def episode(self) -> tuple[str, str] | None:
        """Its beginning t_0 and length T_d, where the term lasts for a while only."""
        names = {s.name.split(".")[-1]: s.name for s in self.shapes}
        return (names["t_0"], names["T_d"]) if {"t_0", "T_d"} <= names.keys() else None


SPEEDS = ("rad/s", "m/s")


@dataclass(frozen=True)
class Port:
    """An additive input, 0 when unused, and the component's own signals that an effect there may depend on."""

    name: str  # component.variable
    unit: str
    signals: tuple[str, ...]
    angles: tuple[str, ...] = ()  # those of `signals` that are angles of shafts
    connector: str = ""  # of the system, where it leads there
    loads: tuple[str, ...] = ()  # those that are torques, forces or currents: a unit's own before those at its flanges
    voltages: tuple[str, ...] = ()  # those of its inputs that are voltages
    speeds: tuple[str, ...] = ()  # those of `signals` that are speeds

    @property
    def component(self) -> str:
        """The unit that has it."""
        return self.name.split(".")[0]


class Plant(Protocol):
    """A system under diagnosis."""

    @property
    def parameters(self) -> Mapping[str, Parameter]: ...
    @property
    def terms(self) -> Sequence[TermCandidate]: ...
    @property
    def ports(self) -> Sequence[Port]: ...
    @property
    def inputs(self) -> Sequence[Port]:
        """The system's own inputs that are 0 unless used, by where they lead. Not logged, they may have been used."""
        ...

    def simulate(
        self,
        values: Mapping[str, float],
        recording: Recording,
        *,
        onsets: Mapping[str, float] | None = None,
        added: Mapping[str, NDArray[np.float64]] | None = None,
        signals: Sequence[str] = (),
        courses: Courses | None = None,
    ) -> Signals:
        """Outputs of the system (and `signals`, `component.variable`) at the recording's time, each (n,).

        values: parameters other than nominal. onsets: of those, which hold only from a time on (neutral or nominal
        before). added: port -> (n,). courses: parameters that change as the run goes on.
        Raises SimulationError.
        """
        ...

    def has(self, name: str, recording: Recording) -> bool:
        """Whether the set-up of that recording has this component (or the component of this parameter or port)."""
        ...
