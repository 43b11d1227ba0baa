"""Baseline: sparse regression on the joint's equations of motion (pysindy), from smoothed, differentiated signals."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.findings import Diagnosis, Estimate, Finding
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.errors import UserError
from cobot_joint.system.model import System

WINDOW = 51  # samples of the smoothing differentiator: noise in dw/dt against transients
THRESHOLD = 0.2  # of a standardised coefficient, below which a term is dropped
RIDGE = 0.05  # per sample and standardised coefficient: friction terms are nearly alike
Row = NDArray[np.float64]


@dataclass(frozen=True)
class Signals:
    """Smoothed signals of one run, (n,) each; 0 where a set-up has no such channel."""

    t: Row
    v: Row
    i: Row
    di: Row
    w: Row
    dw: Row
    tau: Row  # the torque sensor's
    i_b: Row
    phi: Row  # rotor angle, the integral of w


@dataclass(frozen=True)
class Equation:
    """An equation of motion: what its known terms leave over, what a re-fit may absorb, and candidates by name."""

    name: str
    needs: frozenset[str]  # inputs without which a run does not have it
    left_over: Callable[[Signals, Mapping[str, float]], Row]
    refitted: Callable[[Signals, Mapping[str, float]], list[Row]]
    candidates: Mapping[str, Callable[[Signals, Mapping[str, float]], list[Row]]]


def sparse_regression(campaign: Campaign, calibrated: Mapping[str, Estimate]) -> Diagnosis:
    """Claims the terms that sequentially thresholded least squares keeps (Brunton, Proctor and Kutz 2016, PNAS
    113(15)).

    UserError: another system than the joint, whose equations are not written here.
    """
    from pysindy.optimizers import STLSQ

    if campaign.system != "joint":
        raise UserError(f"--baseline sparse knows the equations of the joint, system {campaign.system!r} is given")
    systems = campaign.systems()
    p = _values(systems, calibrated)
    with Simulator(systems, {name: estimate.value for name, estimate in calibrated.items()}) as simulate:
        pairs = [(signals_of(r), signals_of(replace(r, outputs=dict(simulate(r))))) for r in campaign.train]
    findings = []
    for equation in EQUATIONS:
        used = [pair for pair, r in zip(pairs, campaign.train, strict=True) if r.inputs.keys() >= equation.needs]
        if not used:
            continue
        runs = [measured for measured, _ in used]
        # the simulation leaves over what smoothing and differentiating do to a healthy bench
        y = np.concatenate([equation.left_over(s, p) - equation.left_over(healthy, p) for s, healthy in used])
        base = np.column_stack([np.concatenate(c) for c in zip(*(equation.refitted(s, p) for s in runs), strict=True)])
        names, columns = [], []
        for name, candidate in equation.candidates.items():
            for column in zip(*(candidate(s, p) for s in runs), strict=True):
                names.append(name)
                columns.append(np.concatenate(column))
        base = base[:, np.any(base != 0, axis=0)]  # without load there is none to weigh
        q, _ = np.linalg.qr(base / np.linalg.norm(base, axis=0))
        rest, theta = y - q @ (q.T @ y), np.column_stack(columns)
        theta = theta - q @ (q.T @ theta)
        scale = np.maximum(np.std(theta, axis=0), 1e-12)
        with warnings.catch_warnings():  # pysindy warns where nothing is kept, which is an answer here
            warnings.simplefilter("ignore", UserWarning)
            least = max(THRESHOLD, 4 / np.sqrt(len(rest) / WINDOW))  # four standard errors: smoothed samples are fewer
            optimizer = STLSQ(threshold=least, alpha=RIDGE * len(rest))
            regression = optimizer.fit(theta / scale, (rest / np.std(rest))[:, None])
        kept = regression.coef_[0]
        for name in dict.fromkeys(n for n, c in zip(names, kept, strict=True) if c != 0):
            size = float(np.hypot.reduce([c for n, c in zip(names, kept, strict=True) if n == name]))
            where = {"recording": None, "regime": equation.name}
            findings.append(Finding(name, (), float(min(0.99, 0.5 + size / 2)), None, {}, where, size))
    findings = list({f.term: f for f in sorted(findings, key=lambda f: f.gain)}.values())[::-1]  # of two equations once
    verdict = "explained" if findings else "nothing_missing"
    return Diagnosis(verdict, findings, dict(calibrated), dict(calibrated))  # type: ignore[arg-type]


def signals_of(r: Recording) -> Signals:
    """Smoothed and differentiated by one filter, so that nothing is shifted against the rest."""
    n, none = len(r.time), np.zeros(len(r.time))

    def smooth(x: Row | None, order: int = 0) -> Row:
        if x is None:
            return none
        whole = np.interp(np.arange(n), np.flatnonzero(np.isfinite(x)), x[np.isfinite(x)])
        return np.asarray(savgol_filter(whole, WINDOW, 3, deriv=order, delta=r.step))

    i, w = r.outputs.get("i_motor"), r.outputs.get("w_motor")
    phi = np.cumsum(np.nan_to_num(w if w is not None else none)) * r.step
    return Signals(
        t=r.time - r.time[0],
        v=smooth(r.inputs.get("v_command")),
        i=smooth(i),
        di=smooth(i, 1),
        w=smooth(w),
        dw=smooth(w, 1),
        tau=smooth(r.outputs.get("tau_sensor")),
        i_b=smooth(r.inputs.get("i_brake")),
        phi=phi,
    )


def _sgn(x: Row, e: float) -> Row:
    return np.tanh(x / e)


def _voltage(s: Signals, p: Mapping[str, float]) -> Row:
    """v - R i - L di/dt - k w"""
    return s.v - p["winding.R"] * s.i - p["winding.L"] * s.di - p["winding.k"] * s.w


def _rotor(s: Signals, p: Mapping[str, float]) -> Row:
    """k i - J dw/dt - friction - load, at the rotor"""
    m, eta = _driving(s), p["mesh.eta"]
    load = s.tau / p["ratio.N"] * (m / eta + (1 - m) * eta)
    friction = p["tau_C"] * _sgn(s.w, 1.0) + p["d"] * s.w
    return p["winding.k"] * s.i - p["J"] * s.dw - friction - load


def _driving(s: Signals) -> Row:
    """1 where the motor drives, 0 where the load does"""
    return (1 + np.tanh(s.tau * s.w)) / 2


def _efficiency(s: Signals, p: Mapping[str, float]) -> Row:
    """d(load)/d(eta)"""
    m, eta = _driving(s), p["mesh.eta"]
    return s.tau / p["ratio.N"] * (-m / eta**2 + (1 - m))


def _output(s: Signals, p: Mapping[str, float]) -> Row:
    """sensor torque - brake, belt and pulley, at the pulley"""
    w_p, dw_p, r = s.w / p["ratio.N"], s.dw / p["ratio.N"], p["belt.r"]
    brake = p["brake.k_b"] * np.abs(_lag(s.i_b, p["brake.omega_m"], s.t)) + p["brake.tau_off"]
    torque = r * (brake * _sgn(r * w_p, 0.5) + p["brake.d_off"] * r * w_p)
    return s.tau - torque - (p["pulley.J_p"] + r**2 * p["brake.J_b"]) * dw_p


def _lag(x: Row, omega: float, t: Row) -> Row:
    y, a = np.empty_like(x), np.exp(-omega * (t[1] - t[0]))
    y[0] = 0.0
    for k in range(1, len(x)):
        y[k] = a * y[k - 1] + (1 - a) * x[k]
    return y


def _turn(angle: Row, n: float) -> list[Row]:
    return [np.sin(n * angle), np.cos(n * angle)]


EQUATIONS = (
    Equation(
        "voltage",
        frozenset(),
        _voltage,
        lambda s, p: [s.i, s.w],
        {
            "motor_bldc.dead_time": lambda s, p: [_sgn(s.i, 0.05)],
            "motor_bldc.supply_sag": lambda s, p: [np.abs(s.v) * s.i],
            "motor_bldc.winding_heating": lambda s, p: [s.i * np.cumsum(s.i**2)],
            "acquisition.current_offset": lambda s, p: [np.ones_like(s.i)],
            "acquisition.speed_delay": lambda s, p: [s.dw],
        },
    ),
    Equation(
        "rotor",
        frozenset(),
        _rotor,
        lambda s, p: [_sgn(s.w, 1.0), s.w, s.dw, s.i, _efficiency(s, p)],
        {
            "motor_bldc.stribeck": lambda s, p: [_sgn(s.w, 1.0) * np.exp(-np.abs(s.w) / 10)],
            "motor_bldc.windage": lambda s, p: [s.w * np.abs(s.w)],
            "motor_bldc.sublinear_viscous": lambda s, p: [_sgn(s.w, 1.0) * np.sqrt(np.abs(s.w))],
            "motor_bldc.friction_asymmetry": lambda s, p: [_sgn(s.w, 1.0) ** 2],
            "motor_bldc.viscous_warmup": lambda s, p: [s.w * np.exp(-s.t / 5)],
            "motor_bldc.torque_saturation": lambda s, p: [s.i**3],
            "motor_bldc.cogging": lambda s, p: [c for n in (4, 6, 12, 14) for c in _turn(s.phi, n)],
            "motor_bldc.torque_ripple": lambda s, p: [s.i * c for c in _turn(s.phi, 6)],
            "planetary_gear.load_friction": lambda s, p: [np.abs(s.tau) * _sgn(s.w, 1.0)],
            "torque_sensor.offset": lambda s, p: [(s.tau != 0).astype(float)],
        },
    ),
    Equation(
        "output",
        frozenset({"i_brake"}),
        _output,
        lambda s, p: [_sgn(s.w, 56.0), s.w, s.dw, np.abs(s.i_b) * _sgn(s.w, 56.0)],
        {
            "torque_sensor.offset": lambda s, p: [np.ones_like(s.w)],
            "torque_sensor.low_pass": lambda s, p: [np.gradient(s.tau, s.t)],
            "mr_brake_belt.imbalance": lambda s, p: _turn(s.phi / p["ratio.N"], 1),
            "mr_brake_belt.position_friction": lambda s, p: [
                _sgn(s.w, 56.0) * c for c in _turn(s.phi / p["ratio.N"], 1)
            ],
            "mr_brake_belt.pulley_eccentricity": lambda s, p: [s.tau * c for c in _turn(s.phi / p["ratio.N"], 1)],
            "mr_brake_belt.brake_fade": lambda s, p: [s.tau * np.cumsum(np.abs(s.tau * s.w))],
            "mr_brake_belt.brake_release_lag": lambda s, p: [np.minimum(np.gradient(np.abs(s.i_b), s.t), 0)],
        },
    ),
)


def _values(systems: Mapping[str, System], calibrated: Mapping[str, Estimate]) -> dict[str, float]:
    """Calibrated where fitted, nominal elsewhere; friction and inertia of motor and gearhead at the rotor together."""
    found: dict[str, float] = {}
    both: dict[str, list[float]] = {"tau_C": [], "d": []}
    for component in {c.name: c for system in systems.values() for c in system.components}.values():
        for name, variable in component.unit.variables.items():
            if variable.causality == "parameter" and variable.type == "Real" and variable.start is not None:
                estimate = calibrated.get(f"{component.name}.{name}")
                value = estimate.value if estimate else float(component.parameters.get(name, variable.start))
                found.setdefault(name, value)
                if name in ("friction.tau_C", "friction.d") and component.name in ("motor_bldc", "planetary_gear"):
                    both[name.split(".")[1]].append(value)
    J_o = found["output.J_o"] / found["ratio.N"] ** 2
    J = found["rotor.J"] + found["housing.J_coupled"] + J_o / found["mesh.eta"]
    return found | {"tau_C": sum(both["tau_C"]), "d": sum(both["d"]), "J": J}
