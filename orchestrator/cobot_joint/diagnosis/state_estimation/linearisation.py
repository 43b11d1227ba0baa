"""A system's Jacobians along a run: those of its units, joined along the wires; its tangent from sample to sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim.points import UnitFunction
from cobot_joint.diagnosis.state_estimation.sampled import Piece, SampledSystem
from cobot_joint.system.model import Component, Connection, Value

Array = NDArray[np.float64]
SMALL, ORDER = 0.25, 8  # norm below which the exponential's series is summed, and its order: 1e-11 is left out


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


@dataclass(frozen=True)
class _Part:
    """One unit: what it is a function of, and where its rows and columns belong in the system."""

    component: Component
    known: list[str]
    unknown: list[str]
    directions: list[str]
    inner: list[int]  # rows of its states among those followed
    outer: list[int]  # rows of its outputs among those read
    columns: list[tuple[str, int, float]]  # per direction: kind (x, u, d, p), position, factor


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
        self._sizes = {"x": len(self.followed), "d": len(self.ports), "p": len(self.parameters)}
        self._L = _selection(sampled.wires, self._outs)
        self._S = _selection(sampled.taps, self._outs)
        self._parts = [part for c in sampled.system.components if (part := self._part(c)).unknown]

    def __call__(self, piece: Piece, rows: slice = slice(None)) -> Jacobians:
        """At the piece's samples, or at some of them. SimulationError: a unit refuses.

        u = L out, out = G_x x + G_u u + G_d d + G_p theta, thus u = (I - L G_u)^-1 L (G_x x + G_d d + G_p theta)
        """
        n, n_u, n_o = len(piece.time[rows]), len(self.sampled.wires), len(self._outs)
        sizes = {**self._sizes, "u": n_u}
        F = {kind: np.zeros((n, self._sizes["x"], size)) for kind, size in sizes.items()}
        G = {kind: np.zeros((n, n_o, size)) for kind, size in sizes.items()}
        for part in self._parts:
            J = self._jacobian(part, piece, rows)
            for j, (kind, column, factor) in enumerate(part.columns):
                F[kind][:, part.inner, column] += factor * J[:, : len(part.inner), j]
                G[kind][:, part.outer, column] += factor * J[:, len(part.inner) :, j]
        u = np.linalg.solve(np.eye(n_u) - self._L @ G["u"], np.broadcast_to(self._L, (n, n_u, n_o)))  # by outputs
        T, S = F["u"] @ u, self._S @ (np.eye(n_o) + G["u"] @ u)
        direct = np.concatenate([G["x"], G["d"], G["p"]], axis=2)
        borders = np.cumsum([self._sizes["x"], self._sizes["d"]])
        A, B, P = np.split(np.concatenate([F["x"], F["d"], F["p"]], axis=2) + T @ direct, borders, axis=2)
        C, D, R = np.split(S @ direct, borders, axis=2)
        return Jacobians(A, B, C, D, P, R, T, S)

    def tangent(self, piece: Piece) -> Tangent:
        """From sample to sample: over a step the Jacobians are the means of those at its ends, which takes a contact
        that closes between them as closed for half of the step."""
        J = self(piece)
        h = float(piece.time[-1] - piece.time[0]) / (len(piece.time) - 1)
        A, B, P, T = ((M[1:] + M[:-1]) / 2 for M in (J.A, J.B, J.P, J.T))
        Phi, Hold = self.step(A, h)
        return Tangent(A, Phi, Hold @ B, Hold @ P, J.C, J.D, J.R, Hold, T, J.S)

    def step(self, A: Array, h: float) -> tuple[Array, Array]:
        """Phi and Hold of steps of length h with Jacobians A: (n, states, states)."""
        scale = self.sampled.nominal[self.followed]
        Phi, Hold = exponential(A * scale / scale[:, None], h)
        return Phi * scale[:, None] / scale, Hold * scale[:, None] / scale

    def added(
        self, parameter: str, values: Mapping[str, Value], time: Array, x: Array, piece: Piece
    ) -> tuple[Array, Array]:
        """What a unit of one parameter adds to the derivatives of the followed states and to the outputs of units, with
        other `component.variable` values beside: (n, states) and (n, outputs).

        At any times within the piece, time: (n,), with all states x: (n, states); signals are linear between samples.
        """
        name, variable = parameter.split(".", 1)
        part = next(p for p in self._parts if p.component.name == name)
        states = {s.variable: j for j, s in enumerate(self.sampled.states) if s.component == name}
        wires = {c.sink: c for c in (*self.sampled.wires, *self.sampled.driven) if c.sink_component == name}
        columns = [
            x[:, states[v]] if v in states else np.interp(time, piece.time, self.sampled.value_of(piece, wires[v]))
            for v in part.known
        ]
        points = np.column_stack(columns) if columns else np.zeros((len(time), 0))
        own = {**self.sampled.values_of(name, float(time[0])), **{n.split(".", 1)[1]: v for n, v in values.items()}}
        function = UnitFunction(self.sampled.simulation.instances[name], own, part.known, part.unknown)
        J = function.jacobian(time, points, [variable])[:, :, 0]
        inner, outer = np.zeros((len(time), len(self.followed))), np.zeros((len(time), len(self._outs)))
        inner[:, part.inner], outer[:, part.outer] = J[:, : len(part.inner)], J[:, len(part.inner) :]
        return inner, outer

    def _jacobian(self, part: _Part, piece: Piece, rows: slice) -> Array:
        """Of one unit: (n, unknown, directions), with the values that hold at each time."""
        sampled, name = self.sampled, part.component.name
        time = piece.time[rows]
        states = {s.variable: j for j, s in enumerate(sampled.states) if s.component == name}
        wires = {c.sink: c for c in (*sampled.wires, *sampled.driven) if c.sink_component == name}
        columns = [piece.x[:, states[v]] if v in states else sampled.value_of(piece, wires[v]) for v in part.known]
        points = np.column_stack(columns)[rows] if columns else np.zeros((len(time), 0))
        J = np.empty((len(time), len(part.unknown), len(part.directions)))
        borders = np.searchsorted(time, [-np.inf, *sorted(sampled.onsets.values()), np.inf])
        for begin, end in pairwise(borders):
            if begin == end:
                continue
            values = sampled.values_of(name, float(time[begin]))
            function = UnitFunction(sampled.simulation.instances[name], values, part.known, part.unknown)
            J[begin:end] = function.jacobian(time[begin:end], points[begin:end], part.directions)
        return J

    def _part(self, component: Component) -> _Part:
        sampled, name = self.sampled, component.name
        own = [s for s in sampled.states if s.component == name]
        followed = [(k, sampled.states[j]) for k, j in enumerate(self.followed) if sampled.states[j].component == name]
        sources = [v for c, v in sampled.sources if c == name]
        wired = [(j, c) for j, c in enumerate(sampled.wires) if c.sink_component == name]
        entering = [c for c in sampled.driven if c.sink_component == name]
        mine = [(j, p.split(".", 1)[1]) for j, p in enumerate(self.parameters) if p.startswith(f"{name}.")]
        columns = [(s.variable, ("x", k, 1.0)) for k, s in followed]
        columns += [(c.sink, ("u", j, 1.0)) for j, c in wired]
        columns += [(c.sink, ("d", self.ports.index(c.source), c.factor)) for c in entering if c.source in self.ports]
        columns += [(p, ("p", j, 1.0)) for j, p in mine]
        return _Part(
            component,
            [s.variable for s in own] + [c.sink for _, c in wired] + [c.sink for c in entering],
            [s.derivative for _, s in followed] + sources,
            [variable for variable, _ in columns],
            [k for k, _ in followed],
            [self._outs[name, v] for v in sources],
            [place for _, place in columns],
        )


def _selection(wires: Sequence[Connection], outs: dict[tuple[str, str], int]) -> Array:
    """(wires, outputs): what a wire carries of which output"""
    M = np.zeros((len(wires), len(outs)))
    for j, c in enumerate(wires):
        M[j, outs[str(c.source_component), c.source]] = c.factor
    return M


def exponential(A: Array, h: float) -> tuple[Array, Array]:
    """e^(A h), and its integral from 0 to h; A: (n, m, m), scaled so that its entries are of one size.

    Scaling and squaring (Moler and Van Loan 2003, SIAM Review 45(1), method 3), of both: with z = A h/2^s,
    e^z = I + z p(z), p(2z) = p(z) (I + e^z)/2.
    """
    n, m = A.shape[:2]
    eye = np.eye(m)
    largest = h * float(np.max(np.sum(np.abs(A), axis=2), initial=0.0))
    halvings = max(0, int(np.ceil(np.log2(max(largest, 1e-300) / SMALL))))
    z = A * (h / 2**halvings)
    p = np.broadcast_to(eye, (n, m, m))
    for k in range(ORDER, 1, -1):  # p = I + z/2 (I + z/3 (I + ...))
        p = eye + z @ p / k
    e = eye + z @ p
    for _ in range(halvings):
        p = (p + p @ e) / 2
        e = e @ e
    return e, h * p
