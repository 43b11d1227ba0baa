"""Units: found, unpacked once, and what they annotate."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
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


def damaged(whole: bytes, kind: str) -> bytes:
    """An archive with one entry, as it may come out of a mail or a disk."""
    local, central = whole.index(b"PK\x03\x04"), whole.index(b"PK\x01\x02")
    changed = bytearray(whole)
    if kind == "truncated":
        return whole[: len(whole) // 2]
    if kind == "encrypted":
        changed[local + 6] |= 1
        changed[central + 8] |= 1
    elif kind == "unknown compression":
        changed[local + 8] = changed[central + 10] = 99
    elif kind == "corrupt stream":
        changed[local + 60] ^= 0xFF
    elif kind == "huge":
        changed[central + 24 : central + 28] = (2_000_000_000).to_bytes(4, "little")
    return bytes(changed)


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        ("truncated", "not a .fmu file: "),
        ("encrypted", "an encrypted archive is given, one without a password is needed"),
        ("unknown compression", "not a .fmu file: That compression method is not supported"),
        ("corrupt stream", "not a .fmu file: "),
        ("huge", "2000 MB are in the archive, 1000 MB are allowed"),
    ],
)
def test_an_archive_that_cannot_be_unpacked_is_refused(tmp_path: Path, kind: str, told: str) -> None:
    path = tmp_path / f"{kind}.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", f"{kind} " + " ".join(str(k**3) for k in range(500)))
    path.write_bytes(damaged(path.read_bytes(), kind))
    with pytest.raises(UserError) as refused:
        unpack(path)
    assert str(refused.value).startswith(f"{path}: {told}")
    assert "\n" not in str(refused.value)


def test_an_archive_of_too_many_files_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "many.fmu", "w") as archive:
        for k in range(20_000):
            archive.writestr(str(k), "")
    with pytest.raises(UserError, match="20000 files are in the archive, 10000 are allowed"):
        unpack(tmp_path / "many.fmu")


def archive(folder: Path, name: str, size: int) -> Path:
    with zipfile.ZipFile(folder / name, "w") as file:
        file.writestr(name, bytes(size))
    return folder / name


def test_the_cache_keeps_its_size_and_what_may_be_in_use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COBOT_JOINT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(units, "CACHE_BYTES", 2500)
    units._cache.cache_clear()
    try:
        old, older, used = (unpack(archive(tmp_path, f"{name}.fmu", 1000)) for name in ("old", "older", "used"))
        killed = tmp_path / "cache" / f"{units.PARTIAL}x"
        killed.mkdir()
        for place, hours in ((old, 2), (older, 3), (killed, 2)):
            os.utime(place, (time.time() - 3600 * hours,) * 2)
        new = unpack(archive(tmp_path, "new.fmu", 500))
        assert [p.is_dir() for p in (old, older, used, new, killed)] == [True, False, True, True, False]
        unpack(tmp_path / "old.fmu")  # used again
        unpack(archive(tmp_path, "newer.fmu", 500))
        assert old.is_dir()
    finally:
        units._cache.cache_clear()


def test_without_a_cache_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache"), "TMPDIR": str(tmp_path / "tmp")}
    (tmp_path / "tmp").mkdir()
    command = [sys.executable, "-m", "cobot_joint", "run", "no_load", "--set", "stop_time=0.1", "--no-cache"]
    subprocess.run(command, cwd=tmp_path, env=environment, check=True, capture_output=True)
    assert not (tmp_path / "cache" / "cobot-joint").exists()
    assert [p for p in (tmp_path / "tmp").iterdir() if p.name.startswith("cobot-joint")] == []


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


def test_bounds_of_a_choice_are_its_values(fmu: Callable[[str], Path]) -> None:
    assert load_unit(fmu("motor_bldc")).bounds_of("motor.level") == (1, 5)


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


def test_work_through_a_flange_is_listed_for_integrators_and_no_state_of_the_motion() -> None:
    spring = load_unit(find_fmu("series_elastic.fmu"))
    listed = [unknown.variable.derivative.name for unknown in spring.description.derivatives]
    assert listed == [w for flange in spring.flanges for w in (flange.W, flange.W_abs)]
    assert spring.states == {}
    assert load_unit(find_fmu("planetary_gear.fmu")).states == {"phi_o": "der(phi_o)", "w_o": "der(w_o)", "z": "der(z)"}


def test_what_another_process_takes_away_meanwhile_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("kept", "gone"):
        (tmp_path / name).mkdir()
    whole = Path.is_dir

    def gone_at_once(place: Path) -> bool:
        there = whole(place)
        if place.name == "gone" and there:
            place.rmdir()
        return there

    monkeypatch.setattr(Path, "is_dir", gone_at_once)
    units._make_room(tmp_path)
    assert [place.name for place in tmp_path.iterdir()] == ["kept"]
