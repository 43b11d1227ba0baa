"""One unit alone: does it run, repeat itself, and do what it says it can; what diagnosis and coupling would miss."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim.foreign.excitation import OMEGA, Signal, excitation, makes_no_energy
from cobot_joint.cosim.foreign.ports import Finding, port_findings
from cobot_joint.cosim.instances import Instance, SimulationError
from cobot_joint.errors import UserError
from cobot_joint.system.model import Component, System
from cobot_joint.system.swap import component_of, replacement, wired_ports
from cobot_joint.units import Unit, load_unit

STEPS, STEP = 200, 1e-3  # s
SAME = 0.02  # of an output's rms: what halved steps of the unit's own integration may change
RUNS = "runs alone"

Signals = NDArray[np.float64]


def examine(system: System, name: str, file: str) -> list[Finding]:
    """What an FMU, as `replacement` reads it, can and lacks in the place of a component of the system.

    UserError: there is no such component, or the file is no FMU that can be stepped.
    """
    new = replacement(file, "check")
    old, unit = component_of(system, name, f"check {file}"), load_unit(new.file)
    findings = list(port_findings(system, old, new, unit))
    try:
        with ExitStack() as stack:
            pair = [stack.enter_context(closing(Instance(Component(k, unit.path.name, unit)))) for k in ("a", "b")]
            outputs = _given(unit, [new.name(port) for port in wired_ports(system, name)])
            findings += _Alone(pair[0], pair[1], excitation(old, new, unit), outputs).findings()
        findings += makes_no_energy(system, name, file)
    except (SimulationError, UserError) as error:
        findings.append(Finding(RUNS, "no", str(error)))
    return [*findings, *_declared(unit)]


def _given(unit: Unit, names: list[str]) -> list[str]:
    """Those of the names that are Real outputs."""
    variables = [unit.variables[name] for name in names if name in unit.variables]
    return [v.name for v in variables if v.causality == "output" and v.type == "Real"]


def _declared(unit: Unit) -> Iterator[Finding]:
    """What a unit says of itself that coupling, energy rows and diagnosis use."""
    states = len(unit.states)
    can = unit.description.coSimulation
    jacobian = "" if can.providesDirectionalDerivative else "no directional derivatives: "
    yield _has(
        "states and derivatives", bool(states and not jacobian), f"{states} states",
        f"{jacobian}{states} states listed; a diagnosis cannot estimate its states",
    )  # fmt: skip
    yield _has("physics terms", bool(unit.terms), f"{len(unit.terms)}", "none listed; a diagnosis adds none to it")
    yield _has("flanges", bool(unit.flanges), "", "none annotated; the master measures the work at its ports")


def _has(what: str, there: bool, detail: str, otherwise: str) -> Finding:
    return Finding(what, "ok" if there else "lacks", detail if there else otherwise)


@dataclass
class _Alone:
    """The unit twice, to be run and compared with itself. `inputs`: name -> value over time; `outputs`: compared."""

    first: Instance
    second: Instance
    inputs: Mapping[str, Signal]
    outputs: list[str]

    def findings(self) -> Iterator[Finding]:
        """SimulationError: the unit fails in a plain run."""
        plain = self.moved(self.first)
        if not np.all(np.isfinite(plain)):
            bad = [n for n, x in zip(self.outputs, plain.T, strict=True) if not np.all(np.isfinite(x))]
            yield Finding(RUNS, "no", f"{', '.join(bad)} is not finite after {STEPS} steps of {STEP:g} s")
            return
        yield Finding(RUNS, "ok", f"{STEPS} steps of {STEP:g} s with moving inputs")
        yield self._compared("repeats itself after a reset", lambda: (plain, self.moved(self.first)))
        yield self._compared("does not disturb a second instance", lambda: (plain, self.moved(self.second)))
        yield self._able(
            "takes a step back", self.first.rolls_back, lambda: (plain, self.moved(self.first, back=True)),
            "canGetAndSetFMUstate is not declared: the step is fixed, and found by trying shorter ones",
        )  # fmt: skip
        yield self._able(
            "varies its step", self.first.varies_step, lambda: (self.let_go(1), self.let_go(2)),
            "canHandleVariableCommunicationStepSize is not declared: outputs that feed inputs through lag by half one",
        )  # fmt: skip
        yield _has(
            "follows its inputs", self.first.interpolates, "",
            "canInterpolateInputs is not declared: it is stepped in more parts, with constants over each",
        )  # fmt: skip
        yield _has("gives slopes of its outputs", self.first.gives_slopes, "", "maxOutputDerivativeOrder is 0")

    def moved(self, instance: Instance, back: bool = False) -> Signals:
        """Outputs at the end of every step, inputs set at its begin: (STEPS, outputs). `back`: each is taken twice."""
        self._start(instance, 0.0)
        table = np.empty((STEPS, len(self.outputs)))
        for k in range(STEPS):
            with instance.explained(f"at t = {k * STEP:g} s"):
                if back:
                    state = instance.fmu.getFMUstate()
                    self._step(instance, k)
                    instance.fmu.setFMUstate(state)
                    instance.fmu.freeFMUstate(state)
                self._step(instance, k)
                table[k] = [instance.get(name) for name in self.outputs]
        return table

    def let_go(self, parts: int) -> Signals:
        """Outputs at the end of every step that is made in `parts`, inputs set once: (STEPS, outputs)."""
        self._start(self.first, np.pi / 4 / OMEGA)
        table = np.empty((STEPS, len(self.outputs)))
        for k in range(STEPS):
            with self.first.explained(f"at t = {k * STEP:g} s"):
                for part in range(parts):
                    self.first.fmu.doStep(k * STEP + part * STEP / parts, STEP / parts)
                table[k] = [self.first.get(name) for name in self.outputs]
        return table

    def _start(self, instance: Instance, t: float) -> None:
        """Initialised, with the inputs that the signals have at t."""
        with instance.explained("in the initialisation"):
            instance.reset()
            instance.fmu.setupExperiment(startTime=0.0)
            instance.fmu.enterInitializationMode()
            self._set(instance, t)
            instance.fmu.exitInitializationMode()

    def _step(self, instance: Instance, k: int) -> None:
        self._set(instance, k * STEP)
        instance.fmu.doStep(k * STEP, STEP)

    def _set(self, instance: Instance, t: float) -> None:
        for name, signal in self.inputs.items():
            instance.set(name, signal(t))

    def _able(self, what: str, declared: bool, runs: Callable[[], tuple[Signals, Signals]], otherwise: str) -> Finding:
        return self._compared(what, runs) if declared else Finding(what, "lacks", otherwise)

    def _compared(self, what: str, runs: Callable[[], tuple[Signals, Signals]]) -> Finding:
        """ok: both ways give the same outputs, but for SAME of each one's rms."""
        try:
            one, other = runs()
        except (SimulationError, UserError) as error:
            return Finding(what, "no", str(error))
        size, off = (np.sqrt(np.mean(x**2, axis=0)) for x in (one, other - one))
        bad = [n for n, o, s in zip(self.outputs, off, size, strict=True) if not o <= SAME * s]
        return Finding(what, "no", f"{', '.join(bad)} comes out otherwise") if bad else Finding(what, "ok")
