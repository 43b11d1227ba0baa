"""The states of a system, as far as its units let them be read and set.

FMI 2.0 has no call that sets a state between two steps. A state with a start value can be set before a run, though, and
a run may begin at any time: a run from a given state is a run that begins there. Which variables are states a unit says
by listing their derivatives in its ModelStructure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cobot_joint.system.model import Component, System
from cobot_joint.units import TOOL


@dataclass(frozen=True)
class StateVariable:
    """A state of a unit, the variable that is its derivative, what counts as much of it, and where it may start."""

    component: str
    variable: str
    derivative: str
    nominal: float
    lower: float = -np.inf
    upper: float = np.inf

    @property
    def name(self) -> str:
        """`component.variable`"""
        return f"{self.component}.{self.variable}"


def states_of(system: System) -> tuple[StateVariable, ...] | None:
    """In the components' order. None: a unit of the system allows no state to be set."""
    if why_none(system):
        return None
    return tuple(state for component in system.components for state in _listed(component))


def why_none(system: System) -> str:
    """Why the system's states cannot be set, in words; empty: they can."""
    for component in system.components:
        unit = component.unit
        if not unit.states and TOOL not in (unit.description.generationTool or ""):
            return f"{component.name} ({component.source}) does not list the derivatives of its states"
        for state in _listed(component):
            if unit.variables[state.variable].initial != "exact":
                return f"{component.name} ({component.source}): the start value of {state.variable} cannot be set"
    return ""


def _listed(component: Component) -> list[StateVariable]:
    found = []
    for state, derivative in component.unit.states.items():
        lower, upper = component.unit.bounds_of(state)
        nominal = abs(float(component.unit.variables[state].nominal or 1.0))
        bounds = -np.inf if lower is None else lower, np.inf if upper is None else upper
        found.append(StateVariable(component.name, state, derivative, nominal, *bounds))
    return found
