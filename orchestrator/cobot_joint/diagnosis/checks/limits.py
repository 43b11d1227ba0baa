"""Limits of a drive that the machine goes beyond: they hold the simulation, and no term explains what that leaves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from cobot_joint.diagnosis.checks.beside_nominal import Simulate, Vector
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion
from cobot_joint.system.model import Component, System
from cobot_joint.system.shafts import RATES, turning_with
from cobot_joint.system.wiring import CURRENT_MODE

SET_VALUE = "set_value"  # a motor's input, in V where its drive is in voltage mode
LIMITED = {"drive.w_max": "w", "drive.i_peak": "i"}  # parameter, 0: no limit -> the output that it limits
BEYOND = 1.05  # of a limit, that a recording is beyond it; within as much the simulation is held there
OVERRUN = 1.25  # times the supply, that a back-EMF is beyond it: a motor's constant and a supply are known to a tenth
MOSTLY = 0.99  # of a recording, that its largest value is taken of: a sample alone is no motion


def beyond_limits(
    recordings: Sequence[Recording], simulate: Simulate, systems: Mapping[str, System]
) -> Iterator[Suspicion]:
    """The first recording that goes beyond a limit at which the nominal system is held, for every limit; and the first
    that turns a motor faster than its supply lets the nominal system."""
    yield from _beyond_supply(recordings, simulate, systems)
    yield from _asked_beyond_supply(recordings, systems)
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


def _beyond_supply(
    recordings: Sequence[Recording], simulate: Simulate, systems: Mapping[str, System]
) -> Iterator[Suspicion]:
    told: set[str] = set()
    for r in recordings:
        for name, full, values in _supplies(systems[r.setup], r):
            v_bus, k = values
            reached, unit = _reached(r.outputs[name]), r.units.get(name, "")
            if full in told or not OVERRUN * v_bus < k * reached:
                continue
            held = _reached(np.asarray(simulate(r).get(name, np.full(1, np.inf))))
            if k * held < BEYOND * v_bus:
                told.add(full)
                words = (
                    f"it reaches {reached:.4g} {unit}, where its back-EMF is {k * reached:.4g} V, and "
                    f"{full} = {v_bus:.4g} V holds the simulation below {v_bus / k:.4g} {unit}: the machine's own "
                    f"supply voltage belongs into [parameters]"
                )
                yield Suspicion(r.name, name, "limit", words, wrong=True)


def _asked_beyond_supply(recordings: Sequence[Recording], systems: Mapping[str, System]) -> Iterator[Suspicion]:
    """Voltages that are asked of a drive and that its supply has not: a machine with that supply is held as well."""
    told: set[str] = set()
    for r in recordings:
        for wire in systems[r.setup].connections:
            u = r.inputs.get(wire.source) if wire.source_component is None else None
            drive = systems[r.setup].component(wire.sink_component) if wire.sink_component else None
            if u is None or drive is None or wire.sink != SET_VALUE or "inverter.v_bus" not in drive.unit.variables:
                continue
            full = f"{drive.name}.inverter.v_bus"
            v_bus, k_v = r.initial.get(full, _value(drive, "inverter.v_bus")), _value(drive, "drive.k_v")
            asked = _reached(k_v * (wire.factor * u + wire.offset))
            if drive.parameters.get("drive.mode") != CURRENT_MODE and full not in told and asked > BEYOND * v_bus:
                told.add(full)
                words = (
                    f"it asks for {asked:.4g} V, and {full} = {v_bus:.4g} V holds the simulation there: if the machine "
                    "has more, its supply belongs into [parameters]"
                )
                yield Suspicion(r.name, wire.source, "limit", words)


def _supplies(system: System, r: Recording) -> Iterator[tuple[str, str, tuple[float, float]]]:
    """Recorded speeds of motors, and of what turns with them, with the parameter that is their supply's voltage;
    (v_bus, back-EMF over that speed)."""
    for component in system.components:
        if not {"inverter.v_bus", "winding.k", "w"} <= component.unit.variables.keys():
            continue
        turning = turning_with(system, f"{component.name}.phi")
        speeds = {_shown(system, system.component(c), RATES[v]): times for n, times in turning.items()
                  for c, v in [n.split(".", 1)] if v in RATES}  # fmt: skip
        for name, times in speeds.items():
            if name not in r.outputs:
                continue
            full = [f"{component.name}.{parameter}" for parameter in ("inverter.v_bus", "winding.k")]
            v_bus, k = (r.initial.get(f, _value(component, f.split(".", 1)[1])) for f in full)
            yield name, full[0], (v_bus, abs(k / times))


def _limits(system: System, r: Recording) -> Iterator[tuple[str, str, float]]:
    """Recorded outputs with the parameter that limits them, and its value."""
    for component in system.components:
        for parameter, variable in LIMITED.items():
            name = _shown(system, component, variable)
            if parameter in component.unit.variables and name in r.outputs:
                full = f"{component.name}.{parameter}"
                yield name, full, r.initial.get(full, _value(component, parameter))


def _shown(system: System, component: Component, variable: str) -> str:
    """The system's output that is a component's; the variable's full name where there is none."""
    own = [
        w.sink
        for w in system.connections
        if (w.source_component, w.source) == (component.name, variable)
        if w.sink_component is None
    ]
    return own[0] if own else f"{component.name}.{variable}"


def _value(component: Component, parameter: str) -> float:
    value = component.parameters.get(parameter, component.unit.variables[parameter].start)
    return float(value or 0.0)


def _reached(x: Vector) -> float:
    known = np.abs(x[np.isfinite(x)])
    return float(np.quantile(known, MOSTLY)) if len(known) else 0.0
