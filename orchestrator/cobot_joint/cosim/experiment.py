"""What one run is, as data: the system's inputs over time, parameters, how units are coupled, what is recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cobot_joint.cosim.schemes import Scheme
from cobot_joint.system.model import Inputs, Value


@dataclass(frozen=True)
class Feedback:
    """A parameter's value, by what a variable (`component.variable`) is when the parameter is set."""

    variable: str
    of: Callable[[float], float]


ParameterEvents = Sequence[tuple[float, Mapping[str, Value | Feedback]]]


@dataclass(frozen=True)
class Experiment:
    """One run of a system; names as in FMI's and Modelica's experiment annotation.

    inputs            the system's inputs over time
    stop_time         s
    start_time        s
    output_step       s; time between recorded rows
    scheme            of coupling, by name or as fields; None: the system's own, or the default
    step              s; the communication step, `output_step` a multiple of it, or the longest step of an adaptive
                      scheme; None: the scheme's own, or an estimate where a unit cannot take steps back and no scheme
                      is given either
    parameters        `component.variable` -> value, over the system's own
    parameter_events  (time s, `component.variable` -> value or Feedback): set during the run, at the first
                      communication point not before that time
    record            the system's outputs and inputs and `component.variable`; None: the system's outputs
    """

    inputs: Inputs
    stop_time: float
    start_time: float = 0.0
    output_step: float = 1e-3
    scheme: str | Scheme | None = None
    step: float | None = None
    parameters: Mapping[str, Value] = field(default_factory=dict)
    parameter_events: ParameterEvents = ()
    record: Sequence[str] | None = None

    def with_parameters(self, parameters: Mapping[str, Value]) -> Experiment:
        """The same with `component.variable` -> value on top of its parameters."""
        return replace(self, parameters={**self.parameters, **parameters})
