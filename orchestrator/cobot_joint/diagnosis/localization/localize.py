"""Where recordings and the re-fitted base model differ, before anything is named: by component, by regime, by time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.localization.change_points import Change, changes
from cobot_joint.diagnosis.localization.conditions import Order, Regime, by_dependence, frequencies, orders, regimes
from cobot_joint.diagnosis.localization.isolability import Isolability, NoToolbox, isolability, together
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
from cobot_joint.diagnosis.report import localization_words as say
from cobot_joint.diagnosis.store import plain
from cobot_joint.system.model import System

SURELY = 5.0  # sigma above noise, from which on it is worth asking in which regime and when
SIGMA_KNOWN = 0.01  # share to which a noise's variance is known


@dataclass(frozen=True)
class Located:
    """The answer to "where". Regimes and changes are empty where nothing is above noise."""

    replayed: tuple[Replayed, ...]
    suspects: tuple[str, ...]  # units in which one difference could lie, as far as replaying tells
    not_alone: Mapping[str, Sequence[str]]  # unit -> signals that would have to be recorded to replay it by itself
    isolability: Isolability | None  # None: see `words`
    regimes: Mapping[str, Sequence[Regime]]  # variable -> levels; what matters most is first
    orders: tuple[Order, ...]
    changes: tuple[Change, ...]
    words: Mapping[str, Sequence[str]]  # "components", "isolability", "regimes", "time": sentences

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        i = self.isolability
        found = {
            "components": {
                "parts": [_part(r) for r in self.replayed],
                "suspects": self.suspects,
                "not_alone": dict(self.not_alone),
            },
            "isolability": i and {"classes": i.classes, "detectable": i.detectable, "confused": i.confused},
            "regimes": {variable: [r.to_json() for r in levels] for variable, levels in self.regimes.items()},
            "orders": [o.to_json() for o in self.orders],
            "change_points": [c.to_json() for c in self.changes],
            "words": {key: list(said) for key, said in self.words.items()},
        }
        return dict(plain(found))


def locate_difference(problem: Problem, calibrated: Fit) -> Located:
    """What the calibrated residual says of where the difference lies. Raises SimulationError."""
    systems = problem.plant.systems if isinstance(problem.plant, FmuPlant) else {}
    systems = {setup: s for setup, s in systems.items() if any(r.setup == setup for r in problem.recordings)}
    names, angles = variables(problem, systems)
    wires = [s for system in systems.values() for s in wire_signals(system)]
    simulated = problem.outputs(calibrated.run, list(dict.fromkeys([*wires, *names, *angles])))
    replayed, alone, structure = _components(problem, calibrated, systems, simulated)
    suspected = suspects(replayed)
    words = {"components": say.components(replayed, suspected, alone), "isolability": say.isolability(structure)}
    found = Located(
        replayed, suspected, alone, structure if isinstance(structure, Isolability) else None, {}, (), (), words
    )
    above = above_noise(problem, calibrated.residual)
    if above.sum() < SURELY * np.sqrt(2 * problem.samples) + SIGMA_KNOWN * problem.samples:
        nothing = ["Nothing is above noise."]
        return replace(found, words=words | {"regimes": nothing, "time": nothing})
    levels = regimes(problem, above, labelled(problem, simulated, names))
    levels = by_dependence(levels | {"frequency": frequencies(problem, calibrated.residual)})
    turning = orders(problem, calibrated.residual, angles, simulated)
    when = changes(problem, calibrated.residual)
    words |= {"regimes": say.regimes(levels, turning), "time": say.changes(when)}
    return replace(found, regimes=levels, orders=tuple(turning), changes=tuple(when), words=words)


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
) -> tuple[tuple[Replayed, ...], dict[str, tuple[str, ...]], Isolability | str]:
    """Every part of every set-up, what keeps units from being replayed alone, and what channels can tell apart (or why
    that is not known).
    """
    found: list[Replayed] = []
    alone: dict[str, tuple[str, ...]] = {}
    apart: list[Isolability] = []
    missing = "" if systems else "The simulator is no system of units."
    for setup, system in systems.items():
        shown = shown_signals(problem, setup, system, simulated)
        recorded = list(dict.fromkeys(c for r in problem.recordings if r.setup == setup for c in r.outputs))
        whole, *smaller = parts(setup, system, recorded, shown)
        found += [replay(problem, calibrated, part, shown, simulated) for part in (whole, *smaller)]
        alone = not_alone(whole, shown) | alone
        try:
            apart.append(isolability(system, recorded, shown))
        except NoToolbox as error:
            missing = f"{error}."
    return tuple(found), alone, missing or together(apart)


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
