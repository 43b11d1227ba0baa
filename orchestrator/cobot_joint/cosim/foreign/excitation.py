"""Inputs that move a unit alone as its neighbours would, and whether it then gives more energy than it took."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim.experiment import Experiment
from cobot_joint.cosim.foreign.ports import Finding
from cobot_joint.cosim.schemes import WITHOUT_ROLLBACK
from cobot_joint.cosim.simulation import simulate
from cobot_joint.errors import UserError
from cobot_joint.results.result import Result
from cobot_joint.system.model import Component, Connection, Connector, Inputs, System
from cobot_joint.system.swap import Replacement, with_units
from cobot_joint.units import Flange, Unit

Signal = Callable[[float], float]
AMPLITUDE, OMEGA = 0.3, 20.0  # of an input's nominal value; rad/s
DURATION, STEP = 0.5, 1e-4  # s
SEEMS = 0.02  # of the work that flows: how much a unit may seem to give and not have
WHAT = "makes no energy"


def excitation(old: Component, new: Replacement, unit: Unit) -> dict[str, Signal]:
    """`motion` of the old unit by the new one's names. All other inputs stay at their start values."""
    signals = motion(old.unit)
    named = {new.name(port): signal for port, signal in signals.items()}
    return {name: signal for name, signal in named.items() if name in unit.variables}


def makes_no_energy(system: System, name: str, file: str) -> Iterator[Finding]:
    """Nothing where the component has no flanges. The unit starts at rest, and what it is fed is mechanical alone."""
    old = system.component(name)
    if not old.unit.flanges:
        return
    try:
        ports = list(dict.fromkeys(p for f in old.unit.flanges for p in (f.phi, f.w, f.tau)))
        bench = with_units(alone(old, ports), {name: file}, WHAT)
    except UserError:  # the findings about its ports say why
        yield Finding(WHAT, "lacks", "not tried, its ports do not fit")
        return
    if left_out := {p for f in old.unit.flanges for p in (f.w, f.tau)} - {*bench.inputs, *bench.outputs}:
        yield Finding(WHAT, "lacks", f"not tried without {', '.join(sorted(left_out))}")
        return
    time = np.linspace(0.0, DURATION, round(DURATION / STEP) + 1)
    signals = motion(old.unit)
    inputs = Inputs(time, {port: np.vectorize(signals[port])(time) for port in bench.inputs})
    experiment = Experiment(inputs, DURATION, output_step=STEP, step=STEP, scheme=WITHOUT_ROLLBACK)
    yield _judged(simulate(bench, experiment), inputs.values, old.unit.flanges)


def motion(unit: Unit) -> dict[str, Signal]:
    """For the inputs at the unit's flanges: speeds and torques that swing, angles of these speeds."""
    return {port: signal for flange in unit.flanges for port, signal in _swings(unit, flange).items()}


def _swings(unit: Unit, flange: Flange) -> dict[str, Signal]:
    """Of a flange's variables that are inputs. Every flange has its own frequencies."""
    number = unit.flanges.index(flange)
    omega = OMEGA * (1 + 0.37 * number)

    def amplitude(name: str) -> float:
        return AMPLITUDE * float(unit.variables[name].nominal or 1.0)

    def speed(t: float) -> float:
        return amplitude(flange.w) * np.sin(omega * t)

    def angle(t: float) -> float:
        return amplitude(flange.w) / omega * (1 - np.cos(omega * t))

    def torque(t: float) -> float:
        return amplitude(flange.tau) * np.sin(1.3 * omega * t)

    swings = {flange.w: speed, flange.phi: angle, flange.tau: torque}
    return {name: signal for name, signal in swings.items() if unit.variables[name].causality == "input"}


def alone(old: Component, ports: Sequence[str]) -> System:
    """The component alone, these Reals of it as inputs and outputs of the system, under their own names."""
    kinds = {p: old.unit.variables[p].causality for p in ports}
    connectors = {p: Connector(p, kinds[p], "Real", old.unit.unit_of(p)) for p in ports}
    wires = [
        Connection(None, p, old.name, p) if kinds[p] == "input" else Connection(old.name, p, None, p) for p in ports
    ]
    inputs, outputs = ({p: c for p, c in connectors.items() if c.causality == kind} for kind in ("input", "output"))
    return System(old.name, (old,), tuple(wires), inputs, outputs)


def _judged(result: Result, inputs: Mapping[str, NDArray[np.float64]], flanges: tuple[Flange, ...]) -> Finding:
    """What the unit holds at any time, of what it took: it held nothing at rest."""
    held, flowed = np.zeros(len(result.time)), 0.0
    for flange in flanges:
        w, tau = (inputs[name] if name in inputs else result[name] for name in (flange.w, flange.tau))
        power = tau * w if flange.role == "takes" else -tau * w
        held += np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(result.time))])
        flowed += float(np.mean(np.abs(power)) * DURATION)
    if np.min(held) >= -SEEMS * flowed:
        return Finding(WHAT, "ok", f"of {flowed:.3g} J that flowed it kept {held[-1]:.3g} J")
    return Finding(WHAT, "no", f"of {flowed:.3g} J that flowed it gave {-np.min(held):.3g} J more than it had taken")
