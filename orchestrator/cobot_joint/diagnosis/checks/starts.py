"""Positions and speeds that begin elsewhere in a recording than in the simulation, and no campaign says so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.checks.beside_nominal import Simulate
from cobot_joint.diagnosis.data.conditioning import begins_apart
from cobot_joint.diagnosis.data.parameters import first_sample
from cobot_joint.diagnosis.data.quantity import is_position
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion
from cobot_joint.system.model import System
from cobot_joint.system.shafts import angles_with, speeds_with
from cobot_joint.system.wiring import shown_by

FIRST = 3  # samples that are simulated


def begin_elsewhere(
    recordings: Sequence[Recording], simulate: Simulate, systems: Mapping[str, System]
) -> Iterator[Suspicion]:
    """Every channel once, with the first recording in which it does."""
    told: set[str] = set()
    for r in recordings:
        shown = shown_by(systems[r.setup])
        free = {n: states for n in r.outputs if n not in told and (states := _states(systems[r.setup], n, r.units))}
        free = {n: states for n, states in free.items() if not {n, shown.get(n, n), *states} & r.initial.keys()}
        if not free:
            continue
        simulated = simulate(_first(r))
        for name, states in free.items():
            there = float(np.asarray(simulated.get(name, [np.nan]))[0])
            begins = begins_apart(r.outputs[name], there)
            if begins is None:
                continue
            told.add(name)
            words = f"it begins at {begins:.4g} {r.units[name]} and the simulation at {there:.4g}: if so, "
            remedy = ", ".join(f'"{state}" = "{first_sample(name, times)}"' for state, times in states.items())
            zero = f'; if only its zero lies elsewhere, offset = "{there - begins:.6g} {r.units[name]}" in [channels]'
            yield Suspicion(r.name, name, "start", f"{words}[initial] {remedy}{zero}")


def _states(system: System, name: str, units: Mapping[str, str]) -> dict[str, float]:
    """What says where an output begins -> how many times it: all that turns with it. A shaft that began elsewhere than
    the next would be wound up: a table 0.5 rad from its gear pulled at it with 6500 N.m."""
    if is_position(units.get(name)):
        return angles_with(system, shown_by(system).get(name, name))
    return speeds_with(system, name)


def _first(r: Recording) -> Recording:
    inputs, outputs = ({n: x[:FIRST] for n, x in series.items()} for series in (r.inputs, r.outputs))
    return replace(r, time=r.time[:FIRST], inputs=inputs, outputs=outputs)
