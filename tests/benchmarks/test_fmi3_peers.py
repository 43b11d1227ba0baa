"""FMI 3.0 units, and model exchange, in importers and a checker other than FMPy's: fmuloader, fmi-rs and FMI4j, which
have nothing of FMPy in them, and fmucontainer and fmutool of fmu-manipulation-toolbox.

COBOT_JOINT_PEERS names the interpreter of the environment that has them, COBOT_JOINT_JARS and COBOT_JOINT_FMI_RS name
those in Java and Rust (benchmarks/README.md); those that are missing are skipped.
"""

from __future__ import annotations

import dataclasses
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks import bench
from benchmarks.peers import Absent
from benchmarks.peers.alone import ABSENT
from benchmarks.peers.client import Peer
from cobot_joint.cosim.foreign.cross_check import DURATION, STEP, write_cross_check
from cobot_joint.units import find_fmu, load_unit

PYTHON = os.environ.get("COBOT_JOINT_PEERS", sys.executable)
ROOT = Path(__file__).parents[2]
UNITS = sorted(table.parent.name for table in (ROOT / "fmus").glob("*/model.def"))
CLOSE = 4e-3  # rms of the difference over the signal's range; inputs are held there, and linear in ours
LATER = {  # where held inputs shift a switching in time
    ("planetary_gear", "phi_o"): 0.02, ("planetary_gear", "w_o"): 0.1, ("planetary_gear", "tau"): 0.1,
    ("planetary_gear", "tau_g"): 0.1, ("planetary_gear", "delta"): 0.05,  # teeth that meet
    ("motor_bldc", "i_a"): 0.04, ("motor_bldc", "i_b"): 0.04, ("motor_bldc", "i_c"): 0.04,  # commutation
}  # fmt: skip
STEPPERS = [(name, f"FMI {version}.0") for name in ("fmuloader", "fmi-rs") for version in (2, 3)]
INTEGRATED = 1e-4  # the same of a unit that is integrated; inputs are linear there as in ours
SAMPLED = {"w_reading": 0.05}  # every millisecond there, at every communication point in ours

IN_A_CONTAINER = """
import json, sys
from pathlib import Path
name, step, end = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
try:
    import fmpy
    from fmpy.util import read_csv, write_csv
    from fmu_manipulation_toolbox.assembly import Assembly
except ImportError as why:
    print(why)
    sys.exit(77)
asked = {"name": "container.fmu", "step_size": step, "fmu": [f"{name}.fmu"], "auto_input": True, "auto_output": True}
Path("container.json").write_text(json.dumps(asked))
Assembly("container.json", fmu_directory=Path.cwd()).make_fmu()
signals = read_csv(f"{name}_in.csv")
write_csv("got.csv", fmpy.simulate_fmu("container.fmu", stop_time=end, output_interval=step, input=signals))
"""


def fmi3(name: str) -> Path:
    fmu = find_fmu(f"{name}.fmu")
    return fmu.parent / "fmi3" / fmu.name


def table(path: Path) -> np.ndarray:
    return np.genfromtxt(path, delimiter=",", names=True, deletechars="")


def alone(importer: str, path: Path, kind: str, folder: Path) -> np.ndarray:
    """What a unit answers to the signals of `write_cross_check` in the folder. Skips without the importer."""
    got = folder / "got.csv"
    given = [importer, path, kind, folder / f"{path.stem}_in.csv", STEP, DURATION, got]
    call = [PYTHON, "-m", "benchmarks.peers.alone", *map(str, given)]
    done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, timeout=600, check=False)
    if done.returncode == ABSENT:
        pytest.skip(f"{importer} is not here: {done.stdout.strip()}")
    assert done.returncode == 0, done.stderr[-2000:]
    return table(got)


def far_off(ours: np.ndarray, theirs: np.ndarray, allowed: Callable[[str], float]) -> dict[str, float]:
    """The rms difference of signals in which it is more than this share of their range."""
    errors = {n: np.sqrt(np.mean((ours[n] - theirs[n]) ** 2)) for n in (ours.dtype.names or ())[1:]}
    return {name: float(error) for name, error in errors.items() if error > allowed(name) * np.ptp(ours[name])}


@pytest.mark.parametrize(("importer", "version"), STEPPERS)
@pytest.mark.parametrize("name", UNITS)
def test_a_unit_that_is_stepped_answers_as_in_our_master(
    name: str, importer: str, version: str, tmp_path: Path
) -> None:
    two = find_fmu(f"{name}.fmu")
    write_cross_check(load_unit(two), tmp_path)
    theirs = alone(importer, fmi3(name) if version == "FMI 3.0" else two, "CoSimulation", tmp_path)
    ours = table(tmp_path / f"{name}_ref.csv")
    assert far_off(ours, theirs, lambda signal: LATER.get((name, signal), CLOSE)) == {}


