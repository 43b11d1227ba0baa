"""A rotating axis small enough to diagnose in seconds: inertia, friction, and terms that can be switched on."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from ctypes import CDLL, POINTER, c_double, c_size_t
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from numpy.ctypeslib import ndpointer
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
Effect = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]  # of speed and angle
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


# what axis.c takes, in its order, and what each is where it is not given
USED = {"J": 0.0, "k": 0.0, "d": 0.0, "tau_C": 0.0, "windage.c": 0.0, "asymmetry.tau_A": 0.0} | {
    "cogging.A": 0.0, "cogging.n": 1.0, "cogging.phi_0": 0.0, "stribeck.tau_S": 0.0, "stribeck.w_S": 1.0
}  # fmt: skip


@cache
def compiled() -> Callable[..., int]:
    """The function of axis.c: diagnoses simulate the axis some hundred times. Skips where no compiler is."""
    compiler = os.environ.get("CC") or next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), None)
    if compiler is None:
        pytest.skip("no C compiler for the axis")
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        library = Path(folder) / "axis.so"
        flags = ["-std=c11", "-O2", "-shared", *([] if sys.platform == "win32" else ["-fPIC"])]
        source = Path(__file__).with_suffix(".c")
        subprocess.run([*compiler.split(), *flags, str(source), "-o", str(library), "-lm"], check=True)
        function = CDLL(str(library)).axis
    array = ndpointer(np.float64, flags="C")
    function.argtypes = [
        POINTER(c_double), c_double, c_double, POINTER(c_size_t), array, array, c_size_t, c_size_t, array, array
    ]  # fmt: skip
    return function  # type: ignore[no-any-return]


class Axis:
    """A rotating axis in a torque, with terms (see axis.c)."""

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
        if "u" in recording.held:  # stairs, as lines half a sample behind them
            u = (u + np.concatenate([u[:1], u[:-1]])) / 2
        tau = (added or {}).get("axis.tau_add", np.zeros(len(u)))
        t_0, T_d = v.get("axis.push.t_0", 0.0), v.get("axis.push.T_d", 0.0)
        covered = np.clip(t_0 + T_d - recording.time, 0, STEP) - np.clip(t_0 - recording.time, 0, STEP)
        tau = tau + v.get("axis.push.T", 0.0) * covered / STEP  # of each step, the part that it acts in
        phases = {round(t / STEP): fed_back for t, fed_back in (courses or {}).get("axis.cogging.phi_0", ())}
        x, out = np.zeros(2), np.empty((len(u), 2))
        turns = [0, *sorted(j for j in phases if 0 < j < len(u)), len(u)]
        for start, end in pairwise(turns):
            if start in phases:
                v["axis.cogging.phi_0"] = phases[start].of(x[0])
            parameters = (c_double * len(USED))(*(v.get(f"axis.{name}", none) for name, none in USED.items()))
            late = [round((onsets or {}).get(f"axis.{name}", 0.0) / STEP) for name in ("cogging.A", "windage.c")]
            if not compiled()(parameters, STEP, FASTEST, (c_size_t * 2)(*late), u * 1.0, tau, start, end, x, out):
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


def concealed(effect: Effect, background: Effect = lambda w, phi: np.zeros_like(w)) -> Campaign:
    """The axis with a torque that follows its own motion. background: another one, against it in the other run."""
    case, rng = campaign(OFF), np.random.default_rng(1)
    for sign, recording in zip((1, -1), case.recordings, strict=True):
        clean = Axis().simulate(OFF, recording)
        for _ in range(8):
            w, phi = clean["axis.w"], clean["axis.phi"]
            tau = effect(w, phi) + sign * background(w, phi)
            clean = Axis().simulate(OFF, recording, added={"axis.tau_add": tau})
        recording.outputs["w"] = clean["w"] + rng.normal(0, NOISE, SAMPLES)
    return case
