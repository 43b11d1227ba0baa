"""The sources in each FMU: they compile where the headers are, behave like the binary, and pass the sanitizers."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy import platform
from fmpy.build import build_platform_binary

from cobot_joint.units import Unit

HEADERS = Path(fmpy.__file__).parent / "c-code"
FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fno-math-errno", "-fno-trapping-math"]

UNITS = sorted(table.parent.name for table in (Path(__file__).parents[2] / "fmus").glob("*/model.def"))

Load = Callable[[str], Unit]


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
        compiler, *FLAGS, "-O2", "-shared", "-fPIC", "-DFMI2_OVERRIDE_FUNCTION_PREFIX", "-I", source,
        "-I", HEADERS, source / "all.c", "-o", library, "-lm",
    )  # fmt: skip
    archive = Path(shutil.make_archive(str(tmp_path / f"{name}_rebuilt"), "zip", copy)).rename(tmp_path / f"{name}.fmu")

    results = []
    for fmu in (name, archive):
        slave = instantiate(fmu).initialise()
        waves = {
            n: _wave(float(unit.variables[n].nominal), k)
            for k, n in enumerate(slave.inputs())
            if not n.startswith("J_")
        }
        out = slave.run(0.2, 1e-3, slave.outputs(), waves)
        results.append(np.array([out[n] for n in slave.outputs()]))
    np.testing.assert_array_equal(*results)


@pytest.fixture(scope="module")
def standard_headers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMI headers with the standard's prefix, which FMPy takes out of its copy."""
    folder = tmp_path_factory.mktemp("headers")
    for header in ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"):
        shutil.copy(HEADERS / header, folder)
    functions = folder / "fmi2Functions.h"
    text = functions.read_text(encoding="utf-8")
    assert "#define fmi2FullName(name) name" in text
    functions.write_text(text.replace("#define fmi2FullName(name) name", PREFIXED), encoding="utf-8")
    return folder


PREFIXED = """
#if !defined FMI2_OVERRIDE_FUNCTION_PREFIX && defined FMI2_FUNCTION_PREFIX
#define fmi2Paste(a, b) a##b
#define fmi2PasteB(a, b) fmi2Paste(a, b)
#define fmi2FullName(name) fmi2PasteB(FMI2_FUNCTION_PREFIX, name)
#else
#define fmi2FullName(name) name
#endif
"""


def test_all_units_link_into_one_program(load: Load, compiler: str, standard_headers: Path, tmp_path: Path) -> None:
    """as code generators do: every unit's functions carry its name, and nothing else is visible"""
    objects = []
    for name in UNITS:
        source = load(name).directory / "sources"
        objects.append(tmp_path / f"{name}.o")
        compile_c(
            compiler, *FLAGS, "-O1", "-c", "-I", source, "-I", standard_headers, source / "all.c", "-o", objects[-1]
        )
    program = tmp_path / "program.c"
    declared = "".join(f"extern const char *{name}_fmi2GetVersion(void);\n" for name in UNITS)
    called = "".join(f"  puts({name}_fmi2GetVersion());\n" for name in UNITS)
    program.write_text(f"#include <stdio.h>\n{declared}int main(void) {{\n{called}  return 0;\n}}\n", encoding="utf-8")
    compile_c(compiler, program, *objects, "-o", tmp_path / "program", "-lm")
    done = subprocess.run([str(tmp_path / "program")], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["2.0"] * len(UNITS)


def test_the_recipe_is_valid_and_names_what_there_is(load: Load, name: str) -> None:
    (recipe,) = fmpy.model_description.read_build_description(str(load(name).directory))
    (files,) = recipe.sourceFileSets
    assert recipe.modelIdentifier == name
    assert all((load(name).directory / "sources" / file).is_file() for file in files.sourceFiles)
    assert [d.name for d in files.preprocessorDefinitions] == ["FMI2_OVERRIDE_FUNCTION_PREFIX"]


def test_fmpy_builds_the_sources_by_itself(load: Load, compiler: str, tmp_path: Path) -> None:
    if shutil.which("cmake") is None:
        pytest.skip("no CMake on this machine, which FMPy builds with")
    copy = tmp_path / "torque_sensor"
    shutil.copytree(load("torque_sensor").directory, copy)
    (library,) = (copy / "binaries" / platform).iterdir()
    library.unlink()
    build_platform_binary(copy)
    assert library.is_file()
    archive = Path(shutil.make_archive(str(tmp_path / "rebuilt"), "zip", copy))
    assert fmpy.simulate_fmu(str(archive), stop_time=0.1)["time"][-1] == pytest.approx(0.1)


@pytest.mark.long
def test_two_builds_give_the_same_bytes(root: Path, tmp_path: Path) -> None:
    """in two folders, one after the other"""
    cmake = shutil.which("cmake")
    if cmake is None or shutil.which("ninja") is None:
        pytest.skip("no CMake and Ninja on this machine")
    built = []
    for name in ("one", "another"):
        copy = tmp_path / name
        copy.mkdir()
        for part in ("fmus", "cmake", "orchestrator", "CMakeLists.txt", "LICENSE"):
            take = shutil.copytree if (root / part).is_dir() else shutil.copy
            take(root / part, copy / part)
        configure = [cmake, "-S", copy, "-B", copy / "build", "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release"]
        for call in ([*configure, f"-DPython3_EXECUTABLE={sys.executable}"], [cmake, "--build", copy / "build"]):
            subprocess.run(list(map(str, call)), check=True, capture_output=True)
        built.append({str(fmu.relative_to(copy)): fmu.read_bytes() for fmu in (copy / "build" / "fmus").rglob("*.fmu")})
    assert set(built[0]) == {f"build/fmus/{fmi}{name}.fmu" for name in UNITS for fmi in ("", "fmi3/")}
    assert built[0] == built[1]


def _wave(nominal: float, k: int) -> Callable[[float], float]:
    return lambda t: 0.3 * nominal * np.sin((20 + k) * t)


@pytest.mark.parametrize("file", ["planetary_gear/equations.c", "planetary_gear/model.def", "core/integrate.h"])
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
file(GLOB sources {copy}/fmus/planetary_gear/*.[chd]* {copy}/fmus/core/*.h)
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
