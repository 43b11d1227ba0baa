"""docs/equations.md: a row for every equation of the thesis, and every row holds."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/equations.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (\d\.\d+) \| (.+?) \| (.+?) \| (.+?) \|$", PAGE, flags=re.M)
LAST = {2: 32, 3: 3, 4: 7}  # the thesis's last equation of each chapter


def test_every_equation_of_the_thesis_has_one_row_in_its_order() -> None:
    assert [number for number, *_ in ROWS] == [f"{c}.{n}" for c, last in LAST.items() for n in range(1, last + 1)]


@pytest.mark.parametrize(("number", "where"), [(row[0], row[2]) for row in ROWS])
def test_what_a_row_names_is_there_or_it_says_why_not(number: str, where: str) -> None:
    parts = re.findall(r"`([a-z_]+)\.([a-z_0-9]+)`", where)
    files = re.findall(r"\]\((.+?)\)", where)
    assert parts or files or where.startswith("not "), f"eq. {number} is nowhere"
    for unit, part in parts:
        table = (ROOT / "fmus" / unit / "model.def").read_text(encoding="utf-8")
        table += (ROOT / "fmus/friction/friction.def").read_text(encoding="utf-8") if "friction.def" in table else ""
        assert re.search(rf"^(PART|TERM)\({part},", table, flags=re.M), f"eq. {number}: {unit} has no part {part}"
    for file in files:
        assert (ROOT / "docs" / file).is_file(), f"eq. {number}: there is no {file}"
    if where.startswith("not "):
        assert ":" in where, f"eq. {number}: no reason is given"


def test_every_row_s_test_is_there() -> None:
    tests = {
        name
        for file in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", file.read_text(encoding="utf-8"), flags=re.M)
    }
    named = {number: re.findall(r"`(test_\w+)`", check) for number, *_, check in ROWS}
    assert not [number for number, names in named.items() if not names]
    assert not {name for names in named.values() for name in names} - tests
