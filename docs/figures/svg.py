"""Pictures of results as SVG without a script, each with its title and what it shows in words.

A picture is 360 units wide, as a phone is, so that its letters stay legible there. Its colours are the page's style's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from pathlib import Path
from string import Template

from cobot_joint.diagnosis.evaluation.score import rate
from cobot_joint.results.figures import COLOUR, COLOURS

WIDTH, RIGHT, TOP, LINE, FOOT = 360, 14, 8, 15, 40
LETTER = 6.2  # width of a letter of a label
LEFT, TALL = 44, 190  # of a picture of shares
ROOM = 0.12  # share below which counts stand above their interval

# light: the colours that re-fitted and repaired have everywhere; dark: those of the palette that stand out there
PALETTE = {
    "before_light": COLOUR["calibrated"],
    "after_light": COLOUR["repaired"],
    "before_dark": COLOURS[4],
    "after_dark": COLOURS[5],
}


@dataclass(frozen=True)
class Row:
    """A case: its name, where the name leads, its figures, and whether its answer is wrong."""

    label: str
    link: str
    values: tuple[float, ...]
    wrong: bool = False


@dataclass(frozen=True)
class Share:
    """Of `n` findings with a confidence from `low` to `high`, `k` are true."""

    low: float
    high: float
    n: int
    k: int


@dataclass(frozen=True)
class Series:
    """A line through points: abscissa, ordinate, and what a point says where a pointer rests on it."""

    kind: str  # "after", "before", "band": its marks' style
    points: tuple[tuple[float, float, str], ...]


@dataclass(frozen=True)
class Axis:
    """From figures to places; `label`: quantity and unit."""

    label: str
    low: float
    high: float
    log: bool = False

    def at(self, value: float) -> float:
        """0 at its low end, 1 at its high end."""
        low, high, value = ((math.log(x) if self.log else x) for x in (self.low, self.high, value))
        return (value - low) / (high - low)

    def ticks(self) -> list[float]:
        """1, 2, 5, 10, ... on a logarithmic axis, else quarters."""
        if not self.log:
            return [self.low + n * (self.high - self.low) / 4 for n in range(5)]
        decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        steps = (1, 2, 5) if len(decades) < 5 else (1,)
        return [s * 10.0**d for d in decades for s in steps if self.low <= s * 10.0**d <= self.high]


def around(label: str, values: Sequence[float]) -> Axis:
    """A logarithmic axis with all of the values."""
    return Axis(label, min(values) / 1.3, max(values) * 1.3, log=True)


def from_zero(label: str, values: Sequence[float]) -> Axis:
    """A linear axis that ends at four round steps, so that a bar's length is its figure."""
    step = max(values) / 4
    decade = 10.0 ** math.floor(math.log10(step))
    return Axis(label, 0.0, 4 * decade * next(s for s in (1, 2, 2.5, 5, 10) if s * decade >= step))


def number(value: float) -> str:
    """To three digits, as people write it."""
    return f"{value:,.0f}" if value >= 1e3 else f"{value:.3g}"


def pairs(name: str, title: str, axis: Axis, rows: Sequence[Row], words: str) -> str:
    """Before (hollow) and after (full) of every case; on a logarithmic axis with a line at 1, the noise."""
    place = _Rows(axis, rows)

    def marks(row: Row, y: float) -> str:
        before, after = (place.x(value) for value in row.values)
        return line("way", before, y, after, y) + circle("before", before, y) + circle("after", after, y)

    noise = line("reference", place.x(1.0), TOP - 4, place.x(1.0), place.bottom) if axis.log else ""
    key = '<span class="before">○</span> before <span class="after">●</span> after' + (" ┆ noise" if axis.log else "")
    content = noise + place.content(marks, lambda row: "{} before, {} after".format(*map(number, row.values)))
    return picture(name, title, f"{words} {_extremes(rows, axis)}", place.height, content, key)


def bars(name: str, title: str, axis: Axis, rows: Sequence[Row], words: str) -> str:
    """One figure per case."""
    place = _Rows(axis, rows)

    def marks(row: Row, y: float) -> str:
        return rectangle("bar", place.left, y - 4, place.x(row.values[0]) - place.left, 8)

    content = place.content(marks, lambda row: number(row.values[0]))
    return picture(name, title, f"{words} {_extremes(rows, axis)}", place.height, content)