@pytest.mark.parametrize(("importer", "version"), [*STEPPERS, ("FMI4j", "FMI 2.0")])
@pytest.mark.parametrize("name", UNITS)
def test_a_unit_that_is_integrated_answers_as_in_co_simulation(
    name: str, importer: str, version: str, tmp_path: Path
) -> None:
    two = find_fmu(f"{name}.fmu")
    if load_unit(two).description.modelExchange is None:
        pytest.skip(f"{name} offers no model exchange: it takes its samples at communication points")
    write_cross_check(load_unit(two), tmp_path)
    theirs = alone(importer, fmi3(name) if version == "FMI 3.0" else two, "ModelExchange", tmp_path)
    ours = table(tmp_path / f"{name}_ref.csv")
    assert far_off(ours, theirs, lambda signal: SAMPLED.get(signal, INTEGRATED)) == {}


@pytest.mark.parametrize("name", UNITS)
def test_a_unit_alone_in_fmucontainer_answers_as_in_our_master(name: str, tmp_path: Path) -> None:
    write_cross_check(load_unit(find_fmu(f"{name}.fmu")), tmp_path)
    shutil.copy(fmi3(name), tmp_path)
    call = [PYTHON, "-c", IN_A_CONTAINER, name, str(STEP), str(DURATION)]
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    if done.returncode == 77:
        pytest.skip(f"fmucontainer is not here: {done.stdout.strip()}")
    assert done.returncode == 0, done.stderr[-2000:]
    ours, theirs = table(tmp_path / f"{name}_ref.csv"), table(tmp_path / "got.csv")
    assert far_off(ours, theirs, lambda signal: LATER.get((name, signal), CLOSE)) == {}


@pytest.mark.parametrize("importer", ["fmucontainer", "fmuloader_loop", "fmi_rs"])
def test_the_joint_of_fmi_3_units_couples_as_that_of_fmi_2_units(importer: str, tmp_path: Path) -> None:
    step, end = 1e-3, 8.0  # s; the load comes on
    try:
        peer = Peer(importer, PYTHON)
    except Absent as why:
        pytest.skip(f"{importer} is not here: {why}")
    try:
        inputs = bench.table_of(bench.inputs(), end)
        two = bench.wiring(bench.joint(), tmp_path, step, inputs)
        units = {n: str(fmi3(Path(p).stem)) if Path(p).stem in UNITS else p for n, p in two.units.items()}
        found, same = peer.run(dataclasses.replace(two, units=units)).columns, peer.run(two).columns
    finally:
        peer.close()
    assert set(map(Path, units.values())) >= {fmi3("motor_bldc"), fmi3("planetary_gear")}
    errors = bench.errors(found, step, inputs)
    assert errors["i_motor"] <= 5e-2  # A, rms
    assert errors["w_motor"] <= 5.0  # rad/s
    for column, values in same.items():
        np.testing.assert_array_equal(found[column], values, err_msg=column)


def errors_of(fmu: Path) -> list[str]:
    """What `fmutool -check` finds: the schema, and what FMI 3.0 says of its values. Skips where it is not there."""
    tool = Path(PYTHON).with_name("fmutool")
    if not tool.is_file():
        pytest.skip(f"fmutool is not here: {tool.parent} has none")
    done = subprocess.run([tool, "-input", fmu, "-check"], capture_output=True, text=True, timeout=120, check=False)
    said = done.stdout + done.stderr
    found = [line for line in said.splitlines() if line.startswith("ERROR")]
    assert "against the FMI-3 standard" in said, said
    assert (done.returncode == 0) == (not found), said
    return found


@pytest.mark.parametrize("name", UNITS)
def test_fmutool_finds_nothing_in_a_unit(name: str) -> None:
    assert errors_of(fmi3(name)) == []


def test_fmutool_finds_a_value_reference_that_is_given_twice(tmp_path: Path) -> None:
    with zipfile.ZipFile(fmi3("torque_sensor")) as unit, zipfile.ZipFile(tmp_path / "x.fmu", "w") as wrong:
        text = unit.read("modelDescription.xml").decode()
        assert text.count(' valueReference="1"') == 1
        wrong.writestr("modelDescription.xml", text.replace(' valueReference="1"', ' valueReference="0"'))
    assert any("valueReference 0" in error for error in errors_of(tmp_path / "x.fmu"))
