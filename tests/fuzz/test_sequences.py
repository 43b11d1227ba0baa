"""Random calls on every unit, under the sanitizers: no memory that is not its own, no undefined operation, no leak."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import fmpy
import pytest

from cobot_joint.units import find_fmu, load_unit

HERE = Path(__file__).parent
UNITS = sorted(table.parent.name for table in (HERE.parents[1] / "fmus").glob("*/model.def"))
HEADERS = Path(fmpy.__file__).parent / "c-code"
SHORT = 1000  # sequences of 30 calls on two instances
LEAST = 0.2  # share of the steps that a unit takes


@cache
def can(compiler: str, sanitizers: str, folder: Path) -> bool:
    """Whether the compiler has them, and a program of theirs runs here."""
    source, program = folder / "probe.c", folder / "probe"
    source.write_text("int main(void) { return 0; }\n")
    made = subprocess.run([compiler, f"-fsanitize={sanitizers}", source, "-o", program], check=False)
    return made.returncode == 0 and subprocess.run([program], check=False).returncode == 0


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """program("motor_bldc", "thread", "fmi3"): unit and sequences.c in one; "exchange2", "exchange3": model exchange"""
    compiler = os.environ.get("CC") or next((c for c in ("gcc", "clang", "cc") if shutil.which(c)), None)
    if compiler is None:
        pytest.skip("no C compiler for the sanitizers")

    def make(unit: str, sanitizers: str, version: str) -> Path:
        folder = tmp_path_factory.mktemp(unit)
        if not can(compiler, sanitizers, folder):
            pytest.skip(f"{compiler} has no -fsanitize={sanitizers} that runs here")
        fmu = find_fmu(f"{unit}.fmu")
        if version[-1] == "3":
            fmu = fmu.parent / "fmi3" / fmu.name
        exchange = version.startswith("exchange")
        if exchange and load_unit(find_fmu(f"{unit}.fmu")).description.modelExchange is None:
            pytest.skip(f"{unit} offers no model exchange")
        source = Path(fmpy.extract(str(fmu), unzipdir=str(folder))) / "sources"
        defined = ["_GNU_SOURCE", "FMI3_OVERRIDE_FUNCTION_PREFIX", *(["EXCHANGE"] if exchange else [])]
        flags = ["-std=c11", "-g", "-O1", "-fno-sanitize-recover=all", f"-fsanitize={sanitizers}"]
        flags += [f"-D{name}" for name in defined]
        include = [f'-DUNIT_SOURCE="{source}/all.c"', "-I", source, "-I", HEADERS]
        command = [compiler, *flags, *include, HERE / "sequences.c", "-o", folder / "fuzz", "-lm", "-lpthread"]
        subprocess.run(command, check=True)
        return folder / "fuzz"

    return make


def said(program: Path, *arguments: int) -> str:
    """What it found; nothing is well. Too few steps that are taken would find nothing."""
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode:
        return f"exit {done.returncode}: {done.stdout}{done.stderr}"
    print(done.stdout)
    taken, asked = map(int, re.findall(r"(\d+) of (\d+) steps taken", done.stdout)[0])
    return "" if taken > LEAST * asked else done.stdout


pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the sanitizers' programs are for POSIX")


each_version = pytest.mark.parametrize("version", ["fmi2", "exchange2", "fmi3", "exchange3"])


@each_version
@pytest.mark.parametrize(
    "unit", [pytest.param(unit, marks=() if unit == "motor_bldc" else pytest.mark.long) for unit in UNITS]
)
def test_no_sequence_of_calls_breaks_a_unit(program: Callable[..., Path], unit: str, version: str, times: int) -> None:
    assert said(program(unit, "address,undefined", version), 0, SHORT * times) == ""


@pytest.mark.long
@each_version
@pytest.mark.parametrize("unit", UNITS)
def test_instances_in_eight_threads_share_nothing(
    program: Callable[..., Path], unit: str, version: str, times: int
) -> None:
    assert said(program(unit, "thread", version), 0, SHORT * times, 8) == ""
