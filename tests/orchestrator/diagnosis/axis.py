"""A rotating axis small enough to diagnose in seconds: inertia, friction, and terms that can be switched on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import sin, tanh
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.campaign_file import Tolerance
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.plant import (
    Courses,
    Parameter,
    Port,
    ScannedShape,
    Signals,
    SimulationError,
    TermCandidate,
)

STEP, SAMPLES = 2e-3, 3000
NOISE = 0.05  # rad/s
FASTEST = 1e6  # rad/s
OFF = {"axis.J": 1.04e-3, "axis.d": 1.9e-3, "axis.tau_C": 0.0206}  # inside the tolerances
NOMINAL = {"axis.J": 1e-3, "axis.k": 0.1, "axis.d": 2e-3, "axis.tau_C": 0.02}


def term(
    name: str, amplitude: str, most: float, shapes: tuple[ScannedShape, ...] = (), phase: str | None = None
) -> TermCandidate:
    """A candidate of the axis, neutral at 0."""
    angle = "axis.phi" if phase else None
    return TermCandidate(f"axis.{name}", f"axis.{name}.{amplitude}", 0.0, -most, most, "N.m", shapes, phase, angle)


ORDERS = ScannedShape("axis.cogging.n", tuple(float(n) for n in range(1, 9)), 1, 8, whole=True)
TERMS = (
    term("windage", "c", 1e-3),
    term("asymmetry", "tau_A", 0.05),
    term("cogging", "A", 0.05, (ORDERS,), "axis.cogging.phi_0"),
    term("stribeck", "tau_S", 0.05, (ScannedShape("axis.stribeck.w_S", (1.0, 4.0), 0.1, 50.0, logarithmic=True),)),
)
PUSH = term(
    "push",
    "T",
    0.5,
    (
        ScannedShape("axis.push.t_0", (0.0,), -1e9, 1e9, "s"),
        ScannedShape("axis.push.T_d", (1e6,), 1e-6, 1e9, "s", logarithmic=True),
    ),
)
OFFSET = TermCandidate("sensor.offset", "sensor.offset.y_0", 0.0, -5.0, 5.0, "rad/s")


class Axis:
    """J dw/dt = k u - tau_C tanh(w/0.5) - d w - terms + tau_add, dphi/dt = w; Euler at the recording's step."""

    inputs = ()
    ports = (Port("axis.tau_add", "N.m", ("axis.phi", "axis.w"), ("axis.phi",)),)

    def __init__(self, terms: Sequence[TermCandidate] = TERMS) -> None:
        self.terms = terms
        self.parameters = {name: Parameter(name, value, "1", 0.0, np.inf) for name, value in NOMINAL.items()}
        self.runs = 0

    def has(self, name: str, recording: Recording) -> bool:
        """The axis and the sensor of its speed, in every set-up."""
        return name.split(".")[0] in ("axis", "sensor")

    def simulate(
        self,
        values: Mapping[str, float],
        recording: Recording,
        *,
        onsets: Mapping[str, float] | None = None,
        added: Mapping[str, NDArray[np.float64]] | None = None,
        signals: Sequence[str] = (),
        courses: Courses | None = None,
    ) -> Signals:
        """See Plant.simulate."""
        self.runs += 1
        v = {**NOMINAL, **values}
        u = recording.inputs["u"]
        tau_add = (added or {}).get("axis.tau_add", np.zeros(len(u)))
        c, tau_A, A = (v.get(f"axis.{n}", 0.0) for n in ("windage.c", "asymmetry.tau_A", "cogging.A"))
        n, phi_0 = v.get("axis.cogging.n", 1.0), v.get("axis.cogging.phi_0", 0.0)
        tau_S, w_S = v.get("axis.stribeck.tau_S", 0.0), v.get("axis.stribeck.w_S", 1.0)
        t_0, T_d = v.get("axis.push.t_0", 0.0), v.get("axis.push.T_d", 0.0)
        covered = np.clip(t_0 + T_d - recording.time, 0, STEP) - np.clip(t_0 - recording.time, 0, STEP)
        push = v.get("axis.push.T", 0.0) * covered / STEP  # of each step, the part that it acts in
        late = {name: round(t / STEP) for name, t in (onsets or {}).items()}
        from_A, from_c = (late.get(f"axis.{n}", 0) for n in ("cogging.A", "windage.c"))
        phases = {round(t / STEP): fed_back for t, fed_back in (courses or {}).get("axis.cogging.phi_0", ())}
        phi = w = 0.0
        out = np.empty((len(u), 2))
        for j in range(len(u)):
            out[j] = phi, w
            phi_0 = phases[j].of(phi) if j in phases else phi_0
            s = tanh(w / 0.5)
            tau = v["axis.tau_C"] * s + v["axis.d"] * w + tau_A * s * s
            tau += c * w * abs(w) if j >= from_c else 0.0
            tau += tau_S * np.exp(-((w / w_S) ** 2)) * s
            tau += A * sin(n * phi + phi_0) if j >= from_A else 0.0
            w += STEP * (v["axis.k"] * u[j] - tau + tau_add[j] + push[j]) / v["axis.J"]
            phi += STEP * out[j, 1]
            if abs(w) > FASTEST:
                raise SimulationError("the axis runs away")
        return {"w": out[:, 1] + v.get("sensor.offset.y_0", 0.0), "axis.phi": out[:, 0], "axis.w": out[:, 1]}


