"""Initialisation: parameters, then values passed along the wires until they no longer change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from orchestrator.cosim.instances import Instance, SimulationError
from orchestrator.system.model import Connection, System, Value

MOST_SWEEPS = 50
SETTLED = 1e-12  # of the value's size


def initialise(
    system: System,
    instances: Sequence[Instance],
    parameters: Mapping[str, Mapping[str, Value]],
    inputs: Mapping[str, float],
    start_time: float,
    stop_time: float,
) -> None:
    """Bring fresh or used instances to the first communication point.

    `parameters`: component -> parameter -> value, over the system's own; `inputs`: the system's inputs at the start.
    SimulationError: a unit refuses a call, or wires form a loop without a fixed point.
    """
    for instance in instances:
        with instance.explained("while being set up"):
            instance.reset()
            instance.fresh = False
            for name, value in {**instance.component.parameters, **parameters.get(instance.name, {})}.items():
                instance.set(name, value)
            instance.fmu.setupExperiment(startTime=start_time, stopTime=stop_time)
            instance.fmu.enterInitializationMode()
    _propagate(system, instances, inputs)
    for instance in instances:
        with instance.explained("on leaving initialisation"):
            instance.fmu.exitInitializationMode()


def _propagate(system: System, instances: Sequence[Instance], inputs: Mapping[str, float]) -> None:
    """Sweep over the units; without a loop, values settle in as many sweeps as wires go against the order, plus one."""
    by_name = {instance.name: instance for instance in instances}
    wires = {i.name: [c for c in system.connections if c.sink_component == i.name] for i in instances}
    last: dict[Connection, float] = {}
    moved: Connection | None = None
    for _ in range(MOST_SWEEPS):
        moved = None
        for instance in instances:
            for wire in wires[instance.name]:
                value = _source_value(wire, by_name, inputs)
                if value is None:
                    continue
                if wire not in last or abs(value - last[wire]) > SETTLED * (1 + abs(value)):
                    moved = wire
                    last[wire] = value
                    with instance.explained(f"on taking {wire.name} = {value:g} during initialisation"):
                        instance.set(wire.sink, value)
        if moved is None:
            return
    assert moved is not None
    raise SimulationError(
        f"{system.name}: {moved.name} does not settle during initialisation, {MOST_SWEEPS} sweeps were made"
    )


def _source_value(wire: Connection, by_name: Mapping[str, Instance], inputs: Mapping[str, float]) -> float | None:
    if wire.source_component is None:
        if wire.source not in inputs:
            return None
        value = inputs[wire.source]
    else:
        source = by_name[wire.source_component]
        with source.explained(f"on giving {wire.name} during initialisation"):
            value = source.get(wire.source)
    return wire.factor * value + wire.offset
