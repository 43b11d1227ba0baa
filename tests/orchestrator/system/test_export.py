"""FMUs for other simulators: as they are, without dots in their names, for other platforms."""

from __future__ import annotations

import hashlib
import struct
import zipfile
from importlib.util import find_spec
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from cobot_joint.cosim import Experiment, simulate
from cobot_joint.errors import UserError
from cobot_joint.pack import pack
from cobot_joint.system import Inputs, System, load_system, with_parameters, write_fmus, write_fmus_alone, write_ssp
from cobot_joint.system.export.fmi3 import as_fmi3
from cobot_joint.system.export.platforms import PLATFORMS, compile_for_all, universal
from cobot_joint.system.flat_names import flatten

DRIVE = Experiment(Inputs(np.array([0.0, 0.1]), {"v_command": np.array([0.0, 12.0])}), 0.3)


def digests(folder: Path) -> dict[str, str]:
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in folder.iterdir()}


def export(folder: Path, *changes) -> System:
    system = with_parameters(load_system("joint"), {"motor_bldc.winding.R": 0.25})
    exported = write_fmus(system, folder, changes)
    write_ssp(exported, folder / "joint.ssp")
    return load_system(folder / "joint.ssp")


@pytest.mark.parametrize("changes", [(), (flatten,)])
def test_two_exports_are_the_same_bytes(tmp_path: Path, changes) -> None:
    for name in ("one", "another"):
        export(tmp_path / name, *changes)
    assert digests(tmp_path / "one") == digests(tmp_path / "another")


def test_flat_names_have_no_dots_and_change_no_result(tmp_path: Path) -> None:
    flat, plain = export(tmp_path / "flat", flatten), export(tmp_path / "plain")
    for component in flat.components:
        assert not [name for name in component.unit.variables if "." in name]
        assert component.unit.description.variableNamingConvention == "flat"
        assert [t.name for t in component.unit.terms] == [t.name for t in plain.component(component.name).unit.terms]
    assert flat.component("motor_bldc").parameters == {"winding_R": 0.25}
    one, other = simulate(flat, DRIVE), simulate(plain, DRIVE)
    for name, samples in one.signals.items():
        np.testing.assert_array_equal(samples, other[name])


def test_parameters_are_start_values_of_the_exported_fmus(tmp_path: Path) -> None:
    """also of one that carries another value already, and under names without dots"""
    first = export(tmp_path / "first")
    again = write_fmus(with_parameters(first, {"motor_bldc.friction.d": 2e-5}), tmp_path / "again", (flatten,))
    unit = again.component("motor_bldc").unit
    assert {n: float(unit.variables[n].start) for n in ("winding_R", "friction_d")} == {
        "winding_R": 0.25,
        "friction_d": 2e-5,
    }
    kept = (unit.directory / "resources/start_values.txt").read_text(encoding="utf-8").splitlines()[1:]
    assert kept == ["winding.R = 0.25", "friction.d = 2e-05"]


def test_names_that_would_become_one_are_refused(tmp_path: Path) -> None:
    description = tmp_path / "modelDescription.xml"
    description.write_text(
        '<fmiModelDescription modelName="m"><ModelVariables><ScalarVariable name="a.b"/><ScalarVariable name="a_b"/>'
        "</ModelVariables></fmiModelDescription>"
    )
    with pytest.raises(UserError, match="a_b would be the name of two variables of m"):
        flatten(tmp_path)


