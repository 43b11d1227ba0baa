"""The report explains the words that it has, and names its sources in full, as the pages have them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from lxml import html

from cobot_joint.diagnosis.report.explained import cited, glossary
from cobot_joint.units import find_fmu, load_unit
from tests.orchestrator.diagnosis.report.test_report import FINDING, data, render

ROOT = Path(__file__).parents[4]
PAGE = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
SOURCES = {
    term.source
    for unit in ROOT.glob("fmus/*/model.def")
    for term in load_unit(find_fmu(f"{unit.parent.name}.fmu")).terms
}


def test_only_words_that_occur_are_explained() -> None:
    said = "<p>A <b>channel</b> of two set-ups.</p><script>campaign</script><i title='onset'>detuned</i>"
    assert [word for word, _ in glossary(said)] == ["set-up", "channel"]


def test_every_word_of_the_glossary_can_be_explained() -> None:
    rows = re.findall(r"^\| ([^|`]+) \| [^|]+ \| [^|]+ \|$", PAGE, flags=re.M)
    first = [row for row in rows if row != "word" and not row.startswith("---")]
    assert [word for word, _ in glossary(" ".join(first))] == first


def test_the_report_ends_with_its_words_as_the_glossary_has_them() -> None:
    root = html.fromstring(render(data("explained", [FINDING])))
    last = root.findall(".//details")[-1]
    shown = {dt.text_content(): dt.getnext().text_content() for dt in last.iterfind(".//dt")}
    assert {"nominal", "calibrated", "noise, σ"} <= set(shown)
    assert "campaign" not in shown
    for word, meaning in shown.items():
        assert f"| {word} | {meaning} |" in PAGE.replace("`", "")
        assert root.text_content().count(meaning) == 1


@pytest.mark.parametrize(
    ("source", "link", "entry"),
    [
        ("Cross 1965, J. Colloid Sci. 20(5)", "https://doi.org/10.1016/0095-8522(65)90022-X", "Rheology of non-Newt"),
        (
            "Armstrong-Helouvry, Dupont and Canudas de Wit 1994",
            "https://doi.org/10.1016/0005-1098(94)90209-7",
            "A survey",
        ),
        ("Dahl 1968; Canudas de Wit et al. 1995, IEEE", "https://doi.org/10.1109/9.376053", "A new model for control"),
        ("Pelchen et al. 2002, Modelica conference", None, "Modeling and simulating the efficiency of gearboxes"),
        ("thesis Table 3.2 row 9", None, "Light-Weight Collaborative Robots"),
    ],
)
def test_a_source_is_linked_and_stands_there_in_full(source: str, link: str | None, entry: str) -> None:
    shown = html.fromstring(f"<p>{cited(source)}</p>")
    assert shown.text_content().startswith(source)
    assert entry in shown.text_content()
    assert [a.get("href") for a in shown.iterfind("a")] == ([link, link] if link else [])


def test_every_work_that_a_term_cites_by_year_is_among_the_references() -> None:
    by_year = {source for source in SOURCES if re.search(r"[a-z] (19|20)\d\d\b", source)}
    assert by_year
    assert {source for source in by_year if "<br>" not in cited(source)} == set()


def test_a_source_is_text_whatever_it_says() -> None:
    assert cited("<script>alert(1)</script>") == "&lt;script&gt;alert(1)&lt;/script&gt;"
