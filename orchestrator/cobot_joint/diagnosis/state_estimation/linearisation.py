"""A system's Jacobians along a run: those of its units, joined along the wires; its tangent from sample to sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim.points import UnitFunction
from cobot_joint.diagnosis.state_estimation.native import effect, linear
from cobot_joint.diagnosis.state_estimation.sampled import Piece, SampledSystem
from cobot_joint.system.model import Component, Connection, Value

Array = NDArray[np.float64]
OF_SAMPLES = frozenset("CDRS")  # what a tangent has per sample; the rest, per step
TURN = 0.7  # rad from sample to sample, from which on a periodic term is looked at between them
POINTS = 5  # at which it is, in every step


@dataclass(frozen=True)
class Jacobians:
    """dx/dt = A dx + B d + P theta, dy = C dx + D d + R theta for small deviations at each of n points.

    A: (n, states, states), B: (n, states, ports), C: (n, channels, states), D: (n, channels, ports); P, R: the same by
    parameters; T, S: by what is added to the units' outputs, (n, states, outputs) and (n, channels, outputs).
    """

    A: Array
    B: Array
    C: Array
    D: Array
    P: Array
    R: Array
    T: Array
    S: Array


@dataclass(frozen=True)
class Tangent:
    """x[k+1] = Phi[k] x[k] + Gamma[k] d[k] + Psi[k] theta, y[k] = C[k] x[k] + D[k] d[k] + R[k] theta.

    Of n samples, Phi, Gamma and Psi for the n - 1 steps between; d is held from sample to sample. A: (n - 1, states,
    states), the steps' Jacobian; Hold: the same, what one unit of a held derivative adds to the states; T, S: as in
    Jacobians, T for the steps.
    """

    A: Array
    Phi: Array
    Gamma: Array
    Psi: Array
    C: Array
    D: Array
    R: Array
    Hold: Array
    T: Array
    S: Array

    def __getitem__(self, rows: slice) -> Tangent:
        """Of a stretch of samples, and the steps between them."""
        between = slice(rows.start, rows.stop - 1)
        return Tangent(*(getattr(self, f)[rows if f in OF_SAMPLES else between] for f in self.__dataclass_fields__))


class Known:
    """What units are functions of, states and inputs by `(component, variable)`, at the samples of a run."""

    def __init__(self, sampled: SampledSystem, variables: Sequence[tuple[str, str]]) -> None:
        states = {(s.component, s.variable): column for column, s in enumerate(sampled.states)}
        wires = {(str(c.sink_component), c.sink): c for c in (*sampled.wires, *sampled.driven)}
        self.count = len(variables)
        self._driven = [(k, wires[v]) for k, v in enumerate(variables) if v not in states and v in wires
                        and wires[v].source_component is None]  # fmt: skip
        self._own = [k for k, v in enumerate(variables) if v in states], [states[v] for v in variables if v in states]
        inside = [(k, wires[v]) for k, v in enumerate(variables) if v not in states and wires[v].source_component]
        columns = [sampled.layout.columns[f"{c.source_component}.{c.source}"] for _, c in inside]
        self._wired = [k for k, _ in inside], columns
        self._factor, self._offset = (np.array([getattr(c, f) for _, c in inside]) for f in ("factor", "offset"))

    def __call__(self, piece: Piece, rows: slice = slice(None)) -> Array:
        """(n, variables)"""
        known = np.empty((len(piece.time[rows]), self.count))
        known[:, self._own[0]] = piece.x[rows][:, self._own[1]]
        known[:, self._wired[0]] = piece.table[rows][:, self._wired[1]] * self._factor + self._offset
        for place, wire in self._driven:
            u = piece.inputs.get(wire.source)
            known[:, place] = wire.offset if u is None else wire.factor * u[rows] + wire.offset
        return known


@dataclass(frozen=True)
class _Part:
    """One unit: what it is a function of, and where its rows and columns belong in the system."""

    component: Component
    known: list[str]
    unknown: list[str]
    directions: list[str]
    inner: list[int]  # rows of its states among those followed
    outer: list[int]  # rows of its outputs among those read
    columns: list[int]  # of its directions, among followed states, ports, parameters and wires
    factors: list[float]


class Lineariser:
    """Jacobians of a sampled system along its runs: by signals at ports, which are inputs of the system, by some of its
    states (all, unless said), and by parameters, `component.variable`."""

    def __init__(
        self,
        sampled: SampledSystem,
        ports: Sequence[str],
        followed: Sequence[int] | None = None,
        parameters: Sequence[str] = (),
    ) -> None:
        self.sampled, self.ports = sampled, tuple(ports)
        self.followed = list(range(len(sampled.states))) if followed is None else list(followed)
        self.parameters = tuple(parameters)
        self._outs = {source: j for j, source in enumerate(sampled.sources)}
        self._scale = sampled.nominal[self.followed]
        self._parts = [part for c in sampled.system.components if (part := self._part(c)).unknown]
        self._known = Known(sampled, [(p.component.name, v) for p in self._parts for v in p.known])
        n_x, n_q = len(self.followed), len(self.followed) + len(self.ports) + len(self.parameters)
        self._sizes = n_x, n_q, len(sampled.wires), len(self._outs), len(sampled.taps), self._known.count
        self._systems: dict[frozenset[str], linear.System] = {}  # by the values that are on
        self._of_part: dict[str, tuple[Piece, Array]] = {}  # where its known were last

    def __call__(self, piece: Piece, rows: slice = slice(None)) -> Jacobians:
        """At the piece's samples, or at some of them. SimulationError: a unit refuses.

        u = L out, out = G_x x + G_u u + G_d d + G_p theta, thus u = (I - L G_u)^-1 L (G_x x + G_d d + G_p theta)
        """
        X, Y, T, S = self._joined(piece.time[rows], self._known(piece, rows))
        borders = np.cumsum([len(self.followed), len(self.ports)])
        A, B, P = np.split(X, borders, axis=2)
        C, D, R = np.split(Y, borders, axis=2)
        return Jacobians(A, B, C, D, P, R, T, S)

    def tangent(self, piece: Piece) -> Tangent:
        """From sample to sample: over a step the Jacobians are the means of those at its ends, which takes a contact
        that closes between them as closed for half of the step; where something periodic turns by more than
        TURN, of points between them."""
        known = self._known(piece)
        X, Y, T, S = self._joined(piece.time, known)
        quick = any(self.turns(piece, component) > TURN for component in self._orders)
        X, T = self._between(piece.time, known) if quick else ((X[1:] + X[:-1]) / 2, (T[1:] + T[:-1]) / 2)
        h = float(piece.time[-1] - piece.time[0]) / (len(piece.time) - 1)
        A, Phi, Hold, inputs = linear.steps(X, h, self._scale)
        n_x, n_d = len(self.followed), len(self.ports)
        C, D, R = Y[:, :, :n_x], Y[:, :, n_x : n_x + n_d], Y[:, :, n_x + n_d :]
        return Tangent(A, Phi, inputs[:, :, :n_d], inputs[:, :, n_d:], C, D, R, Hold, T, S)

    def turns(self, piece: Piece, component: str, order: float | None = None) -> float:
        """By how many rad a periodic term of a component turns from sample to sample at most; order: periods per turn,
        None: the highest of those that are on."""
        unit = self.sampled.system.component(component).unit
        angles = [j for j, s in enumerate(self.sampled.states)
                  if s.component == component and unit.unit_of(s.variable) == "rad"]  # fmt: skip
        fastest = float(np.abs(np.diff(piece.x[:, angles], axis=0)).max(initial=0.0))
        return fastest * (self._orders.get(component, 0.0) if order is None else order)

    @cached_property
    def _orders(self) -> dict[str, float]:
        """Component -> periods per turn of what is on, if any is."""
        found: dict[str, float] = {}
        for c in self.sampled.system.components:
            values = {**c.parameters, **self.sampled.values_of(c.name, np.inf)}
            for term in (t for t in c.unit.terms if t.amplitude is not None):
                names = [str(term.amplitude), *(s.name for s in term.shapes if s.scan == "order")]
                size, *orders = [float(values.get(n, c.unit.variables[n].start or 0.0)) for n in names]
                if orders and size != term.neutral:
                    found[c.name] = max(found.get(c.name, 0.0), *orders)
        return found

    def _between(self, time: Array, known: Array) -> tuple[Array, Array]:
        """Means over each step of what derivatives go by: (n - 1, states, columns), (n - 1, states, outputs). The known
        are linear in between."""
        h, moved = np.diff(time), np.diff(known, axis=0)
        shares = (np.arange(POINTS) + 0.5) / POINTS
        every = [self._joined(time[:-1] + share * h, known[:-1] + share * moved) for share in shares]
        return np.mean([X for X, *_ in every], axis=0), np.mean([T for *_, T, _ in every], axis=0)

    def step(self, A: Array, h: float) -> tuple[Array, Array]:
        """Phi and Hold of steps of length h with Jacobians A: (n, states, states)."""
        return linear.exponential(A, h, self._scale)

    def _joined(self, time: Array, known: Array) -> tuple[Array, Array, Array, Array]:
        """Derivatives and channels by states, ports and parameters, and by what is added to the units' outputs: (n,
        states, columns), (n, channels, columns), (n, states, outputs), (n, channels, outputs). known: (n, variables)"""
        n_x, n_q, _, n_o, n_y, _ = self._sizes
        shapes = (n_x, n_q), (n_y, n_q), (n_x, n_o), (n_y, n_o)
        found = tuple(np.empty((len(time), *shape)) for shape in shapes)
        borders = np.searchsorted(time, [-np.inf, *sorted(self.sampled.onsets.values()), np.inf])
        for begin, end in pairwise(borders):
            if begin < end:
                part = slice(begin, end)
                self._system(float(time[begin])).jacobians(time[part], known[part], [M[part] for M in found])
        X, Y, T, S = found
        return X, Y, T, S

    def _system(self, t: float) -> linear.System:
        """With the values that hold at the time t."""
        sampled = self.sampled
        on = frozenset(name for name, onset in sampled.onsets.items() if onset <= t)
        if on not in self._systems:
            units = [
                linear.Unit(self._function(p, sampled.values_of(p.component.name, t)), p.directions, p.inner, p.outer,
                            p.columns, p.factors)
                for p in self._parts
            ]  # fmt: skip
            wires, taps = (_selection(which, self._outs) for which in (sampled.wires, sampled.taps))
            self._systems[on] = linear.System(units, self._sizes, wires, taps)
        return self._systems[on]

    def _function(self, part: _Part, values: Mapping[str, Value]) -> UnitFunction:
        return UnitFunction(self.sampled.simulation.instances[part.component.name], values, part.known, part.unknown)

    def effect(
        self, parameters: Sequence[str], values: Sequence[Mapping[str, Value]], piece: Piece, answer: effect.Answer
    ) -> tuple[Array, Array]:
        """What a unit of a parameter adds to the followed states from sample to sample and to the channels: (n - 1,
        states, columns), (n, channels, columns). parameters: of one component, one or one for each column; values: in
        each column, of other Real parameters of the component, the same ones in all of them.

        SimulationError: the unit refuses.
        """
        sampled, name = self.sampled, parameters[0].split(".", 1)[0]
        part = next(p for p in self._parts if p.component.name == name)
        varied = [v.split(".", 1)[1] for v in values[0]]
        columns = np.array([[float(v) for v in column.values()] for column in values])
        own = [parameter.split(".", 1)[1] for parameter in parameters]
        with sampled.in_use:  # a unit answers one at a time
            if name not in self._of_part or self._of_part[name][0] is not piece:  # every term of a component asks
                self._of_part[name] = piece, Known(sampled, [(name, v) for v in part.known])(piece)
            function = self._function(part, sampled.values_of(name, float(piece.time[0])))
            points = effect.Part(function, own, part.inner, part.outer, piece.time, self._of_part[name][1])
            return effect.along(points, varied, columns, answer)

    def gives_derivatives(self, component: str) -> bool:
        """Whether the unit itself gives directional derivatives; else differences are taken, of an `effect` at the
        samples only."""
        part = next(p for p in self._parts if p.component.name == component)
        return self._function(part, {}).gives_derivatives

    def _part(self, component: Component) -> _Part:
        sampled, name = self.sampled, component.name
        own = [s for s in sampled.states if s.component == name]
        followed = [(k, sampled.states[j]) for k, j in enumerate(self.followed) if sampled.states[j].component == name]
        sources = [v for c, v in sampled.sources if c == name]
        wired = [(j, c) for j, c in enumerate(sampled.wires) if c.sink_component == name]
        entering = [c for c in sampled.driven if c.sink_component == name]
        mine = [(j, p.split(".", 1)[1]) for j, p in enumerate(self.parameters) if p.startswith(f"{name}.")]
        d, p = len(self.followed), len(self.followed) + len(self.ports)
        u = p + len(self.parameters)
        columns = [(s.variable, k, 1.0) for k, s in followed]
        columns += [(c.sink, u + j, 1.0) for j, c in wired]
        columns += [(c.sink, d + self.ports.index(c.source), c.factor) for c in entering if c.source in self.ports]
        columns += [(name, p + j, 1.0) for j, name in mine]
        return _Part(
            component,
            [s.variable for s in own] + [c.sink for _, c in wired] + [c.sink for c in entering],
            [s.derivative for _, s in followed] + sources,
            [variable for variable, _, _ in columns],
            [k for k, _ in followed],
            [self._outs[name, v] for v in sources],
            [column for _, column, _ in columns],
            [factor for _, _, factor in columns],
        )


def _selection(wires: Sequence[Connection], outs: dict[tuple[str, str], int]) -> Array:
    """(wires, outputs): what a wire carries of which output"""
    M = np.zeros((len(wires), len(outs)))
    for j, c in enumerate(wires):
        M[j, outs[str(c.source_component), c.source]] = c.factor
    return M