def test_a_packed_folder_does_not_tell_when_it_was_packed(tmp_path: Path) -> None:
    for name in ("b.txt", "modelDescription.xml", "a.txt"):
        (tmp_path / "fmu").mkdir(exist_ok=True)
        (tmp_path / "fmu" / name).write_text(name)
    pack(tmp_path / "fmu", tmp_path / "x.fmu")
    with zipfile.ZipFile(tmp_path / "x.fmu") as archive:
        assert archive.namelist() == ["modelDescription.xml", "a.txt", "b.txt"]
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_a_universal_binary_lists_its_processors_where_they_are() -> None:
    parts = [
        struct.pack("<III", 0xFEEDFACF, cpu, 3) + bytes([cpu % 256]) * length for cpu, length in ((7, 10), (12, 9))
    ]
    whole = universal(parts)
    assert struct.unpack(">II", whole[:8]) == (0xCAFEBABE, 2)
    for k, part in enumerate(parts):
        cpu, kind, at, length, align = struct.unpack(">IIIII", whole[8 + 20 * k : 28 + 20 * k])
        assert (cpu, kind) == struct.unpack("<II", part[4:12])
        assert at % 2**align == 0
        assert whole[at : at + length] == part


HEADS = {
    "linux64": b"\x7fELF\x02",
    "aarch64-linux": b"\x7fELF\x02",
    "win64": b"MZ",
    "win32": b"MZ",
    "darwin64": b"\xca\xfe\xba\xbe",
}


@pytest.mark.long
def test_units_are_compiled_for_five_platforms_and_run_here(tmp_path: Path) -> None:
    if find_spec("ziglang") is None:
        pytest.skip("the compiler of the package `ziglang` is not installed")
    exported = export(tmp_path, compile_for_all)
    for component in exported.components:
        with zipfile.ZipFile(component.unit.path) as archive:
            binaries = {name.split("/")[1]: archive.read(name) for name in archive.namelist() if "binaries/" in name}
        assert set(binaries) == {p.folder for p in PLATFORMS}
        for folder, head in HEADS.items():
            assert binaries[folder].startswith(head)
            assert b"GLIBC_2.1" in binaries[folder] or "linux" not in folder
            newer = [f"GLIBC_2.{minor}".encode() for minor in range(18, 60)]
            assert not [version for version in newer if version + b"\0" in binaries[folder]]
            assert str(tmp_path).encode() not in binaries[folder]
        assert component.unit.path.stat().st_size < 400_000
    if fmpy.platform in ("linux64", "win64", "darwin64"):
        ours = export(tmp_path / "plain")
        one, other = simulate(exported, DRIVE), simulate(ours, DRIVE)
        for name, samples in one.signals.items():
            np.testing.assert_allclose(samples, other[name], rtol=1e-6, atol=1e-6 * np.max(np.abs(samples)))


def test_fmi3_fmus_carry_what_the_system_sets(tmp_path: Path) -> None:
    """start values, in a unit that carries one already too; the library reads them at instantiation"""
    system = with_parameters(load_system("joint"), {"motor_bldc.winding.R": 0.25})
    write_fmus_alone(write_fmus(system, tmp_path / "first"), tmp_path / "second", [as_fmi3])
    fmu = tmp_path / "second/motor_bldc.fmu"
    assert validate_fmu(str(fmu)) == []
    description = fmpy.read_model_description(str(fmu))
    assert description.fmiVersion == "3.0"
    assert {v.name: v.start for v in description.modelVariables}["winding.R"] == "0.25"
    run = fmpy.simulate_fmu(str(fmu), stop_time=1e-3, output=["winding.R"], apply_default_start_values=False)
    assert run["winding.R"][-1] == 0.25


def test_fmi3_without_dots_in_names(tmp_path: Path) -> None:
    write_fmus_alone(load_system("joint"), tmp_path, [as_fmi3, flatten])
    names = [v.name for v in fmpy.read_model_description(str(tmp_path / "motor_bldc.fmu")).modelVariables]
    assert "winding_R" in names
    assert not [name for name in names if "." in name]


def test_an_fmu_that_is_not_ours_has_no_fmi3_twin(tmp_path: Path) -> None:
    write_fmus(load_system("joint"), tmp_path / "joint")
    folder = tmp_path / "foreign"
    fmpy.extract(str(tmp_path / "joint/torque_sensor.fmu"), unzipdir=str(folder))
    (folder / "sources/all.c").unlink()
    with pytest.raises(UserError, match="--for fmi3: torque_sensor is not one of the units"):
        as_fmi3(folder)
