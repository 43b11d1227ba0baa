"""Short runs of the joint's bench with what is concealed in them, as a problem with its calibrated fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import fit
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.system.read import load_system

NOISE = {"i_motor": 4e-3, "w_motor": 0.3, "tau_sensor": 5e-3}
UNITS = {"i_motor": "A", "w_motor": "rad/s", "tau_sensor": "N.m"}
SETUPS = {"loaded": "joint_logged", "no_load": "joint_no_load_logged"}
FREE = {"motor_bldc.friction.tau_C": 0.2, "motor_bldc.friction.d": 0.2, "mr_brake_belt.brake.tau_off": 0.25}
SECONDS = 4.0
TIME = np.arange(0, SECONDS + 5e-4, 1e-3)


def recordings(
    plant: FmuPlant,
    concealed: Mapping[str, float],
    onsets: Mapping[str, float] | None = None,
    seed: int = 1,
    added: Mapping[str, Vector] | None = None,
) -> list[Recording]:
    """One loaded and one run without load, both forwards and back. added: port -> signal over `TIME` in the former."""
    rng = np.random.default_rng(seed)
    time, found = TIME, []
    for setup in SETUPS:
        inputs = {"v_command": np.interp(time, [0.2, 0.8, 2.0, 2.6, 3.6], [0, 9, 9, -5, -2])}
        if setup == "loaded":
            inputs["i_brake"] = np.interp(time, [1.0, 1.1, 3.0, 3.1], [0.1, 0.4, 0.4, 0.1])
        names = [n for n in NOISE if setup == "loaded" or n != "tau_sensor"]
        run = Recording(setup, "train", setup, time, inputs, {n: np.zeros(len(time)) for n in names}, UNITS)
        values = {name: value for name, value in concealed.items() if plant.has(name, run)}
        there = {name: t for name, t in (onsets or {}).items() if name in values}
        acting = {port: x for port, x in (added or {}).items() if plant.has(port, run)}
        clean = plant.simulate(values, run, onsets=there, added=acting)
        noisy = {n: clean[n] + NOISE[n] * rng.standard_normal(len(time)) for n in names}
        found.append(replace(run, outputs=noisy))
    return found


def logged(run: Recording, log: Mapping[str, tuple[float, float]]) -> Recording:
    """The run with some channels recorded as gain*there + offset."""

    def read(series: Mapping[str, Vector]) -> dict[str, Vector]:
        return {name: log[name][0] * x + log[name][1] if name in log else x for name, x in series.items()}

    return replace(run, inputs=read(run.inputs), outputs=read(run.outputs))


@contextmanager
def calibrated(
    concealed: Mapping[str, float],
    onsets: Mapping[str, float] | None = None,
    added: Mapping[str, Vector] | None = None,
    log: Mapping[str, tuple[float, float]] | None = None,
) -> Iterator[tuple[Problem, Fit]]:
    """The problem of finding what is concealed, and the base model re-fitted inside (some of) its tolerances.

    log: channels that are recorded as gain*there + offset.
    """
    with FmuPlant({setup: load_system(name) for setup, name in SETUPS.items()}) as plant:
        log = log or {}
        noise = {n: Noise(s * log.get(n, (1.0, 0.0))[0]) for n, s in NOISE.items()}
        recorded = [logged(r, log) for r in recordings(plant, concealed, onsets, added=added)]
        problem = Problem(plant, recorded, noise, jobs=1)
        nominal = {name: plant.parameters[name].nominal for name in FREE}
        bounds = {name: (nominal[name] * (1 - share), nominal[name] * (1 + share)) for name, share in FREE.items()}
        found = fit(problem, Hypothesis(tolerances(problem, bounds)))
        assert found is not None
        yield problem, found
