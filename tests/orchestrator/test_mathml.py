"""Equations typeset: as they are written, and nothing of their mathematics stays plain."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from lxml import etree

from cobot_joint.mathml import typeset, typeset_page

FMUS = Path(__file__).parents[2] / "fmus"
TABLES = sorted([*FMUS.glob("*/model.def"), FMUS / "friction/friction.def"])
ROW = re.compile(r'^(?:PART|TERM)\((\w+),\s*"[^"]*",\s*"([^"]*)"', flags=re.M)
EQUATIONS = [
    (f"{table.parent.name}.{name}", equation)
    for table in TABLES
    for name, equation in ROW.findall(re.sub(r'"\s*\n\s*"', "", table.read_text(encoding="utf-8")))
]


def shape(e: etree._Element) -> str:
    """Elements and texts on one line, rows without their name."""
    inside = [shape(child) for child in e if child.tag != "mspace"]
    text = " ".join([e.text] if e.text else inside)
    return text if e.tag in ("mi", "mn", "mo", "mtext", "mrow", "math") else f"{e.tag[1:]}({text})"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("tau = -d*w", "τ = − d w"),
        ("a - (b - c)", "a − ( b − c )"),
        ("(a + b)*c", "( a + b ) c"),
        ("a/(b + c)", "frac(a b + c)"),
        ("(w/w_S)^2", "sup(( frac(w sub(w S)) ) 2)"),
        ("J_o*dw_o/dt", "sub(J o) frac(d sub(w o) d t)"),
        ("d(stretch)/dt", "frac(d stretch d t)"),
        ("d_g*ddelta", "sub(d g) over(δ ˙)"),
        ("delta -+ b/2", "δ ∓ frac(b 2)"),
        ("clamp(i, +-i_max)", "clamp \u2061 ( i , ± sub(i max) )"),
        ("sqrt(1 - rho^2)", "sqrt(1 − sup(ρ 2))"),
        ("abs(x) + |y|", "| x | + | y |"),
        ("-p_1 < p <= 0", "− sub(p 1) < p ≤ 0"),
        ("tau_b_add", "sub(τ b,add)"),
    ],
)
def test_mathematics_is_written_as_it_is_read(text: str, expected: str) -> None:
    assert shape(etree.fromstring(typeset(text))) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("y = x before t", "# before #"),
        ("slip grows by one tooth, pi/abs(N), at most", "slip grows by one tooth, #, at most"),
        ("a = 1: no error in a reading", "#: no error in a reading"),
        ("Dahl's model at 2 < 3 & more", "Dahl's model at # &amp; more"),
        ("", ""),
        ("a)(b = * <c> ", "a)(b = * &lt;c&gt; "),
    ],
)
def test_words_stay_words(text: str, expected: str) -> None:
    assert re.sub("<math>.*?</math>", "#", typeset(text)) == expected


@pytest.mark.parametrize(("name", "equation"), EQUATIONS, ids=[name for name, _ in EQUATIONS])
def test_no_mathematics_of_a_unit_stays_plain(name: str, equation: str) -> None:
    words = re.sub("<math>.*?</math>", "", typeset(equation))
    assert not re.search(r"[=*/^_+()|<>&]|\d", words.replace("sublinear_viscous", "")), words


def without_brackets(text: str) -> str:
    return re.sub(r"[()\u2061]", "", text.replace("−", "-"))


@pytest.mark.parametrize("text", ["(" * 1500, "sin(" * 400 + "x" + ")" * 400, "-" * 1500 + "x", "<x>" * 10000])
def test_what_a_foreign_unit_writes_is_shown_whatever_it_is(text: str) -> None:
    shown = etree.fromstring(f"<p>{typeset(text)}</p>", etree.XMLParser(huge_tree=True))
    assert without_brackets("".join(shown.itertext())) == without_brackets(text)


def test_every_unit_has_equations_to_typeset() -> None:
    assert {name.partition(".")[0] for name, _ in EQUATIONS} == {table.parent.name for table in TABLES}


def test_a_page_has_its_equations_typeset_each_on_its_own_line_and_nothing_else_changed() -> None:
    before = '<h3>a</h3>\n<p class="equation"><code>a &lt; b; by 2 at most</code></p>\n<p><code>c = d</code></p>'
    typed = f"{typeset('a < b')}<br>\nby {typeset('2')} at most"
    assert typeset_page(before) == f'<h3>a</h3>\n<p class="equation">{typed}</p>\n<p><code>c = d</code></p>'


def test_an_equation_that_may_be_wider_than_a_phone_is_reached_by_the_keyboard() -> None:
    long = " + ".join(30 * ["a"])
    assert 'tabindex="0"' in typeset_page(f'<p class="equation"><code>{long}</code></p>')
