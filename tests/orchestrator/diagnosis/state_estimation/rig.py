"""Short loaded runs of the bench, with what is added to its parameters or at its ports."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.state_estimation.noise import ChannelNoise
from cobot_joint.diagnosis.state_estimation.sampled import Piece, SampledSystem
from cobot_joint.system.model import System
from cobot_joint.system.read import load_system

SIGMA = {"i_motor": 4e-3, "w_motor": 0.3, "tau_sensor": 5e-3}
NOISE = {name: ChannelNoise(sigma) for name, sigma in SIGMA.items()}
COGGING = {"motor_bldc.cogging.A": 5e-3, "motor_bldc.cogging.n": 6.0}


@cache
def bench() -> tuple[System, tuple[str, ...]]:
    """The loaded bench with its additive ports as inputs, and their names."""
    plant = FmuPlant({"loaded": load_system("joint_logged")})
    return plant.systems["loaded"], tuple(port.name for port in plant.ports)


def clock(seconds: float = 3.0) -> NDArray[np.float64]:
    """1 kHz"""
    return np.arange(round(seconds * 1000) + 1) * 1e-3


def inputs(time: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Forwards and, over three seconds, back, the brake on."""
    return {
        "v_command": np.interp(time, [0.1, 0.6, 1.5, 2.1, 2.6], [0, 8, 8, -4, -1]),
        "i_brake": np.interp(time, [0.5, 0.7, 1.8, 2.0], [0.1, 0.4, 0.4, 0.1]),
    }


def run(
    values: Mapping[str, float] | None = None,
    added: Mapping[str, NDArray[np.float64]] | None = None,
    seconds: float = 3.0,
) -> Piece:
    """Simulated from rest."""
    time = clock(seconds)
    with SampledSystem(bench()[0], list(SIGMA), values or {}) as sampled:
        return sampled.run(sampled.start({}), time, {**inputs(time), **(added or {})})


def recorded(piece: Piece, *, noisy: bool = True, seed: int = 1) -> Recording:
    """What the logger makes of a run."""
    rng = np.random.default_rng(seed)
    outputs = {
        name: piece.y[:, j] + noisy * sigma * rng.standard_normal(len(piece.time))
        for j, (name, sigma) in enumerate(SIGMA.items())
    }
    driven = {name: piece.inputs[name] for name in ("v_command", "i_brake")}
    return Recording("run", "holdout", "loaded", piece.time, driven, outputs, {})
