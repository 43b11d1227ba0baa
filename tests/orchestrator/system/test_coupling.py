"""How a system's units want to be coupled travels with the system."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.cosim import DEFAULT, Experiment, Simulation
from cobot_joint.errors import UserError
from cobot_joint.system import DefaultExperiment, Inputs, System, load_system
from cobot_joint.system.write import write_ssd

INPUTS = Inputs(np.array([0.0, 1.0]), {"v_command": np.array([1.0, 1.0])})


@pytest.fixture
def system() -> System:
    """Motor and gearhead, whose description asks for held inputs at 0.2 ms."""
    return replace(load_system("joint_no_load"), default_experiment=DefaultExperiment(0.0, 1.0, "gauss_seidel", 2e-4))


def test_coupling_survives_writing_and_reading(system: System, tmp_path: Path) -> None:
    written = load_system(write_ssd(system, tmp_path / "axis.ssd"))
    assert written.default_experiment == system.default_experiment


def test_run_takes_the_systems_own_scheme_and_step(system: System) -> None:
    with Simulation(system) as simulation:
        result = simulation.run(Experiment(INPUTS, 0.01))
    assert (result.scheme, result.step) == ("gauss_seidel", pytest.approx(2e-4))


def test_scheme_that_is_asked_for_wins(system: System) -> None:
    with Simulation(system) as simulation:
        assert simulation.run(Experiment(INPUTS, 0.01, scheme="iterative")).scheme == "iterative"
    with Simulation(load_system("joint_no_load")) as simulation:
        assert simulation.run(Experiment(INPUTS, 0.01)).scheme == DEFAULT


@pytest.mark.parametrize("step", ["short", "", "-1", "0", "inf", "nan", "1e9"])
def test_a_step_that_is_none_is_refused(system: System, tmp_path: Path, step: str) -> None:
    path = write_ssd(system, tmp_path / "axis.ssd")
    path.write_text(path.read_text().replace('step="0.0002"', f'step="{step}"'))
    with pytest.raises(UserError, match=f"step '{step}' is given, seconds above 0 and up to 1 are allowed"):
        load_system(path)
