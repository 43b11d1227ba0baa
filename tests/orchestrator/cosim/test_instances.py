"""Units in memory."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from cobot_joint.cosim import Simulation
from cobot_joint.system.read import load_system


def test_systems_loaded_in_several_threads_leave_the_working_directory_alone() -> None:
    system, here = load_system("joint_no_load"), Path.cwd()

    def load(_: int) -> None:
        Simulation(system).close()

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(load, range(64)))
    there = Path.cwd()
    os.chdir(here)
    assert there == here
