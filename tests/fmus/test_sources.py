"""The sources in each FMU: they compile where the headers are, behave like the binary, and pass the sanitizers."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy import platform

from cobot_joint.units import Unit

HEADERS = Path(fmpy.__file__).parent / "c-code"
FLAGS = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fno-math-errno", "-fno-trapping-math"]

Load = Callable[[str], Unit]


@pytest.fixture(scope="module")
def compiler() -> str:
    """Skips where there is none: the FMUs themselves come built."""
    found = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
    if found is None:
        pytest.skip("no C compiler on this machine")
    return found


def compile_c(compiler: str, *arguments: str | Path) -> None:
    done = subprocess.run([compiler, *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_sources_compile_and_behave_bit_by_bit_like_the_binary(
    load: Load, instantiate: Callable[..., Any], compiler: str, tmp_path: Path, name: str
) -> None:
    unit = load(name)
    copy = tmp_path / name
    shutil.copytree(unit.directory, copy)
    (library,) = (copy / "binaries" / platform).iterdir()
    library.unlink()
    source = copy / "sources"
    compile_c(
        compiler, *FLAGS, "-O2", "-shared", "-fPIC", "-I", source, "-I", HEADERS, source / "all.c", "-o", library, "-lm"
    )
    archive = Path(shutil.make_archive(str(tmp_path / f"{name}_rebuilt"), "zip", copy)).rename(tmp_path / f"{name}.fmu")

    results = []
    for fmu in (name, archive):
        slave = instantiate(fmu).initialise()
        waves = {
            n: _wave(float(unit.variables[n].nominal), k) for k, n in enumerate(slave.inputs()) if n != "J_coupled"
        }
        out = slave.run(0.2, 1e-3, slave.outputs(), waves)
        results.append(np.array([out[n] for n in slave.outputs()]))
    np.testing.assert_array_equal(*results)


def _wave(nominal: float, k: int) -> Callable[[float], float]:
    return lambda t: 0.3 * nominal * np.sin((20 + k) * t)


@pytest.mark.parametrize("file", ["planetary_gear/equations.c", "planetary_gear/model.def", "fmi2/integrate.h"])
def test_another_equation_term_or_integrator_is_another_guid(root: Path, tmp_path: Path, file: str) -> None:
    """the GUIDs that the build gives to two checkouts that differ by one character"""
    cmake = shutil.which("cmake")
    if cmake is None:
        pytest.skip("no CMake on this machine")
    guids = set()
    for name in ("before", "after"):
        copy = tmp_path / name
        shutil.copytree(root / "fmus", copy / "fmus")
        if name == "after":
            text = (copy / "fmus" / file).read_text(encoding="utf-8")
            assert " + " in text
            (copy / "fmus" / file).write_text(text.replace(" + ", " - ", 1), encoding="utf-8")
        script = copy / "guid.cmake"
        script.write_text(
            f"""set(CMAKE_SOURCE_DIR {copy})
include({root}/cmake/Guid.cmake)
file(GLOB sources {copy}/fmus/planetary_gear/*.[chd]* {copy}/fmus/fmi2/*.[ch])
guid_of_sources(guid ${{sources}})
message("${{guid}}")""",
            encoding="utf-8",
        )
        done = subprocess.run([cmake, "-P", script], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        guids.add(done.stderr.strip())
    assert len(guids) == 2, guids


def test_guid_in_the_description_is_the_one_in_the_sources(load: Load, name: str) -> None:
    unit = load(name)
    assert f'"{unit.description.guid}"' in (unit.directory / "sources" / "all.c").read_text(encoding="utf-8")


@pytest.mark.long
def test_simulation_passes_the_address_and_undefined_behaviour_sanitizers(
    load: Load, compiler: str, tmp_path: Path, root: Path, name: str
) -> None:
    source = load(name).directory / "sources"
    sanitizers = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    probe = tmp_path / "probe.c"
    probe.write_text("int main(void) { return 0; }\n", encoding="utf-8")
    if subprocess.run([compiler, *sanitizers, str(probe), "-o", str(tmp_path / "probe")], check=False).returncode != 0:
        pytest.skip(f"{compiler} has no sanitizers")
    program = tmp_path / "program"
    compile_c(
        compiler, *FLAGS, *sanitizers, f'-DUNIT_SOURCE="{source}/all.c"', "-I", source, "-I", HEADERS,
        root / "tests/fmus/drive_all.c", "-o", program, "-lm",
    )  # fmt: skip
    done = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
