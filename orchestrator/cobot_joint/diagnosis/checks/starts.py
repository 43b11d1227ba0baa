"""Positions that begin elsewhere in a recording than in the simulation, where the campaign says nothing of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.checks.beside_nominal import Simulate
from cobot_joint.diagnosis.data.conditioning import begins_apart
from cobot_joint.diagnosis.data.quantity import is_position
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion
from cobot_joint.system.model import System
from cobot_joint.system.wiring import shown_by

FIRST = 3  # samples that are simulated


def begin_elsewhere(
    recordings: Sequence[Recording], simulate: Simulate, systems: Mapping[str, System]
) -> Iterator[Suspicion]:
    """Every channel once, with the first recording in which it does."""
    told: set[str] = set()
    for r in recordings:
        shown = shown_by(systems[r.setup])
        free = [n for n in r.outputs if is_position(r.units.get(n)) and n not in told]
        free = [n for n in free if not {n, shown.get(n, n)} & r.initial.keys()]
        if not free:
            continue
        simulated = simulate(_first(r))
        for name in free:
            there = float(np.asarray(simulated.get(name, [np.nan]))[0])
            begins = begins_apart(r.outputs[name], there)
            if begins is not None:
                told.add(name)
                words = f"it begins at {begins:.4g} {r.units[name]} and the simulation at {there:.4g}: if so, "
                remedy = f'[initial] "{shown.get(name, name)}" = "first sample of {name}"'
                zero = (
                    f'; if only its zero lies elsewhere, offset = "{there - begins:.6g} {r.units[name]}" in [channels]'
                )
                yield Suspicion(r.name, name, "start", words + remedy + zero)


def _first(r: Recording) -> Recording:
    inputs, outputs = ({n: x[:FIRST] for n, x in series.items()} for series in (r.inputs, r.outputs))
    return replace(r, time=r.time[:FIRST], inputs=inputs, outputs=outputs)
