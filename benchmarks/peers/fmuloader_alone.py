"""One unit in fmuloader: stepped, or integrated by Kutta's method of order 4 with events located by bisection."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.alone import Table, Task
from benchmarks.peers.fmuloader_loop import Unit

PARTS, HALVINGS = 2, 40  # of a step; of an interval in which an event is


class Inputs:
    """Linear between rows."""

    def __init__(self, unit: Unit, task: Task) -> None:
        self.time = np.arange(task.steps + 1) * task.step
        self.references = [unit.references[name] for name in task.inputs]
        self.values = list(task.inputs.values())

    def at(self, t: float) -> list[float]:
        return [float(np.interp(t, self.time, column)) for column in self.values]


class Exchanged:
    """A unit's states integrated, from event to event."""

    def __init__(self, unit: Unit, inputs: Inputs, counts: tuple[int, int]) -> None:
        self.fmu, self.unit, self.inputs = unit.fmu, unit, inputs
        self.n, self.events = counts
        self.t = 0.0
        self.event()

    def event(self) -> None:
        """In event mode when it is called, in continuous-time mode behind it."""
        again = True
        while again:
            again, defined, time = self.unit.discrete_states()
        self.next_event = time if defined else np.inf
        self.fmu.enter_continuous_time_mode()
        self.x = np.array(self.fmu.get_continuous_states(self.n))
        self.z = self.indicators(self.t, self.x)

    def at(self, t: float, x: Table) -> None:
        self.fmu.set_time(t)
        self.unit.set(self.inputs.references, self.inputs.at(t))
        self.fmu.set_continuous_states(x.tolist())

    def slope(self, t: float, x: Table) -> Table:
        self.at(t, x)
        return np.array(self.unit.derivatives(self.n))

    def indicators(self, t: float, x: Table) -> Table:
        self.at(t, x)
        return np.array(self.fmu.get_event_indicators(self.events))

    def stepped(self, h: float) -> Table:
        """Kutta 1901: the states after h."""
        t, x = self.t, self.x
        k1 = self.slope(t, x)
        k2 = self.slope(t + h / 2, x + h / 2 * k1)
        k3 = self.slope(t + h / 2, x + h / 2 * k2)
        k4 = self.slope(t + h, x + h * k3)
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def meets(self, z: NDArray[np.float64]) -> bool:
        return bool(np.any((self.z < 0) & (z > 0)))

    def run(self, end: float, longest: float) -> None:
        while self.t < end:
            to = min(end, self.t + longest, self.next_event)
            x = self.stepped(to - self.t)
            z = self.indicators(to, x)
            met = self.meets(z)
            if met:
                to, x = self.first_event(to)
                z = self.indicators(to, x)
            self.t, self.x, self.z = to, x, z
            self.fmu.completed_integrator_step()
            if met or to >= self.next_event:
                self.fmu.enter_event_mode()
                self.event()

    def first_event(self, to: float) -> tuple[float, Table]:
        """A time shortly behind the first indicator that turns positive, and the states there."""
        before = self.t
        for _ in range(HALVINGS):
            middle = (before + to) / 2
            if not before < middle < to:
                break
            if self.meets(self.indicators(middle, self.stepped(middle - self.t))):
                to = middle
            else:
                before = middle
        return to, self.stepped(to - self.t)


def alone(task: Task) -> Table:
    unit = Unit(task.path, task.path.stem, task.folder, task.kind)
    inputs = Inputs(unit, task)
    for name in task.outputs():
        unit.reads(name)
    unit.set(inputs.references, inputs.at(0.0))
    unit.fmu.exit_initialization_mode()
    exchanged = Exchanged(unit, inputs, unit.counts()) if task.kind == "ModelExchange" else None
    unit.read()
    rows = [unit.values]
    for k in range(task.steps):
        if exchanged:
            exchanged.run((k + 1) * task.step, task.step / PARTS)
        else:
            unit.set(inputs.references, inputs.at(k * task.step))
            unit.fmu.do_step(k * task.step, task.step)
        unit.read()
        rows.append(unit.values)
    unit.close()
    return np.array(rows)
