"""The units in other people's simulators: coupled in masters that hold inputs, and the exported system as it is.

The peers are those of benchmarks/requirements.txt; COBOT_JOINT_PEERS names the interpreter of the environment that has
them, COBOT_JOINT_MAESTRO Maestro's jar. Those that are missing are skipped.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks import bench
from benchmarks.peers import JACOBI, PEERS, Absent
from benchmarks.peers.client import Peer
from cobot_joint.system import load_system, with_parameters, without_own_wires, write_fmus, write_ssp
from cobot_joint.system.osp import write_osp

PYTHON = os.environ.get("COBOT_JOINT_PEERS", sys.executable)
DURATION = 8.0  # s; the load comes on
LIMITS = {2e-4: (1e-3, 0.05), 1e-3: (5e-2, 5.0)}  # step, s: rms of the motor's current, A, and speed, rad/s
ABSENT = 77


@pytest.mark.parametrize("step", LIMITS)
@pytest.mark.parametrize("name", PEERS)
def test_the_joint_couples_in_a_master_that_holds_inputs(name: str, step: float, tmp_path: Path) -> None:
    try:
        peer = Peer(name, PYTHON)
    except Absent as why:
        pytest.skip(f"{name} is not here: {why}")
    try:
        table = bench.table_of(bench.inputs(), DURATION)
        run = peer.run(bench.wiring(bench.joint(), tmp_path, step, table, JACOBI))
    finally:
        peer.close()
    found = bench.errors(run.columns, step, table)
    current, speed = LIMITS[step]
    assert found["i_motor"] <= current
    assert found["w_motor"] <= speed


# peer -> what it is imported by, what opens the file `path` with it
FMPY = (
    "from fmpy.ssp.simulation import simulate_ssp",
    """
result = simulate_ssp(path, stop_time=0.1, step_size=1e-3)
assert len(result) >= 100
""",
)
FMUCONTAINER = (
    "from fmu_manipulation_toolbox.assembly import Assembly",
    """
import os
os.chdir(os.path.dirname(path))
Assembly(path).make_fmu()
assert os.path.getsize('joint.fmu') > 0
""",
)
ECOS = (
    """
import contextlib, ctypes, pathlib
with contextlib.suppress(OSError):  # the wheel `tbb` puts its library where no loader looks
    ctypes.CDLL(str(pathlib.Path(sys.prefix, 'lib', 'libtbb.so.12')), mode=ctypes.RTLD_GLOBAL)
from ecospy import EcosSimulation
""",
    """
with EcosSimulation(ssp_path=path, step_size=1e-3) as simulation:
    assert simulation.init()
    simulation.step(100)
""",
)
LIBCOSIM = (
    "from libcosimpy.CosimExecution import CosimExecution",
    """
create = CosimExecution.from_osp_config_file if path.endswith('.xml') else CosimExecution.from_ssp_file
execution = create(path)
units = {b'motor_bldc', b'planetary_gear', b'torque_sensor', b'mr_brake_belt'}
assert {info.name for info in execution.slave_infos()} == units
assert execution.step(100)
""",
)


def opens(peer: tuple[str, str], path: Path) -> None:
    """Runs the peer on the file in the peers' environment. Skips where it cannot be imported."""
    imports, body = peer
    guarded = "\n".join(f"    {line}" for line in imports.strip().splitlines())
    text = f"import sys\npath = sys.argv[1]\ntry:\n{guarded}\nexcept (ImportError, OSError) as why:\n"
    text += f"    print(why)\n    sys.exit({ABSENT})\n{body}"
    done = subprocess.run([PYTHON, "-c", text, str(path)], capture_output=True, text=True, timeout=300, check=False)
    if done.returncode == ABSENT:
        pytest.skip(f"the peer is not here: {done.stdout.strip()}")
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.fixture
def exported(tmp_path: Path) -> Callable[[bool], Path]:
    """exported(closed): the joint with a parameter set, its wires at the system's own connectors left out or not."""

    def export(closed: bool) -> Path:
        system = with_parameters(
            load_system("joint"), {"motor_bldc.winding.R": 0.25, "motor_bldc.motor.level": "averaged"}
        )
        written = write_fmus(system, tmp_path)
        write_osp(written, tmp_path / "OspSystemStructure.xml")
        return write_ssp(without_own_wires(written) if closed else written, tmp_path / "joint.ssp")

    return export


@pytest.mark.parametrize("peer", [FMPY, FMUCONTAINER], ids=["FMPy", "fmucontainer"])
def test_the_system_opens_as_it_is(exported: Callable[[bool], Path], peer: tuple[str, str]) -> None:
    opens(peer, exported(False))


@pytest.mark.parametrize("peer", [ECOS, LIBCOSIM, FMPY, FMUCONTAINER], ids=["ecos", "libcosim", "FMPy", "fmucontainer"])
def test_the_system_without_wires_of_its_own_opens_as_it_is(
    exported: Callable[[bool], Path], peer: tuple[str, str]
) -> None:
    opens(peer, exported(True))


def test_libcosim_opens_the_system_structure(exported: Callable[[bool], Path]) -> None:
    opens(LIBCOSIM, exported(False).parent / "OspSystemStructure.xml")
