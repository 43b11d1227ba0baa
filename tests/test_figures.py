"""The pages of figures: what they show is what the project's functions make of the answers that are kept."""

from __future__ import annotations

import io
import json
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
from lxml import html
from rich.console import Console

from benchmarks.__main__ import show
from benchmarks.measure import Row
from cobot_joint.diagnosis.evaluation.prove import cases_of
from cobot_joint.diagnosis.evaluation.score import rate, scoreboard
from cobot_joint.diagnosis.selection.confidence import COUNTED, COUNTED_BESIDE
from cobot_joint.results.figures import COLOURS

ROOT = Path(__file__).parents[1]
PROOF = ROOT / "proof"
sys.path.append(str(ROOT / "docs"))  # as mkdocs does for its hook

from figures import benchmarks, proof, reliability, svg  # noqa: E402

SETS = [name for name in proof.SETS if list((PROOF / name).glob("*/diagnosis.json"))]


@pytest.fixture(scope="module")
def pages() -> dict[str, html.HtmlElement]:
    written = {"proof": proof.page(ROOT), "reliability": reliability.page(ROOT), "benchmarks": benchmarks.page(ROOT)}
    return {name: html.fromstring(f"<main>{text}</main>") for name, text in written.items()}


@pytest.fixture
def sealed(tmp_path: Path) -> Path:
    """A copy of the sealed set's answers that a test may change."""
    kept = shutil.ignore_patterns("*.parquet", "*.ssd")
    return Path(shutil.copytree(PROOF / "sealed", tmp_path / "sealed", ignore=kept))


def cards(page: html.HtmlElement) -> list[dict[str, str]]:
    """Of every set: what is on its cards."""
    return [
        {card.find("dt").text_content(): card.find("dd/b").text_content() for card in row.iterfind("div")}
        for row in page.iterfind(".//dl")
    ]


def change(path: Path, **values: object) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


def test_the_cards_of_the_sealed_set_are_its_scoreboard(pages: dict[str, html.HtmlElement]) -> None:
    found = scoreboard(json.loads((PROOF / "sealed/answers.json").read_text()), PROOF / "sealed")["summary"]
    shown = cards(pages["proof"])[SETS.index("sealed")]
    assert shown["right"] == "{k} of {n}".format(**found["right"])
    assert shown["false claims"] == "{k} of {n}".format(**found["false_claims"])
    assert shown["error above noise removed, median"] == f"{100 * found['excess_error_removed_median']:.2f} %"
    assert shown["Brier score"] == f"{found['brier']:.3f}"


def test_the_outcomes_that_are_drawn_are_those_of_the_scoreboard() -> None:
    _, score = proof.read(PROOF / "sealed")
    assert score
    counts = re.findall(r"<title>[^<]*: (\d+) of (\d+) true", proof.outcomes("sealed", "outcomes", score["rows"]))
    claims = [c for row in score["rows"] for c in row["conf"]]
    assert sum(int(k) for k, _ in counts) == sum(true for _, true in claims)
    assert sum(int(n) for _, n in counts) == len(claims)


def test_the_counts_that_are_drawn_are_those_that_reports_quote() -> None:
    drawn = reliability.counted()
    for (low, high), n, k in COUNTED:
        interval = rate(k, n)["ci95"]
        said = f"{k} of {n} true, 95 % interval {interval[0]:g} to {interval[1]:g}" if n else "no finding"
        assert f"<title>{low:g} to {min(high, 1):g}: {said}</title>" in drawn


def test_the_count_beside_backgrounds_that_reports_quote_is_that_of_the_docs() -> None:
    told = (ROOT / "docs" / "diagnosis-calibration.md").read_text(encoding="utf-8")
    bands = re.search(r"0.5 to 0.9 was said (\d+) of (\d+) were true.*more was said (\d+) of (\d+)", told)
    assert bands
    true_mid, mid, true_most, most = map(int, bands.groups())
    assert (mid + most, true_mid + true_most) == COUNTED_BESIDE


@pytest.mark.parametrize("name", SETS)
def test_every_answer_has_a_row(pages: dict[str, html.HtmlElement], name: str) -> None:
    rows = [row.get("id") for row in pages["proof"].iterfind(".//tr[@id]")]
    answered = [case for case in cases_of(PROOF / name) if (PROOF / name / case / "diagnosis.json").exists()]
    assert [row for row in rows if row in {f"{name}-{case}" for case in answered}] == [f"{name}-{c}" for c in answered]


@pytest.mark.parametrize("file", ["verify.json", "diagnosis.json"])
def test_a_changed_result_changes_its_picture(sealed: Path, file: str) -> None:
    before = proof.of_set(sealed)
    figures = json.loads((sealed / "case02" / file).read_text())
    if file == "verify.json":
        figures["channels"]["w_motor"]["repaired"] *= 2
    else:
        figures["seconds"] *= 2
    change(sealed / "case02" / file, **figures)
    after = proof.of_set(sealed)
    svgs = [re.findall(r"<svg.*?</svg>", text, flags=re.S) for text in (before, after)]
    assert [a != b for a, b in zip(*svgs, strict=True)] == [file == "verify.json", file == "diagnosis.json", False]


