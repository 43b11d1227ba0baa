"""Frequency responses under diagnosis: what is read, what is simulated, and what was found in Table C.1."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from orchestrator.diagnosis.campaign import FrequencyExperiment
from orchestrator.diagnosis.frequency import CHANNEL, FrequencyPlant, load_response, read_amplitudes, scatter
from orchestrator.diagnosis.recording import Recording
from orchestrator.errors import UserError
from orchestrator.system import load_system
from orchestrator.system.parameters import with_parameters

CURRENT = {"motor_bldc.drive.mode": "current", "motor_bldc.drive.k_i": 1.0, "motor_bldc.drive.decoupling": 1.0}
NO_COULOMB = {"motor_bldc.friction.tau_C": 0.0, "planetary_gear.friction.tau_C": 0.0}


def recording(omega: np.ndarray) -> Recording:
    """Frequencies without amplitudes."""
    return Recording("table", "train", "default", omega, {}, {CHANNEL: np.full(len(omega), np.nan)}, {})


def test_amplitudes_of_the_units_are_those_of_the_closed_form() -> None:
    """k A/sqrt((J omega)^2 + B^2) without Coulomb friction; the swing is inside the gap, the output shaft at rest"""
    omega = np.array([100.0, 200.0])
    system = with_parameters(load_system("joint_no_load"), {**CURRENT, **NO_COULOMB})
    experiment = FrequencyExperiment(input="v_command", amplitude=0.3, output="w_motor", settle=3.0)
    with FrequencyPlant(system, experiment, omega) as plant:
        found = np.exp(plant.simulate({}, recording(omega))[CHANNEL])
    J, B, k = 5.38e-6 + 9.3e-7, 1.8e-5, 0.0232
    np.testing.assert_allclose(found, 0.3 * k / np.hypot(J * omega, B), rtol=0.01)


def test_scatter_is_the_noise_about_a_smooth_curve() -> None:
    omega = np.geomspace(0.1, 100, 200)
    noise = np.random.default_rng(1).normal(0, 0.02, 200)
    assert scatter(omega, np.exp(noise) / np.hypot(1, omega / 5)) == pytest.approx(0.02, rel=0.2)


@pytest.mark.parametrize(
    ("text", "message"),
    [("a,b\n1,x\n", "could not convert"), ("a,b\n1,2,3\n", "needed"), ("a,b\n1,-2\n", "have to be positive")],
)
def test_a_table_that_is_none_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(UserError, match=message):
        read_amplitudes(tmp_path / "table.csv")


def test_the_committed_answer_brings_table_c1_below_2_percent(root: Path) -> None:
    folder = root / "proof" / "real" / "thesis_table_c1"
    response = load_response(folder)
    answer = json.loads((folder / "diagnosis.json").read_text())
    best = min(answer["readings"], key=lambda r: r["repaired"])
    alternative = next(a for a in response.given.alternative if a.name == best["name"])
    system = with_parameters(response.system, alternative.parameters)
    with FrequencyPlant(system, response.experiment, response.recording.time) as plant:
        found = plant.simulate(best["values"], response.recording)[CHANNEL]
    misfit = np.sqrt(np.mean((found - response.recording.outputs[CHANNEL]) ** 2))
    assert misfit <= 0.02
    assert misfit == pytest.approx(best["repaired"], abs=5e-4)
