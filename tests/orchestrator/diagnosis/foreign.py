"""Campaigns with an effect in them that no unit lists: to measure how a diagnosis answers when the list is not enough.

The campaign lends its inputs, channels and tolerances; its outputs are not used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.campaign_file import Logged
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Vector
from cobot_joint.diagnosis.plant.correction import formula_parameters, table_parameters
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import Plant
from cobot_joint.diagnosis.repair.export import Correction, with_correction
from cobot_joint.system.model import System

SPREAD = 0.5  # of a healthy parameter, 1 sigma over its tolerance


@dataclass(frozen=True)
class Foreign:
    """What enters at an additive port: a sum of coefficient*form of the component's signals, or a table over one."""

    port: str  # component.variable
    terms: tuple[tuple[float, str], ...] = ()
    signal: str = ""
    table: tuple[Vector, Vector] | None = None  # of `signal`: (n,), (n,)

    def correction(self) -> Correction:
        """The unit that computes it. UserError: it has no room for that."""
        if self.table is not None:
            parameters, signals = table_parameters(self.signal, *self.table)
        else:
            parameters, signals = formula_parameters(self.terms)
        component = self.port.split(".")[0]
        return Correction("foreign", self.port, tuple(f"{component}.{s}" for s in signals), parameters)


def conceal(
    campaign: Campaign, foreign: Foreign, folder: Path, rng: np.random.Generator, *, colour: float = 0.0
) -> Campaign:
    """The campaign as it would be with healthy parameters drawn inside the tolerances and the effect in the system.

    folder: where the effect's unit is written. colour: of the noise in torque channels, from sample to sample.
    SimulationError: parameters and effect together cannot be simulated.
    """
    correction = foreign.correction()
    systems = {s: _with(system, correction, folder) for s, system in campaign.systems().items()}
    with FmuPlant(systems) as plant:
        values = _healthy(campaign, plant, rng)
        recordings = [replace(r, outputs=_logged(campaign, plant, r, values, rng, colour)) for r in campaign.recordings]
    return replace(campaign, recordings=recordings)


def _with(system: System, correction: Correction, folder: Path) -> System:
    there = {c.name for c in system.components}
    return with_correction(system, correction, folder) if correction.port.split(".")[0] in there else system


def _healthy(campaign: Campaign, plant: Plant, rng: np.random.Generator) -> dict[str, float]:
    values = {}
    for name, tolerance in campaign.tolerances.items():
        lower, upper = tolerance.bounds(plant.parameters[name].nominal)
        off = np.clip(rng.normal(0, SPREAD), -1, 1)
        values[name] = float((lower + upper) / 2 + off * (upper - lower) / 2)
    return values


def _logged(
    campaign: Campaign, plant: Plant, r: Recording, values: Mapping[str, float], rng: np.random.Generator, colour: float
) -> dict[str, Vector]:
    there = {name: value for name, value in values.items() if plant.has(name, r)}
    clean = plant.simulate(there, r)
    return {name: _noise(campaign.logged[name], colour).on(clean[name], rng) for name in r.outputs}


def _noise(channel: Logged, colour: float) -> Noise:
    """The logger's; coloured if it is a torque."""
    step = channel.step or 0.0
    sigma = float(np.hypot(channel.noise or 0.0, step / np.sqrt(12)))
    return Noise(sigma, colour if channel.unit == "N.m" else 0.0, step)
