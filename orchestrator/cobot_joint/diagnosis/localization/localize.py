"""Where recordings and the re-fitted base model differ, before anything is named: by component, condition and time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.localization.change_points import Change, changes
from cobot_joint.diagnosis.localization.conditions import (
    Condition,
    Order,
    by_dependence,
    conditions,
    densest,
    frequencies,
    orders,
)
from cobot_joint.diagnosis.localization.isolability import Isolability, isolability, together
from cobot_joint.diagnosis.localization.replay import (
    Replayed,
    not_alone,
    parts,
    replay,
    shown_signals,
    suspects,
    wire_signals,
)
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import Signals
from cobot_joint.diagnosis.store import plain
from cobot_joint.system.model import System


@dataclass(frozen=True)
class Localization:
    """The answer to "where". Conditions and changes are empty where nothing is above noise."""

    replayed: tuple[Replayed, ...]
    suspects: tuple[str, ...]  # units in which one difference could lie, as far as replaying tells
    not_alone: Mapping[str, Sequence[str]]  # unit -> signals that would have to be recorded to replay it by itself
    isolability: Isolability | None  # None: see `no_isolability`
    no_isolability: str = ""  # why it is not known
    conditions: Mapping[str, Sequence[Condition]] = field(default_factory=dict)  # by variable; what matters most first
    orders: tuple[Order, ...] = ()
    changes: tuple[Change, ...] = ()
    above_noise: bool = False  # whether there is anything to ask conditions and times of

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        i = self.isolability
        found = {
            "components": {
                "parts": [_part(r) for r in self.replayed],
                "suspects": self.suspects,
                "not_alone": dict(self.not_alone),
            },
            "isolability": i
            and {"classes": i.classes, "detectable": i.detectable, "confused": i.confused, "hidden": i.hidden},
            "no_isolability": self.no_isolability,
            "above_noise": self.above_noise,
            "regimes": {variable: [r.to_json() for r in levels] for variable, levels in self.conditions.items()},
            "densest": [r.to_json() for levels in self.conditions.values() if (r := densest(levels))],
            "orders": [o.to_json() for o in self.orders],
            "change_points": [c.to_json() for c in self.changes],
        }
        return dict(plain(found))


def locate_difference(problem: Problem, calibrated: Fit) -> Localization:
    """What the calibrated residual says of where the difference lies. Raises SimulationError."""
    systems = systems_of(problem)
    names, angles = variables(problem, systems)
    wires = [s for system in systems.values() for s in wire_signals(system)]
    simulated = problem.outputs(calibrated.run, list(dict.fromkeys([*wires, *names, *angles])))
    found = _components(problem, calibrated, systems, simulated)
    above = above_noise(problem, calibrated.residual)
    if above.sum() < thresholds.HARDLY_LEFT * np.sqrt(2 * problem.samples) + thresholds.SIGMA_KNOWN * problem.samples:
        return found
    levels = conditions(problem, above, labelled(problem, simulated, names))
    return replace(
        found,
        conditions=by_dependence(levels | {"frequency": frequencies(problem, calibrated.residual)}),
        orders=tuple(orders(problem, calibrated.residual, angles, simulated)),
        changes=() if problem.is_table else tuple(changes(problem, calibrated.residual)),
        above_noise=True,
    )


def systems_of(problem: Problem) -> dict[str, System]:
    """Set-up -> system, of the set-ups that were recorded; empty: the simulator is no system of units."""
    systems = problem.plant.systems if isinstance(problem.plant, FmuPlant) else {}
    return {setup: s for setup, s in systems.items() if any(r.setup == setup for r in problem.recordings)}


def above_noise(problem: Problem, residual: Vector) -> Vector:
    """Chi-square above noise by row: (rows,)"""
    return residual**2 - np.concatenate([b.weight for b in problem.blocks])


def variables(problem: Problem, systems: Mapping[str, System]) -> tuple[dict[str, str], list[str]]:
    """Simulated signals (`component.variable` -> name) and angles that a regime may be of."""
    angles = list(dict.fromkeys(a for port in problem.plant.ports for a in port.angles))
    if systems:  # what the system offers to the outside
        wires = [c for system in systems.values() for c in system.connections]
        offered = {f"{c.source_component}.{c.source}": c.sink for c in wires if c.sink_component is None}
    else:
        offered = {s: s for port in problem.plant.ports for s in port.signals}
    channels = {c for r in problem.recordings for c in r.outputs}
    return {s: name for s, name in offered.items() if name not in channels and s not in angles}, angles


def labelled(problem: Problem, simulated: Sequence[Signals], names: Mapping[str, str]) -> list[dict[str, Vector]]:
    """By recording what regimes are of: channels as simulated, the named signals, and inputs."""
    return [
        {c: s[c] for c in r.outputs} | {name: s[signal] for signal, name in names.items() if signal in s} | r.inputs
        for r, s in zip(problem.recordings, simulated, strict=True)
    ]


def _components(
    problem: Problem, calibrated: Fit, systems: Mapping[str, System], simulated: Sequence[Signals]
) -> Localization:
    """Every part of every set-up, what keeps units from being replayed alone, and what channels can tell apart."""
    found: list[Replayed] = []
    alone: dict[str, tuple[str, ...]] = {}
    apart: list[Isolability] = []
    missing = "" if systems else "the simulator is no system of units"
    for setup, system in systems.items():
        shown = shown_signals(problem, setup, system, simulated)
        recorded = list(dict.fromkeys(c for r in problem.recordings if r.setup == setup for c in r.outputs))
        whole, *smaller = parts(setup, system, recorded, shown)
        found += [replay(problem, calibrated, part, shown, simulated) for part in (whole, *smaller)]
        alone = not_alone(whole, shown) | alone
        apart.append(isolability(system, recorded, shown))
    told = together(apart) if systems else None
    return Localization(tuple(found), suspects(found), alone, told, missing)


def _part(r: Replayed) -> dict[str, Any]:
    return {
        "setup": r.part.setup,
        "units": r.part.units,
        "driven_by": r.part.driven,
        "read_through": sorted(r.part.read),
        "channels": {
            c: {
                "off": c in r.off,
                "calibrated": r.calibrated[c],
                "refitted": r.refitted[c],
                "healthy": r.healthy[c],
                "scatter": r.scatter[c],
            }
            for c in r.part.channels
        },
    }
