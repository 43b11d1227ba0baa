"""A formula as the unit that would repair the system, going by the motion that it leads to, not by the recorded one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.repair.export import with_correction
from cobot_joint.diagnosis.repair.repair import correction
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled
from cobot_joint.system.model import System


def chi2_in_closed_loop(problem: Problem, systems: Mapping[str, System], found: Unmodelled) -> float | None:
    """Chi-square that free runs of the repaired system leave; None: it cannot be simulated.

    The fit of a formula goes by the recorded motion: it knows when the machine stuck, and a simulated one may not.
    """
    shape = found.finding.shape
    assert shape is not None
    unit, run = correction(1, found.finding.to_json()), found.fit.run
    there = [setup for setup, s in systems.items() if any(c.name == found.finding.component for c in s.components)]
    with TemporaryDirectory() as folder:
        with_it = {s: with_correction(systems[s], unit, _made(Path(folder) / str(k))) for k, s in enumerate(there)}
        with FmuPlant({**systems, **with_it}) as plant:
            others = {r: {p: x for p, x in ports.items() if p != shape.port} for r, ports in run.added.items()}
            repaired = Problem(plant, problem.recordings, problem.noise, problem.jobs)
            repaired.budget = problem.budget
            (simulated,) = repaired.simulate([replace(run, added=others)])
    return float(np.sum((problem.recorded - simulated.white) ** 2)) if simulated else None


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder
