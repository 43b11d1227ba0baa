"""The units' reference pages in Chromium: axe finds nothing, and a phone shows all of them."""

from __future__ import annotations

from typing import Any

import pytest

from tests.browser import PHONE, WIDE, fits, found_by_axe
from tests.fmus.test_every_unit import UNITS, Load

pytestmark = pytest.mark.long


@pytest.mark.parametrize(("size", "scheme"), [(PHONE, "light"), (WIDE, "dark")], ids=["phone", "wide"])
@pytest.mark.parametrize("name", UNITS)
def test_axe_finds_nothing_in_a_units_page_and_nothing_is_cut_off(
    chromium: Any, load: Load, name: str, size: dict[str, int], scheme: str
) -> None:
    page = chromium.new_context(viewport=size, color_scheme=scheme).new_page()
    page.goto((load(name).directory / "documentation/index.html").as_uri())
    assert found_by_axe(page) == []
    assert fits(page)
