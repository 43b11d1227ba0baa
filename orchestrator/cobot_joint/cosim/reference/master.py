"""The loop over communication steps, as `cosim/master/master.c` has it in C, many times slower."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from fmpy.fmi1 import FMICallException
from numpy.typing import NDArray

from cobot_joint.cosim.clock import Clock
from cobot_joint.cosim.instances import Instance, SimulationError
from cobot_joint.cosim.plan import Plan, PlannedUnit, Wire
from cobot_joint.cosim.reference.inputs import SampledInputs
from cobot_joint.cosim.reference.signals import (
    Past,
    Polynomial,
    constant,
    extrapolate_values,
    extrapolate_with_slope,
    hermite,
    integral,
    line,
    shifted,
    value,
)
from cobot_joint.cosim.schemes import Scheme
from cobot_joint.system.model import Inputs

DISCARD = 2  # fmi2Discard: a shorter step might do; of slopes before the first step, not known yet
LAST_STAIR = 1e-3  # of a step
CALM = 8  # steps after one that was taken back, before steps may grow again


class Master:
    """The reference over one plan. `inputs`: those of the plan, in its order; `breaks`: int64[n], ticks."""

    def __init__(self, plan: Plan, scheme: Scheme, inputs: Inputs, clock: Clock, breaks: NDArray[np.int64]) -> None:
        self.plan, self.scheme = plan, scheme
        self.inputs = SampledInputs(inputs, clock.step)
        self.start_time, self.step_size = clock.start, clock.step
        self.ticks_per_record, self.max_stride = clock.per_row, clock.stride
        self.breaks = [int(tick) for tick in breaks]
        self.y = [0.0] * plan.n_outputs
        self.dy = [0.0] * plan.n_outputs
        self.expected = [0.0] * plan.n_outputs
        self.p: list[Polynomial] = [constant(0.0)] * (plan.n_outputs + len(plan.inputs))
        self.sample = 0
        self.h_prev = self.h_prev2 = 0.0
        self.work = [0.0] * len(plan.ports)
        self.count = {"steps": 0, "rejected": 0, "sweeps": 0, "warnings": 0}

    def begin(self) -> None:
        """Tick 0, from the units' present state."""
        self.tick, self.stride, self.known, self.calm, self._rows = 0, 1, 1, 0, 0
        self.sample = self.inputs.sample_before(0, self._time(0))
        for unit in self.plan.units:
            self._get_outputs(unit)
            try:
                self._get_slopes(unit)
            except FMICallException as error:
                if error.status != DISCARD:
                    raise
        self.past = [Past(y, dy) for y, dy in zip(self.y, self.dy, strict=True)]
        self.total, self.total_abs = [0.0] * len(self.work), [0.0] * len(self.work)

    def resume(self) -> None:
        """After values were set in units from outside: signals that jumped take their past with them."""
        self.stride = 1
        for unit in self.plan.units:
            self._get_outputs(unit)
        for y, past in zip(self.y, self.past, strict=True):
            jump = y - past.y
            past.y = y
            past.y_prev += jump
            past.y_prev2 += jump

    def advance(self, tick: int, rows: NDArray[np.float64]) -> None:
        """On to `tick`; `rows`: float64[recorded points passed, recorded signals], filled."""
        remaining = iter(rows)
        while self.tick < tick:
            self._limit_stride(tick)
            self._step(remaining)
            if self.tick % self.ticks_per_record == 0:
                self.record(next(remaining))

    def record(self, row: NDArray[np.float64]) -> None:
        """The present point; `row`: float64[recorded signals], filled."""
        t = self._time(self.tick)
        k = self.inputs.sample_before(self.sample, t)
        for unit in self.plan.units:
            self._get_watched(unit)
        for j, wire in enumerate(self.plan.recorded):
            n = wire.signal - self.plan.n_outputs
            y = self.y[wire.signal] if n < 0 else self.inputs.at(n, k, t)
            row[j] = wire.factor * y + wire.offset
        self._rows += 1

    def rows(self) -> int:
        """Recorded since tick 0: what is there when a unit fails."""
        return self._rows

    def counters(self) -> dict[str, int]:
        """Steps taken, steps rejected, sweeps over the units; FMPy does not tell of warnings."""
        return dict(self.count)

    def works(self) -> list[tuple[float, float]]:
        """Per port of the plan: work since the start, integral of its power's absolute value; variables' units."""
        return list(zip(self.total, self.total_abs, strict=True))

    def close(self) -> None:
        """Nothing is held beyond a step."""

    # Steps

    def _step(self, rows: Iterator[NDArray[np.float64]]) -> None:
        scheme = self.scheme
        states = [unit.instance.fmu.getFMUstate() for unit in self._swept()] if scheme.rolls_back else []
        t, error = self._time(self.tick), 0.0
        while True:
            h = self.stride * self.step_size
            for unit in self.plan.units:
                self._extrapolate(unit, h)
            self._follow_inputs(t, self._time(self.tick + self.stride), h)
            done = self._sweep(t, h)
            for _ in range(1, scheme.sweeps):
                if not done or self._coupling_error(h) <= 1:
                    break
                if not scheme.sequential:
                    for unit in self.plan.units:
                        self._interpolate(unit, h)
                self._restore(states)
                done = self._sweep(t, h)
            if not scheme.adaptive:
                break
            error = self._coupling_error(h) if done else math.inf
            if error <= 1 or self.stride == 1:
                break
            self._restore(states)
            self.stride //= 2
            self.calm = 0
            self.count["rejected"] += 1
        for unit, state in zip(self._swept(), states, strict=False):
            unit.instance.fmu.freeFMUstate(state)
        self._follow(t, h, rows)
        self._accept(h)
        if scheme.adaptive:
            self._choose_stride(error)

    def _sweep(self, t: float, h: float) -> bool:
        """False: a unit discarded the step, a shorter one is to be tried."""
        self.count["sweeps"] += 1
        for unit in self._swept():
            if not self._step_unit(unit, t, 0.0, h):
                return False
            if self.scheme.sequential:
                self._interpolate(unit, h)
        return True

    def _swept(self) -> list[PlannedUnit]:
        return [unit for unit in self.plan.units if not unit.is_sink]

    def _step_unit(self, unit: PlannedUnit, t: float, s: float, h: float) -> bool:
        if not all(self._step_part(unit, t, *part) for part in self._parts(unit, s, h)):
            return False
        with unit.instance.explained(f"at t = {t:.9g} s"):
            self._get_outputs(unit)
            self._get_slopes(unit)
        self._measure_work(unit, h)
        return True

    def _parts(self, unit: PlannedUnit, s: float, h: float) -> list[tuple[float, float]]:
        """(begin, length): the step, or of a unit that holds its inputs the stairs that it climbs.

        The last is short, so that outputs which feed inputs through belong to the step's end: FMI 2.0 lets no master
        set inputs and read outputs without a step in between.
        """
        if not unit.stairs:
            return [(s, h)]
        run = (h - LAST_STAIR * h) / unit.stairs
        climbed = unit.stairs * run
        return [*((s + k * run, run) for k in range(unit.stairs)), (s + climbed, h - climbed)]

    def _step_part(self, unit: PlannedUnit, t: float, s: float, h: float) -> bool:
        instance = unit.instance
        with instance.explained(f"at t = {t:.9g} s"):
            self._set_real_inputs(unit, s, h)
            self._set_discrete_inputs(unit)
        try:
            instance.fmu.doStep(t + s, h, unit.is_sink or not self.scheme.rolls_back)
        except FMICallException as error:
            if error.status == DISCARD and self.scheme.adaptive and self.stride > 1 and not unit.is_sink:
                return False
            status = ("ok", "warning", "discard", "error", "fatal", "pending")[error.status]
            message = f"{instance.name}: fmi2DoStep returned {status} at t = {t + s:.9g} s, step {h:.9g} s"
            raise SimulationError(message + instance.last_words()) from error
        return True

    def _measure_work(self, unit: PlannedUnit, h: float) -> None:
        """Work through ports whose units do not tell it: input times output over the step just computed."""
        for k, port in enumerate(self.plan.ports):
            if self.plan.units[port.unit] is unit:
                u, y = self._seen(unit, unit.wires[port.input], h), self._interpolated(unit, port.output, h)
                self.work[k] = integral(u, y, h)

    def _seen(self, unit: PlannedUnit, wire: Wire, h: float) -> Polynomial:
        """An input over a step as its unit saw it; stairs count as what they climb."""
        p = self._through(wire, 0.0)
        if unit.input_order == 1:
            return line(p[0], value(p, h), h)
        if unit.input_order == 0 and not unit.stairs:
            return constant(value(p, h if unit.holds_end else 0.5 * h))
        return p

    def _restore(self, states: list[object]) -> None:
        for unit, state in zip(self._swept(), states, strict=True):
            unit.instance.fmu.setFMUstate(state)

    def _accept(self, h: float) -> None:
        self.past = [
            Past(y, dy, past.y, past.dy, past.y_prev) for y, dy, past in zip(self.y, self.dy, self.past, strict=True)
        ]
        for k, work in enumerate(self.work):
            self.total[k] += work
            self.total_abs[k] += abs(work)
        self.h_prev, self.h_prev2 = h, self.h_prev
        self.known = min(self.known + 1, 3)
        self.tick += self.stride
        self.count["steps"] += 1

    def _choose_stride(self, error: float) -> None:
        """Strides are powers of two, aligned to themselves. The error grows as step to the power extrapolation + 1.

        After a step was taken back, growth waits, lest the coupling be tried at its limit of stability over and over.
        """
        room = 2.0 ** (self.scheme.extrapolation + 1)
        doubled = 2 * self.stride
        self.calm += 1
        aligned = doubled <= self.max_stride and self.tick % doubled == 0
        if self.calm > CALM and error * room < 0.5 and aligned:
            self.stride = doubled

    def _limit_stride(self, tick: int) -> None:
        """No longer than to `tick` or, for long steps, to where an input turns."""
        most = tick - self.tick
        if self.scheme.adaptive:
            most = min([most, *(turn - self.tick for turn in self.breaks if turn > self.tick)])
        while self.stride > most:
            self.stride //= 2

    def _follow(self, t: float, h: float, rows: Iterator[NDArray[np.float64]]) -> None:
        """The step just computed is final: sinks follow on the signals' interpolants, recorded ticks get their rows."""
        every, end = self.ticks_per_record, self.tick + self.stride
        if not self.scheme.sequential and (self.stride > every or self.scheme.rolls_back):
            for unit in self.plan.units:
                self._interpolate(unit, h)
        inside = range((self.tick // every + 1) * every, end, every)
        s = 0.0
        for tick in [*inside, end]:
            s_next = (tick - self.tick) * self.step_size
            for unit in [unit for unit in self.plan.units if unit.is_sink]:
                self._step_unit(unit, t, s, s_next - s)
                if tick < end:
                    self._get_watched(unit)
                    for k in range(unit.first_signal, unit.first_signal + unit.n_signals):
                        self.p[k] = constant(self.y[k])
            s = s_next
            if tick == end:
                return
            row = next(rows)
            for j, wire in enumerate(self.plan.recorded):
                row[j] = wire.factor * value(self.p[wire.signal], s) + wire.offset
            self._rows += 1

    # One unit

    def _set_real_inputs(self, unit: PlannedUnit, s: float, h: float) -> None:
        refs = unit.inputs[0]
        if not refs:
            return
        polynomials = [self._through(wire, s) for wire in unit.wires[: len(refs)]]
        at = 0.0 if unit.input_order > 0 else h if unit.holds_end else 0.5 * h
        unit.instance.fmu.setReal(refs, [value(p, at) for p in polynomials])
        orders = range(1, unit.input_order + 1)
        if unit.input_order == 1:
            slopes = [(value(p, h) - p[0]) / h for p in polynomials]
        else:
            slopes = [d for p in polynomials for d in (p[1], 2 * p[2], 6 * p[3])]
        if orders:
            unit.instance.fmu.setRealInputDerivatives(
                [ref for ref in refs for _ in orders], [order for _ in refs for order in orders], slopes
            )

    def _set_discrete_inputs(self, unit: PlannedUnit) -> None:
        """Integers and Booleans: the value at the step's begin, or the one just computed by a unit before."""
        integers, booleans = unit.inputs[1:]
        first = len(unit.inputs[0])
        held = [self.p[wire.signal][0] for wire in unit.wires[first:]]
        if integers:
            unit.instance.fmu.setInteger(integers, [round(x) for x in held[: len(integers)]])
        if booleans:
            unit.instance.fmu.setBoolean(booleans, [x >= 0.5 for x in held[len(integers) :]])

    def _get_outputs(self, unit: PlannedUnit) -> None:
        self._get(unit.instance, unit.outputs, unit.first_signal)

    def _get_watched(self, unit: PlannedUnit) -> None:
        self._get(unit.instance, unit.watched, unit.first_signal + unit.n_outputs)

    def _get_slopes(self, unit: PlannedUnit) -> None:
        if unit.output_derivatives and unit.outputs[0]:
            first, n = unit.first_signal, len(unit.outputs[0])
            self.dy[first : first + n] = unit.instance.fmu.getRealOutputDerivatives(unit.outputs[0], [1] * n)

    def _get(self, instance: Instance, columns: tuple[tuple[int, ...], ...], first: int) -> None:
        fmu = instance.fmu
        for refs, get in zip(columns, (fmu.getReal, fmu.getInteger, fmu.getBoolean), strict=True):
            if refs:
                self.y[first : first + len(refs)] = [float(y) for y in get(refs)]
                first += len(refs)

    def _through(self, wire: Wire, s: float) -> Polynomial:
        a0, a1, a2, a3 = shifted(self.p[wire.signal], s)
        return a0 * wire.factor + wire.offset, a1 * wire.factor, a2 * wire.factor, a3 * wire.factor

    # Signals

    def _extrapolate(self, unit: PlannedUnit, h: float) -> None:
        degree = self.scheme.extrapolation
        n_real = len(unit.outputs[0])
        for s in range(unit.first_signal, unit.first_signal + unit.n_outputs):
            if s >= unit.first_signal + n_real:
                self.p[s] = constant(self.past[s].y)
            elif unit.output_derivatives:
                self.p[s] = extrapolate_with_slope(self.past[s], degree, self.known, self.h_prev)
            else:
                self.p[s] = extrapolate_values(self.past[s], degree, self.known, self.h_prev, self.h_prev2)
            self.expected[s] = value(self.p[s], h)

    def _interpolate(self, unit: PlannedUnit, h: float) -> None:
        n_real = len(unit.outputs[0])
        for s in range(unit.first_signal, unit.first_signal + unit.n_outputs):
            is_real = s < unit.first_signal + n_real
            self.p[s] = self._interpolated(unit, s, h) if is_real else constant(self.y[s])

    def _interpolated(self, unit: PlannedUnit, s: int, h: float) -> Polynomial:
        past = self.past[s]
        if self.scheme.interpolation == 3 and unit.output_derivatives:
            return hermite(past.y, past.dy, self.y[s], self.dy[s], h)
        return line(past.y, self.y[s], h)

    def _follow_inputs(self, t: float, t_end: float, h: float) -> None:
        """Chords of the system's inputs, or what is held at the step's begin; exact where no sample lies inside."""
        self.sample = self.inputs.sample_before(self.sample, t)
        k_end = self.inputs.sample_before(self.sample, t_end)
        for j in range(len(self.plan.inputs)):
            begin = self.inputs.at(j, self.sample, t)
            end = begin if self.inputs.held[j] else self.inputs.at(j, k_end, t_end)
            self.p[self.plan.n_outputs + j] = line(begin, end, h)

    def _coupling_error(self, h: float) -> float:
        """Off by how many tolerances: the worst of what readers expected of signals (then they expect what came out).

        Also of energy that one unit gave and the next did not take in a step of length h: it tells of impacts that are
        over before the step is.
        """
        worst, tolerance = 0.0, self.scheme.tolerance
        for s, judged in enumerate(self.plan.judged):
            if not judged:
                continue
            error = abs(self.y[s] - self.expected[s]) / (tolerance * (self.plan.nominal[s] + abs(self.y[s])))
            if not error <= worst:  # NaN counts as worst
                worst = error
            self.expected[s] = self.y[s]
        for flow in self.plan.flows:
            given, taken = (self.y[s] - self.past[s].y for s in (flow.given, flow.taken))
            error = abs(given - taken) / (tolerance * (flow.power * h + abs(given)))
            if not error <= worst:
                worst = error
        return worst

    # Time

    def _time(self, tick: int) -> float:
        return self.start_time + tick * self.step_size
