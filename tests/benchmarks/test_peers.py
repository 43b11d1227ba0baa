"""The units in other people's simulators: coupled in masters that hold inputs, and the exported system as it is.

The peers are those of benchmarks/requirements.txt; COBOT_JOINT_PEERS names the interpreter of the environment that has
them, COBOT_JOINT_JARS the folder of those in Java. Those that are missing are skipped.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from benchmarks import bench
from benchmarks.peers import JACOBI, PEERS, Absent
from benchmarks.peers.client import Peer
from cobot_joint.cosim import Experiment, simulate
from cobot_joint.diagnosis.plant.correction import formula_parameters
from cobot_joint.diagnosis.repair.export import Correction, write_repair
from cobot_joint.system import (
    Inputs,
    System,
    load_system,
    with_parameters,
    without_own_wires,
    write_fmus,
    write_ssp,
)
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


VOLTAGE, END = 12.0, 0.2  # V from standstill, s
CLOSE = 0.01  # of speed and current; the changed winding moves the speed by 4 %, a step of 1 ms moves it by 0.4 %

# peer -> what it is imported by, what runs the file `path` in it and leaves the motor's last speed `w`
FMPY = (
    "from fmpy.ssp.simulation import simulate_ssp",
    """
w = simulate_ssp(path, stop_time=end, step_size=1e-3, input={'v_command': lambda t: voltage})['w_motor'][-1]
""",
)
FMUCONTAINER = (
    "import fmpy, os\nfrom fmu_manipulation_toolbox.assembly import Assembly",
    """
os.chdir(os.path.dirname(path))
Assembly(path).make_fmu()
given = {'v_command': voltage}
w = fmpy.simulate_fmu('open.fmu', stop_time=end, output_interval=1e-3, start_values=given)['w_motor'][-1]
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
    simulation.add_scenario(real_actions=[(0.0, 'motor_bldc::set_value', voltage)])
    assert simulation.init()
    simulation.step(round(end / 1e-3))
    w = simulation.get_real('motor_bldc::w')
""",
)
LIBCOSIM = (
    """
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
""",
    """
create = CosimExecution.from_osp_config_file if path.endswith('.xml') else CosimExecution.from_ssp_file
execution = create(path)
motor = next(info.index for info in execution.slave_infos() if info.name == b'motor_bldc')
reference = {v.name: v.reference for v in execution.slave_variables(motor)}
manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
assert execution.add_manipulator(manipulator) and execution.add_observer(observer)
assert manipulator.slave_real_values(motor, [reference[b'set_value']], [voltage])
assert execution.step(round(end / 1e-3))  # the step is the file's own
(w,) = observer.last_real_values(motor, [reference[b'w']])
""",
)


def last_speed(peer: tuple[str, str], path: Path) -> float:
    """Of the motor, rad/s, as the peer runs the file in the peers' environment. Skips where it cannot be imported."""
    imports, body = peer
    guarded = "\n".join(f"    {line}" for line in imports.strip().splitlines())
    text = f"import sys\npath, voltage, end = sys.argv[1], {VOLTAGE}, {END}\ntry:\n{guarded}\n"
    text += f"except (ImportError, OSError) as why:\n    print(why)\n    sys.exit({ABSENT})\n{body}\n"
    text += "print('\\nw =', float(w))"
    done = subprocess.run([PYTHON, "-c", text, str(path)], capture_output=True, text=True, timeout=300, check=False)
    if done.returncode == ABSENT:
        pytest.skip(f"the peer is not here: {done.stdout.strip()}")
    assert done.returncode == 0, done.stderr[-2000:]
    return float(done.stdout.split("\nw = ")[1].split()[0])  # libcosim's log goes on after it


@dataclass(frozen=True)
class Exported:
    """What `export` writes, without and with `--for`, and the motor's last speed in ours, rad/s."""

    open: Path
    closed: Path
    structure: Path
    speed: float


def parameterised() -> System:
    return with_parameters(load_system("joint"), {"motor_bldc.winding.R": 0.9, "motor_bldc.motor.level": "averaged"})


def repaired(folder: Path) -> System:
    """Values, one of which sets in later, and a correction between the gearhead's speed and its torque."""
    values = {"motor_bldc.winding.R": 0.9, "planetary_gear.friction.d": 2e-5}
    parameters, signals = formula_parameters([(-1e-5, "planetary_gear.w")])
    drag = Correction("drag", "planetary_gear.tau_add", tuple(signals), parameters)
    onsets = {"planetary_gear.friction.d": 0.1}
    written = write_repair({"default": load_system("joint")}, values, folder, onsets=onsets, corrections=(drag,))
    return load_system(written["default"])


@pytest.fixture(scope="module", params=["with a parameter", "repaired"])
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    folder = tmp_path_factory.mktemp("exported")
    system = parameterised() if request.param == "with a parameter" else repaired(folder / "repair")
    written = write_fmus(system, folder)
    run = simulate(system, Experiment(Inputs(np.array([0.0]), {"v_command": np.array([VOLTAGE])}), END))
    return Exported(
        write_ssp(written, folder / "open.ssp"),
        write_ssp(without_own_wires(written), folder / "closed.ssp"),
        write_osp(written, folder / "OspSystemStructure.xml"),
        float(run["w_motor"][-1]),
    )


@pytest.mark.parametrize("peer", [FMPY, FMUCONTAINER], ids=["FMPy", "fmucontainer"])
def test_the_system_runs_as_it_is(exported: Exported, peer: tuple[str, str]) -> None:
    assert last_speed(peer, exported.open) == pytest.approx(exported.speed, rel=CLOSE)


@pytest.mark.parametrize("peer", [ECOS, LIBCOSIM], ids=["ecos", "libcosim"])
def test_the_system_without_wires_of_its_own_runs_as_it_is(exported: Exported, peer: tuple[str, str]) -> None:
    assert last_speed(peer, exported.closed) == pytest.approx(exported.speed, rel=CLOSE)


def test_libcosim_runs_the_system_structure(exported: Exported) -> None:
    assert last_speed(LIBCOSIM, exported.structure) == pytest.approx(exported.speed, rel=CLOSE)