def test_an_answer_that_becomes_wrong_is_marked(sealed: Path) -> None:
    """in both pictures of cases, and in the table"""
    before = proof.of_set(sealed).count("×")
    change(sealed / "case02" / "diagnosis.json", findings=[])
    assert proof.of_set(sealed).count("×") == before + 3


def test_what_is_right_is_not_told_while_the_truths_are_not_published(sealed: Path) -> None:
    (sealed / "answers.json").unlink()
    page = html.fromstring(f"<main>{proof.of_set(sealed)}</main>")
    assert "right" not in cards(page)[0]
    assert "not published yet" in page.text_content()


def test_machines_with_a_background_are_scored_by_their_own_rules(sealed: Path) -> None:
    truths = json.loads((sealed / "answers.json").read_text())
    for truth in truths.values():
        truth["style"] = "spring"
        truth["effects"] = [effect | {"over_background": 1.0} for effect in truth["effects"]]
    (sealed / "answers.json").write_text(json.dumps(truths))
    assert "better on held-out runs" in cards(html.fromstring(f"<main>{proof.of_set(sealed)}</main>"))[0]


def test_a_set_without_answers_says_so(sealed: Path) -> None:
    for answer in sealed.glob("*/diagnosis.json"):
        answer.unlink()
    assert "No answers are kept here" in proof.of_set(sealed)


@pytest.fixture(scope="module")
def measured() -> list[dict[str, Any]]:
    """Every row of the benchmarks that is kept."""
    files = [ROOT / "benchmarks" / "measured" / f"{group}.json" for group in benchmarks.GROUPS]
    return [row for file in files for row in json.loads(file.read_text())["rows"]]


def test_every_row_of_the_benchmarks_is_in_their_table(
    pages: dict[str, html.HtmlElement], measured: list[dict[str, Any]]
) -> None:
    shown = [[cell.text_content() for cell in row.iterfind("td")] for row in pages["benchmarks"].iterfind(".//tr")]
    assert [row[:2] for row in shown if row] == [[r["title"] + r["note"], benchmarks.figure(r)] for r in measured]


def test_every_master_has_a_row_and_every_run_a_point(
    pages: dict[str, html.HtmlElement], measured: list[dict[str, Any]]
) -> None:
    masters, points = pages["benchmarks"].iterfind(".//svg")
    assert len(masters.findall(".//g")) == sum(bool(benchmarks.PEER.fullmatch(row["title"])) for row in measured)
    runs = benchmarks.points(ROOT / "benchmarks" / "measured")
    assert len(points.findall(".//g")) == len(runs) > 20


def test_the_table_of_the_benchmarks_page_is_what_show_prints(measured: list[dict[str, Any]]) -> None:
    """python -m benchmarks --show --out benchmarks/measured, 118 columns wide"""
    told = Console(file=io.StringIO(), width=118)
    show([Row(**row) for row in measured], told)
    printed = [line.rstrip() for line in told.file.getvalue().splitlines()]  # type: ignore[attr-defined]
    page = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8").partition("```text\n")[2].partition("```")[0]
    assert [line.rstrip() for line in page.splitlines()] == printed


def test_every_picture_has_a_title_and_its_figures_in_words(pages: dict[str, html.HtmlElement]) -> None:
    pictures = [picture for page in pages.values() for picture in page.iter("svg")]
    assert len(pictures) >= 3 * len(SETS) + 2
    for picture in pictures:
        texts = {e.get("id"): e.text_content() for e in picture.iter("title", "desc") if e.get("id")}
        assert texts[picture.get("aria-labelledby")]
        assert re.search(r"\d", texts[picture.get("aria-describedby")])


def test_every_axis_names_its_quantity(pages: dict[str, html.HtmlElement]) -> None:
    """and its unit, but for confidences from 0 to 1"""
    for picture in (p for page in pages.values() for p in page.iter("svg")):
        words = [text.text_content() for text in picture.iter("text")]
        assert any(re.fullmatch(r".+ \[.+\]", word) or word == "confidence stated" for word in words)


def test_the_colours_are_of_the_projects_palette() -> None:
    style = svg.style()
    assert "$" not in style
    assert set(svg.PALETTE.values()) <= set(COLOURS)
    assert set(svg.PALETTE.values()) == set(re.findall(r"--(?:before|after): (#\w+)", style))


def test_a_bar_starts_at_zero_and_ends_within_its_axis() -> None:
    for most in (0.7, 3.0, 88.4, 701.6, 1402.0):
        axis = svg.from_zero("time [s]", [most])
        assert axis.low == 0
        assert 0.4 < axis.at(most) <= 1
