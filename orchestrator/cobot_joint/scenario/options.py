"""What a caller changes on a scenario: the model's level, parameters, the coupling scheme and its step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cobot_joint.errors import UserError, among
from cobot_joint.scenario.model import BaseScenario
from cobot_joint.system import System, with_parameters, with_units
from cobot_joint.system.model import Value

TRANSFER_FUNCTION = "transfer_function"  # thesis 3.2.4; the other levels are the units' own
LEVELS = (TRANSFER_FUNCTION, "averaged", "simscape", "comprehensive", "foc", "switching")


@dataclass(frozen=True)
class Options:
    """None: as scenario, units and master have it.

    parameters  `component.variable` -> value
    units       component -> the .fmu file that takes its FMU's place
    """

    level: str | None = None
    step: float | None = None
    scheme: str | None = None
    parameters: Mapping[str, Value | str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.level is not None and self.level not in LEVELS:
            raise UserError(f"--level {self.level!r} is given, {among(LEVELS)} is allowed")

    def coupling(self, scenario: BaseScenario) -> dict[str, Any]:
        """Scheme and step of a run: the caller's, else the scenario's, else the master's own."""
        scheme, step = self.scheme or scenario.scheme, scenario.step if self.step is None else self.step
        return {"step": step} | ({"scheme": scheme} if scheme else {})

    def applied(self, system: System, *layers: Mapping[str, Value | str], where: str) -> System:
        """The system with the caller's units, a scenario's parameters, the level, then what the caller sets."""
        system = with_units(system, self.units, "--unit")
        for layer in layers:
            system = with_parameters(system, layer, where)
        if self.level is not None:
            system = with_parameters(system, level_parameters(system, self.level), "--level")
        return with_parameters(system, self.parameters, "--set")


def level_parameters(system: System, level: str) -> dict[str, str]:
    """Every unit's choice called level that has such an item. UserError: no unit of the system has."""
    found: dict[str, str] = {}
    offered: list[str] = []
    for component in system.components:
        for name in component.unit.variables:
            if name.rpartition(".")[2] == "level":
                items = component.unit.choices_of(name)
                offered += [item for item in items if item not in offered]
                if level in items:
                    found[f"{component.name}.{name}"] = level
    if not found:
        raise UserError(f"--level {level!r} is given, the units of {system.name} have {among(offered)}")
    return found
