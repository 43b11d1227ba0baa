"""Whatever a system or an FMU says, it is loaded or refused in one line; so is every file of the corpus."""

from __future__ import annotations

import re
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cobot_joint import paths, units
from cobot_joint.system import load_system
from cobot_joint.units import find_fmu, load_unit

Refusal = Callable[..., str]
CORPUS = sorted((Path(__file__).parent / "corpus" / "systems").iterdir())
SYSTEM = (paths.folder("systems") / "joint.ssd").read_text(encoding="utf-8")
HOSTILE = st.sampled_from(["", "0", "-1", "nan", "inf", "1e400", "../../x", "/dev/null", "a%00b", "9" * 40,
                           "motor_bldc", "true", "N.m", "\u202e", "planetary_gear.fmu", "&#7;"])  # fmt: skip
ATTRIBUTE = re.compile(r'"[^"]*"')
TAG = re.compile(r"<[^>]*>")


@st.composite
def changed(draw: st.DrawFn, text: str) -> str:
    """XML with a few attributes that say something else, tags left out or twice, or bytes cut away."""
    for _ in range(draw(st.integers(1, 3))):
        pattern = draw(st.sampled_from([ATTRIBUTE, ATTRIBUTE, ATTRIBUTE, TAG]))
        places = list(pattern.finditer(text))
        if not places:
            return text
        place = places[draw(st.integers(0, len(places) - 1))]
        other = '"' + draw(HOSTILE) + '"' if pattern is ATTRIBUTE else draw(st.sampled_from(["", place[0] * 2]))
        text = text[: place.start()] + other + text[place.end() :]
    return text[: draw(st.integers(0, len(text)))] if draw(st.integers(0, 9)) == 0 else text


@given(text=changed(SYSTEM))
def test_any_description_is_loaded_or_refused(refusal: Refusal, text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "system.ssd"
        path.write_text(text, encoding="utf-8")
        assert "\n" not in refusal(load_system, path)


@pytest.mark.parametrize("path", CORPUS, ids=lambda p: p.name)
def test_systems_that_once_were_trouble_are_refused(refusal: Refusal, path: Path) -> None:
    assert re.fullmatch(r"[^\n]+", refusal(load_system, path))


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Hundreds of FMUs that nobody wants to keep."""
    units._cache.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COBOT_JOINT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
    units._cache.cache_clear()


DESCRIPTION = zipfile.ZipFile(find_fmu("torque_sensor.fmu")).read("modelDescription.xml").decode()


@given(text=changed(DESCRIPTION))
def test_any_model_description_is_loaded_or_refused(refusal: Refusal, text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.fmu"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", text)
        assert "\n" not in refusal(load_unit, path)


@given(data=st.data())
def test_any_archive_is_unpacked_or_refused(refusal: Refusal, data: st.DataObject) -> None:
    """Bytes of a whole one changed: of names, sizes, flags, methods, offsets."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.fmu"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("modelDescription.xml", DESCRIPTION[:3000])
            archive.writestr("resources/a.txt", "a" * 100)
        content = bytearray(path.read_bytes())
        for _ in range(data.draw(st.integers(1, 6))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        path.write_bytes(content)
        assert "\n" not in refusal(load_unit, path)
