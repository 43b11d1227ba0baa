"""Initialisation: parameters, then values passed along the wires, in the order in which outputs depend on inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cobot_joint.cosim.instances import Instance, SimulationError
from cobot_joint.system.model import Connection, Value

MOST_SWEEPS = 50  # over an algebraic loop
SETTLED = 1e-12  # of the value's size

Order = Sequence[Sequence[Connection]]  # as cobot_joint.system.initial_order gives it


def initialise(
    order: Order,
    instances: Mapping[str, Instance],
    parameters: Mapping[str, Mapping[str, Value]],
    inputs: Mapping[str, float],
    start_time: float,
    stop_time: float,
) -> None:
    """Bring fresh or used instances to the first communication point.

    `parameters`: component -> parameter -> value, over the system's own; `inputs`: the system's inputs at the start.
    SimulationError: a unit refuses a call, or an algebraic loop has no fixed point.
    """
    for instance in instances.values():
        with instance.explained("while being set up"):
            instance.reset()
            for name, value in {**instance.component.parameters, **parameters.get(instance.name, {})}.items():
                instance.set(name, value)
            instance.fmu.setupExperiment(startTime=start_time, stopTime=stop_time)
            instance.fmu.enterInitializationMode()
    for group in order:
        _pass_on(group, instances, inputs)
    for instance in instances.values():
        with instance.explained("on leaving initialisation"):
            instance.fmu.exitInitializationMode()


def _pass_on(group: Sequence[Connection], instances: Mapping[str, Instance], inputs: Mapping[str, float]) -> None:
    """One wire, or the wires of an algebraic loop, swept until their values no longer change."""
    last: dict[int, float] = {}
    loops = len(group) > 1 or group[0].source_component == group[0].sink_component
    for _ in range(MOST_SWEEPS):
        moved = False
        for k, wire in enumerate(group):
            value = _source_value(wire, instances, inputs)
            if value is None:
                continue
            if k not in last or abs(value - last[k]) > SETTLED * (1 + abs(value)):
                last[k], moved = value, True
                sink = instances[str(wire.sink_component)]
                with sink.explained(f"on taking {wire.name} = {value:g} during initialisation"):
                    sink.set(wire.sink, value)
        if not (moved and loops):
            return
    loop = ", ".join(wire.name for wire in group)
    raise SimulationError(f"initial values do not settle in {MOST_SWEEPS} sweeps over the loop {loop}")


def _source_value(wire: Connection, instances: Mapping[str, Instance], inputs: Mapping[str, float]) -> float | None:
    """None: an input of the system that nothing drives."""
    if wire.source_component is None:
        if wire.source not in inputs:
            return None
        value = inputs[wire.source]
    else:
        source = instances[wire.source_component]
        with source.explained(f"on giving {wire.name} during initialisation"):
            value = source.get(wire.source)
    return wire.factor * value + wire.offset
