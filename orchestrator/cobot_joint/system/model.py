"""What a system is and what drives it: the terms that master, scenarios and diagnosis share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from cobot_joint.units import Unit

Causality = Literal["input", "output"]
Type = Literal["Real", "Integer", "Boolean"]
Value = float | int | bool


@dataclass(frozen=True)
class Connector:
    """A connector of the system itself; `unit` is FMI's spelling, None where nothing is said."""

    name: str
    causality: Causality
    type: Type = "Real"
    unit: str | None = None
    description: str = ""


@dataclass(frozen=True)
class Component:
    """One FMU in a system: `source` as the SSD says it, the `unit` found there, start values that the system sets."""

    name: str
    source: str
    unit: Unit
    parameters: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Connection:
    """sink = factor*source + offset. A component of None is the system: its inputs are sources, its outputs sinks."""

    source_component: str | None
    source: str
    sink_component: str | None
    sink: str
    factor: float = 1.0
    offset: float = 0.0

    @property
    def name(self) -> str:
        """`motor.phi -> gear.phi`"""
        return f"{_qualified(self.source_component, self.source)} -> {_qualified(self.sink_component, self.sink)}"


@dataclass(frozen=True)
class DefaultExperiment:
    """SSD's DefaultExperiment, s; and how its units want to be coupled unless a run says otherwise (None: as any)."""

    start_time: float = 0.0
    stop_time: float = 1.0
    scheme: str | None = None
    step: float | None = None


@dataclass(frozen=True)
class System:
    """Components in the order in which Gauss-Seidel steps them, and every wire, those at the system's connectors too.

    Factors and offsets of wires include the conversion of units, settled when a system is read (`load_system`).
    """

    name: str
    components: tuple[Component, ...]
    connections: tuple[Connection, ...]
    inputs: Mapping[str, Connector] = field(default_factory=dict)
    outputs: Mapping[str, Connector] = field(default_factory=dict)
    default_experiment: DefaultExperiment = DefaultExperiment()
    path: Path | None = None

    def component(self, name: str) -> Component:
        """The component of that name. KeyError: there is none."""
        for component in self.components:
            if component.name == name:
                return component
        raise KeyError(f"{self.name} has no component {name!r}, it has {', '.join(c.name for c in self.components)}")

    @property
    def recorded(self) -> list[str]:
        """What a run records: inputs and outputs; of a system without outputs, those of its components."""
        ports = [
            f"{c.name}.{v.name}"
            for c in self.components
            for v in c.unit.variables.values()
            if v.causality == "output" and v.type != "String"
        ]
        return [*self.inputs, *(self.outputs or ports)]

    def unit_of(self, signal: str) -> str | None:
        """The unit of an input or output of the system, or of a `component.variable`; None where nothing is said."""
        connector = self.inputs.get(signal) or self.outputs.get(signal)
        if connector is not None:
            return connector.unit
        owner, _, variable = signal.partition(".")
        return self.component(owner).unit.unit_of(variable)


@dataclass(frozen=True)
class Inputs:
    """Piecewise linear inputs, held outside of `time`.

    `time`: float64[n], s, rising. `values`: system's input -> float64[n], in the connector's unit, Booleans as 0 and 1.
    Inputs that are not named keep the start values of the variables they drive. `held`: of them, those that jump at
    their samples and hold each until the next one, as what a digital controller asks for does.
    """

    time: NDArray[np.float64]
    values: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    held: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        if self.time.ndim != 1 or len(self.time) == 0 or np.any(np.diff(self.time) <= 0):
            raise ValueError("Inputs: time has to be one rising row of samples")
        for name, samples in self.values.items():
            if samples.shape != self.time.shape:
                raise ValueError(f"Inputs: {name} has {len(samples)} samples, time has {len(self.time)}")
        if unknown := self.held - self.values.keys():
            raise ValueError(f"Inputs: {min(unknown)} is held, and has no samples")

    def at(self, t: float) -> dict[str, float]:
        """name -> value at a time, s"""
        since = max(int(np.searchsorted(self.time, t, side="right")) - 1, 0)
        return {
            name: float(samples[since] if name in self.held else np.interp(t, self.time, samples))
            for name, samples in self.values.items()
        }


def _qualified(component: str | None, variable: str) -> str:
    return variable if component is None else f"{component}.{variable}"
