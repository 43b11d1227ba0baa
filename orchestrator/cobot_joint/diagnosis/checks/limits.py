"""Limits of a drive that the machine goes beyond: they hold the simulation, and no term explains what that leaves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from cobot_joint.diagnosis.checks.beside_nominal import Simulate, Vector
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion
from cobot_joint.system.model import Component, System

LIMITED = {"drive.w_max": "w", "drive.i_peak": "i"}  # parameter, 0: no limit -> the output that it limits
BEYOND = 1.05  # of a limit, that a recording is beyond it; within as much the simulation is held there
MOSTLY = 0.99  # of a recording, that its largest value is taken of: a sample alone is no motion


def beyond_limits(
    recordings: Sequence[Recording], simulate: Simulate, systems: Mapping[str, System]
) -> Iterator[Suspicion]:
    """The first recording that goes beyond a limit at which the nominal system is held, for every limit."""
    told: set[str] = set()
    for r in recordings:
        for name, limit, value in _limits(systems[r.setup], r):
            reached = _reached(r.outputs[name])
            if limit in told or not 0 < BEYOND * value < reached:
                continue
            held = _reached(np.asarray(simulate(r).get(name, np.zeros(1))))
            if value / BEYOND < held < value * BEYOND:
                told.add(limit)
                unit = r.units.get(name, "")
                words = (
                    f"it reaches {reached:.4g} {unit}, and {limit} = {value:.4g} holds the simulation at {held:.4g}: "
                    f"the machine's own limit belongs into [parameters], or 0 for none"
                )
                yield Suspicion(r.name, name, "limit", words, wrong=True)


def _limits(system: System, r: Recording) -> Iterator[tuple[str, str, float]]:
    """Recorded outputs with the parameter that limits them, and its value."""
    shown = {(w.source_component, w.source): w.sink for w in system.connections if w.sink_component is None}
    for component in system.components:
        for parameter, variable in LIMITED.items():
            name = shown.get((component.name, variable), f"{component.name}.{variable}")
            if parameter in component.unit.variables and name in r.outputs:
                full = f"{component.name}.{parameter}"
                yield name, full, r.initial.get(full, _value(component, parameter))


def _value(component: Component, parameter: str) -> float:
    value = component.parameters.get(parameter, component.unit.variables[parameter].start)
    return float(value or 0.0)


def _reached(x: Vector) -> float:
    known = np.abs(x[np.isfinite(x)])
    return float(np.quantile(known, MOSTLY)) if len(known) else 0.0