def campaign(
    truth: Mapping[str, float],
    colour: float = 0.0,
    onsets: Mapping[str, float] | None = None,
    extra: str = "",
    seed: int = 1,
) -> Campaign:
    """Two runs of an axis with these parameters, recorded with noise. extra: "cube" adds an effect that no term has."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(SAMPLES)
    inputs = (2.0 * np.sin(2 * np.pi * time / 3), 1.2 + np.where(time > 3, 0.8, 0.0) - np.where(time > 4.5, 1.6, 0.0))
    recordings = []
    for number, u in enumerate(inputs):
        recording = Recording(
            f"run{number}", "train", "default", time, {"u": u}, {"w": np.zeros(SAMPLES)}, {"w": "rad/s"}
        )
        clean = Axis().simulate(truth, recording, onsets=onsets)
        for _ in range(6 if extra else 0):  # the missing torque follows the motion that it changes
            tau = -6e-3 * np.sin(3 * clean["axis.phi"]) * np.tanh(clean["axis.w"] / 1e-3)
            clean = Axis().simulate(truth, recording, onsets=onsets, added={"axis.tau_add": tau})
        noise = lfilter([np.sqrt(1 - colour**2)], [1, -colour], rng.normal(0, NOISE, SAMPLES))
        recording.outputs["w"] = clean["w"] + noise
        recordings.append(recording)
    tolerances = {name: Tolerance(relative=0.1) for name in NOMINAL if name != "axis.k"}
    return Campaign("axis", Path("campaign.toml"), "axis", {}, {}, tolerances, {}, recordings)


class Driven(Axis):
    """The axis, its torque constant that of a drive."""

    def __init__(self) -> None:
        super().__init__()
        self.parameters["drive.k"] = replace(self.parameters.pop("axis.k"), name="drive.k")

    def has(self, name: str, recording: Recording) -> bool:
        """See Plant.has."""
        return super().has(name, recording) or name.split(".")[0] == "drive"

    def simulate(self, values: Mapping[str, float], recording: Recording, **others: Any) -> Signals:
        """See Plant.simulate."""
        own = dict(values)
        return super().simulate({**own, "axis.k": own.pop("drive.k", NOMINAL["axis.k"])}, recording, **others)


def weak_drive(windage: float = 0.0, eddy_currents: float = 0.0, k: float = 0.7) -> Campaign:
    """The torque constant is 0.7 of nominal, or k. eddy_currents: twice the torque at 15 rad/s, N.m;
    no term has them."""
    truth, rng = OFF | {"drive.k": k * NOMINAL["axis.k"], "axis.windage.c": windage}, np.random.default_rng(1)
    case, plant = campaign(OFF), Driven()
    for recording in case.recordings:
        clean = plant.simulate(truth, recording)
        for _ in range(20):  # the drag follows the motion that it changes
            w = clean["axis.w"] / 15
            clean = plant.simulate(truth, recording, added={"axis.tau_add": -eddy_currents * w / (1 + w**2)})
        recording.outputs["w"] = clean["w"] + rng.normal(0, NOISE, SAMPLES)
    return replace(case, tolerances={**case.tolerances, "drive.k": Tolerance(relative=0.1)})
