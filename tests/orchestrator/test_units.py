"""Units: found, unpacked once, and what they annotate."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from cobot_joint import units
from cobot_joint.errors import UserError
from cobot_joint.units import Flange, Shape, find_fmu, load_unit, unpack


def test_fmu_beside_the_system_goes_before_the_shipped_one(fmu: Callable[[str], Path], tmp_path: Path) -> None:
    own = shutil.copy(fmu("torque_sensor"), tmp_path / "torque_sensor.fmu")
    assert find_fmu("torque_sensor.fmu", tmp_path) == Path(own)
    assert find_fmu("resources/torque_sensor.fmu", tmp_path) == fmu("torque_sensor")


def test_named_folder_goes_before_the_shipped_units(
    fmu: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = Path(shutil.copy(fmu("torque_sensor"), tmp_path))
    monkeypatch.setenv("COBOT_JOINT_FMUS", str(tmp_path))
    assert find_fmu("torque_sensor.fmu") == own


def test_fmu_is_unpacked_once_and_anew_when_it_changes(tmp_path: Path) -> None:
    path = tmp_path / "a.fmu"
    for content in ("one", "two", "two"):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr(zipfile.ZipInfo("content"), content)
        assert (unpack(path) / "content").read_text() == content
    assert unpack(path) == unpack(Path(shutil.copy(path, tmp_path / "b.fmu")))  # by what is in it, not by its name


def test_unit_unpacks_where_the_cache_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with zipfile.ZipFile(tmp_path / "a.fmu", "w") as archive:
        archive.writestr("content", "x")
    units._cache.cache_clear()
    units._digest.cache_clear()
    try:
        assert (unpack(tmp_path / "a.fmu") / "content").read_text() == "x"
    finally:
        units._cache.cache_clear()


def test_terms_are_what_the_unit_annotates(fmu: Callable[[str], Path]) -> None:
    motor = load_unit(fmu("motor_bldc"))
    cogging = next(term for term in motor.terms if term.name == "cogging")
    assert (cogging.amplitude, cogging.neutral) == ("cogging.A", 0)
    assert Shape("cogging.n", 1, 24, "order", 24) in cogging.shapes
    assert cogging.equation
    assert cogging.source


def test_flanges_are_what_the_unit_annotates(fmu: Callable[[str], Path]) -> None:
    assert load_unit(fmu("motor_bldc")).flanges == (Flange("shaft", "phi", "w", "tau", "W", "W_abs", "gives"),)
    assert [f.role for f in load_unit(fmu("planetary_gear")).flanges] == ["takes", "gives"]


def test_every_term_of_every_unit_starts_switched_off(fmu: Callable[[str], Path]) -> None:
    for name in ("motor_bldc", "planetary_gear", "torque_sensor", "mr_brake_belt", "acquisition"):
        unit = load_unit(fmu(name))
        for term in unit.terms:
            if term.amplitude is not None:
                assert float(unit.variables[term.amplitude].start) == term.neutral, f"{name}.{term.name}"


def test_bounds_of_an_enumeration_are_its_items(fmu: Callable[[str], Path]) -> None:
    assert load_unit(fmu("motor_bldc")).bounds_of("motor.level") == (1, 3)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"no archive", "not a .fmu file"),
        ({"readme": "x"}, "it holds no modelDescription.xml"),
        ({"modelDescription.xml": "<a"}, "modelDescription.xml: not XML"),
        ({"modelDescription.xml": "<a/>"}, "modelDescription.xml: "),
    ],
)
def test_file_that_is_no_fmu_is_refused(content: bytes | dict[str, str], words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.fmu"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        with zipfile.ZipFile(path, "w") as archive:
            for name, text in content.items():
                archive.writestr(name, text)
    with pytest.raises(UserError) as refused:
        load_unit(path)
    assert words in str(refused.value)
    assert str(path) in str(refused.value)