def dots(name: str, title: str, axis: Axis, rows: Sequence[Row], words: str) -> str:
    """Any number of figures per case."""
    place = _Rows(axis, rows)

    def marks(row: Row, y: float) -> str:
        return "".join(circle("after", place.x(value), y) for value in row.values)

    content = place.content(marks, lambda row: ", ".join(map(number, row.values)) or "none")
    return picture(name, title, f"{words} {_extremes(rows, axis)}", place.height, content)


def shares(name: str, title: str, found: Sequence[Share], words: str) -> str:
    """How often findings are true (dot, 95 % Wilson interval) against the confidence that they state (band)."""
    pitch = (WIDTH - RIGHT - LEFT) / len(found)
    marks = []
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        marks.append(line("grid", LEFT, _height(share), WIDTH - RIGHT, _height(share)))
        marks.append(text(LEFT - 6, _height(share) + 4, f"{100 * share:.0f}", anchor="end"))
    marks += [_column(share, LEFT + (n + 0.5) * pitch, pitch) for n, share in enumerate(found)]
    marks.append(text((LEFT + WIDTH - RIGHT) / 2, TOP + TALL + 34, "confidence stated [%]"))
    turned = f"translate(11 {TOP + TALL / 2:.0f}) rotate(-90)"
    marks.append(f'<text transform="{turned}" text-anchor="middle">found true [%]</text>')
    told = "; ".join(f"{s.low:g} to {s.high:g}: {s.k} of {s.n} true" for s in found if s.n)
    key = '<span class="band">■</span> stated <span class="after">●</span> true, with the 95 % interval of its share'
    return picture(name, title, f"{words} {told}.", TOP + TALL + FOOT, "".join(marks), key)


def curves(name: str, title: str, x: Axis, y: Axis, series: Sequence[Series], words: str, key: str) -> str:
    """Lines over two quantities."""
    low, high = 24 + LETTER * max(len(number(tick)) for tick in y.ticks()), WIDTH - RIGHT
    marks = []
    for tick in y.ticks():
        marks.append(line("grid", low, _height(y.at(tick)), high, _height(y.at(tick))))
        marks.append(text(low - 4, _height(y.at(tick)) + 4, number(tick), anchor="end"))
    for tick in x.ticks():
        across = low + x.at(tick) * (high - low)
        marks.append(line("grid", across, TOP, across, TOP + TALL) + text(across, TOP + TALL + 15, number(tick)))
    for each in series:
        placed = [(low + x.at(a) * (high - low), _height(y.at(b)), said) for a, b, said in each.points]
        marks += [line(f"way {each.kind}", *a[:2], *b[:2]) for a, b in pairwise(placed)]
        marks += [f"<g><title>{escape(said)}</title>{_mark(each.kind, a, b)}</g>" for a, b, said in placed]
    marks.append(text((low + high) / 2, TOP + TALL + 34, escape(x.label)))
    turned = f"translate(11 {TOP + TALL / 2:.0f}) rotate(-90)"
    marks.append(f'<text transform="{turned}" text-anchor="middle">{escape(y.label)}</text>')
    return picture(name, title, words, TOP + TALL + FOOT, "".join(marks), key)


def _mark(kind: str, x: float, y: float) -> str:
    return rectangle(kind, x - 4, y - 4, 8, 8) if kind == "band" else circle(kind, x, y)


def _height(share: float) -> float:
    return TOP + TALL * (1 - share)


