"""Libraries for other platforms are run where an emulator is: qemu-user for ARM, wine for Windows."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import fmpy
import numpy as np
import pytest

from cobot_joint.system.export.platforms import PLATFORMS, compile_for_all
from cobot_joint.units import find_fmu

pytestmark = pytest.mark.long
UNITS = ("motor_bldc", "planetary_gear", "torque_sensor", "mr_brake_belt")
DRIVER = Path(__file__).with_name("step_unit.c")


@dataclass(frozen=True)
class Emulator:
    """What runs a program of another platform, and the libraries that it needs beside itself."""

    platform: str
    command: tuple[str, ...]
    needs: str | None = None


HERE = Emulator("linux64", ())
EMULATORS = (
    Emulator("aarch64-linux", ("qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"), "/usr/aarch64-linux-gnu/lib/libm.so.6"),
    Emulator("win64", ("wine",)),
)


def outputs(unit: str, emulator: Emulator, folder: Path) -> np.ndarray:
    """(steps, outputs), from the unit's library for that platform in a program of that platform."""
    platform = next(p for p in PLATFORMS if p.folder == emulator.platform)
    unpacked = Path(fmpy.extract(str(find_fmu(f"{unit}.fmu")), unzipdir=str(folder / unit)))
    compile_for_all(unpacked, [platform])
    program = folder / ("step_unit.exe" if "win" in platform.folder else "step_unit")
    headers = Path(fmpy.__file__).parent / "c-code"
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", platform.targets[0], "-O1", "-I", str(headers)]
    subprocess.run([*compiler, str(DRIVER), "-o", str(program), "-lm"], check=True, timeout=300)
    description = fmpy.read_model_description(str(unpacked))
    reals = [v for v in description.modelVariables if v.type == "Real"]
    vrs = [",".join(str(v.valueReference) for v in reals if v.causality == kind) for kind in ("input", "output")]
    library = unpacked / "binaries" / platform.folder / f"{unit}{platform.suffix}"
    said = run([*emulator.command, str(program), str(library), description.guid, *vrs])
    return np.array([[float.fromhex(x) for x in line.split()] for line in said.splitlines()])


def run(call: Sequence[str]) -> str:
    """What a program prints."""
    done = subprocess.run(
        call, capture_output=True, text=True, timeout=300, check=False, env=os.environ | {"WINEDEBUG": "-all"}
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.parametrize("emulator", EMULATORS, ids=lambda e: e.platform)
@pytest.mark.parametrize("unit", UNITS)
def test_a_unit_answers_on_another_platform_as_here(unit: str, emulator: Emulator, tmp_path: Path) -> None:
    """but for the rounding of that platform's own sine and exponential"""
    if not shutil.which(emulator.command[0]):
        pytest.skip(f"{emulator.command[0]} is not installed")
    if emulator.needs and not Path(emulator.needs).exists():
        pytest.skip(f"{emulator.needs} is not installed")
    if find_spec("ziglang") is None:
        pytest.skip("the compiler of the package `ziglang` is not installed")
    if fmpy.platform != "linux64":
        pytest.skip(f"the libraries are compared with those of linux64, this is {fmpy.platform}")
    here, there = (outputs(unit, e, tmp_path / e.platform) for e in (HERE, emulator))
    size = np.maximum(np.abs(here).max(axis=0), 1e-300)
    assert np.ptp(here, axis=0).max() > 0
    np.testing.assert_allclose(there / size, here / size, rtol=0, atol=1e-6)