def _column(share: Share, x: float, pitch: float) -> str:
    """The band of what is stated, what was counted, and the counts."""
    thick = max(TALL * (share.high - share.low), 2)
    band = rectangle("band", x - 0.38 * pitch, _height(share.high), 0.76 * pitch, thick)
    below = text(x, TOP + TALL + 15, f"{100 * share.low:g}–{100 * share.high:g}")
    counts = rate(share.k, share.n)
    if counts["ci95"] is None:
        none = text(x, _height(share.low) + 14, "none", kind="count")
        return f"<g><title>{share.low:g} to {share.high:g}: no finding</title>{band}{none}{below}</g>"
    low, high = counts["ci95"]
    said = f"{share.low:g} to {share.high:g}: {share.k} of {share.n} true, 95 % interval {low:g} to {high:g}"
    interval = line("interval", x, _height(low), x, _height(high)) + circle("after", x, _height(share.k / share.n))
    where = _height(low) + 12 if low > ROOM else _height(high) - 5
    count = text(x, where, f"{share.k}/{share.n}", kind="count")
    return f"<g><title>{said}</title>{band}{interval}{count}{below}</g>"


class _Rows:
    """Cases below one another, their names on the left, an axis below."""

    def __init__(self, axis: Axis, rows: Sequence[Row]) -> None:
        self.axis, self.rows = axis, rows
        self.left = round(14 + LETTER * max(len(row.label) + 2 * row.wrong for row in rows))
        self.bottom = TOP + LINE * len(rows) + 2
        self.height = self.bottom + FOOT

    def x(self, value: float) -> float:
        return self.left + self.axis.at(value) * (WIDTH - RIGHT - self.left)

    def content(self, marks: Callable[[Row, float], str], said: Callable[[Row], str]) -> str:
        """The axis, and of every case its name, its marks, and what they say where a pointer rests on them."""
        drawn = [self._axis()]
        for n, row in enumerate(self.rows):
            y = TOP + LINE * (n + 0.5)
            name = escape(row.label) + ('<tspan class="wrong"> ×</tspan>' if row.wrong else "")
            linked = f'<a href="{escape(row.link)}">{text(self.left - 8, y + 4, name, anchor="end")}</a>'
            drawn.append(f"<g><title>{escape(row.label)}: {said(row)}</title>{linked}{marks(row, y)}</g>")
        return "".join(drawn)

    def _axis(self) -> str:
        ticks = [
            line("grid", self.x(tick), TOP - 4, self.x(tick), self.bottom)
            + text(self.x(tick), self.bottom + 14, number(tick))
            for tick in self.axis.ticks()
        ]
        return "".join(ticks) + text((self.left + WIDTH - RIGHT) / 2, self.bottom + 32, escape(self.axis.label))


def line(kind: str, x1: float, y1: float, x2: float, y2: float) -> str:
    """SVG of a line."""
    return f'<line class="{kind}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def circle(kind: str, x: float, y: float) -> str:
    """SVG of a mark."""
    return f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="4"/>'


def rectangle(kind: str, x: float, y: float, width: float, height: float) -> str:
    """SVG of a bar or a band."""
    return f'<rect class="{kind}" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"/>'


def text(x: float, y: float, written: str, *, anchor: str = "middle", kind: str = "word") -> str:
    """SVG of letters; `written` is SVG already."""
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{written}</text>'


def _extremes(rows: Sequence[Row], axis: Axis) -> str:
    """The last figures of the least and the greatest case, in words."""
    least, most = (pick((r for r in rows if r.values), key=lambda r: r.values[-1], default=None) for pick in (min, max))
    if not (least and most):
        return ""
    said = f"least {number(least.values[-1])} ({least.label}), most {number(most.values[-1])} ({most.label})"
    return f"{axis.label}: {said}."


def picture(name: str, title: str, words: str, height: float, content: str, key: str = "") -> str:
    """A figure that a screen reader reads as its title and words."""
    key = f'<p class="key" aria-hidden="true">{key}</p>' if key else ""
    return (
        f'<figure class="result"><figcaption>{escape(title)}</figcaption>{key}<svg role="group" '
        f'aria-labelledby="{name}-title" aria-describedby="{name}-words" viewBox="0 0 {WIDTH} {height:.0f}">'
        f'<title id="{name}-title">{escape(title)}</title><desc id="{name}-words">{escape(words)}</desc>'
        f"{content}</svg></figure>"
    )


def style() -> str:
    """The style sheet, with the project's palette."""
    return Template((Path(__file__).parent / "style.css").read_text(encoding="utf-8")).substitute(PALETTE)
