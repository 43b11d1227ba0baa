"""Equations as the units' tables write them (`tau = tau_g/N + d*w at rest`), typeset in MathML, which browsers draw.

Mathematics is written as in C, with `^` for powers, `+-` and `-+` for both signs, and `dx/dt` or `dx` for rates. The
rest stays words.

The build runs it as a script over a unit's reference page, `mathml.py PAGE`, so that it imports nothing of the package.
"""

from __future__ import annotations

import html
import re
import sys
from pathlib import Path

GREEK = {
    "alpha": "α", "delta": "δ", "eta": "η", "mu": "μ", "omega": "ω", "phi": "φ", "pi": "π", "rho": "ρ", "sigma": "σ",
    "tau": "τ",
}  # fmt: skip
RELATION, SUM, PRODUCT, POWER, ATOM = range(5)  # how tightly an expression holds together
BINARY = {
    **dict.fromkeys(("=", "<", ">", "<=", ">="), RELATION),
    **dict.fromkeys(("+", "-", "+-", "-+"), SUM),
    **dict.fromkeys(("*", "/"), PRODUCT),
    "^": POWER,
}
PRINTED = {"-": "−", "+-": "±", "-+": "∓", "<": "&lt;", ">": "&gt;", "<=": "≤", ">=": "≥", "...": "…"}
TOKEN = re.compile(r"\.\.\.|\d+(?:\.\d+)?(?: degC)?|[A-Za-z]\w*(?:'s)?|\+-|-\+|[<>]=|\S")
NO_SYMBOLS = frozenset({"and", "at", "by", "for", "from", "if", "in", "is", "of", "or", "to", "where", "while", "with"})
RATE = re.compile(rf"d([A-Za-z]|{'|'.join(GREEK)})(?=_|$)")
DEEPEST = 50  # brackets in brackets; what a foreign unit writes may be anything
LONGEST = 2000
EQUATION = re.compile(r'<p class="equation"><code>(.*?)</code>')
WIDE = 60  # letters of an equation that may not fit on a phone; then it is scrolled, by keyboard too
Node = tuple  # (kind or operator, what it holds...)


def typeset(text: str) -> str:
    """HTML of an equation: its mathematics as MathML, its words, and what cannot be read, as they are."""
    tokens = [*TOKEN.finditer(text)] if len(text) <= LONGEST else []
    parts, n, end = [], 0, 0
    while n < len(tokens):
        reader = _Reader(tokens, n)
        try:
            node = reader.expression()
            mathematics = node[0] != "name" or _is_symbol(node[1])
        except _NoMathematicsError:
            mathematics = False
        parts.append(text[end : tokens[n].start()])
        parts.append(f"<math>{_write(node)}</math>" if mathematics else html.escape(tokens[n][0], quote=False))
        n = reader.at if mathematics else n + 1
        end = tokens[n - 1].end()
    return "".join([*parts, html.escape(text[end:], quote=False)])


def typeset_page(page: str) -> str:
    """HTML of a reference page with its equations typeset, each on a line of its own."""

    def lines(equation: re.Match[str]) -> str:
        parts = [part.strip() for part in html.unescape(equation[1]).split(";")]
        focus = ' tabindex="0"' if max(map(len, parts)) > WIDE else ""
        return f'<p class="equation"{focus}>' + "<br>\n".join(typeset(part) for part in parts)

    return EQUATION.sub(lines, page)


def _is_symbol(name: str) -> bool:
    """Whether a name that stands alone is a quantity, and no word."""
    head = name.partition("_")[0]
    return name != "a" and (head in GREEK or bool(re.fullmatch(r"[A-Za-z]\d*", head)))


class _NoMathematicsError(Exception):
    """Here begins no mathematics."""


class _Reader:
    """Reads an expression, as far as it goes; `at` is the token behind it."""

    def __init__(self, tokens: list[re.Match[str]], at: int) -> None:
        self.tokens, self.at, self.depth = tokens, at, 0

    def token(self) -> str:
        return self.tokens[self.at][0] if self.at < len(self.tokens) else ""

    def take(self, expected: str = "") -> str:
        token = self.token()
        if not token or (expected and token != expected):
            raise _NoMathematicsError
        self.at += 1
        return token

    def expression(self, loosest: int = RELATION) -> Node:
        """All that holds together at least that tightly; operators of one kind from left to right."""
        self.depth += 1
        left = self.operand()
        self.depth -= 1
        while BINARY.get(self.token(), -1) >= loosest:
            operator = self.take()
            left = (operator, left, self.expression(BINARY[operator] + 1))
        return left

    def operand(self) -> Node:
        token = self.take()
        if self.depth > DEEPEST:
            raise _NoMathematicsError
        if token in ("+", "-", "+-", "-+"):
            return ("sign", token, self.expression(PRODUCT))
        if token in ("(", "|"):
            inside = self.expression()
            self.take(")" if token == "(" else "|")
            return inside if token == "(" else ("call", "abs", [inside])
        if token == "..." or token[0].isdigit():
            return ("number", token)
        if not token[0].isalpha() or token in NO_SYMBOLS or "'" in token:
            raise _NoMathematicsError
        if self.token() == "(" and self.tokens[self.at].start() == self.tokens[self.at - 1].end():
            return ("call", token, self.arguments())
        return ("name", token)

    def arguments(self) -> list[Node]:
        self.take("(")
        found = [self.expression()]
        while self.token() == ",":
            self.take()
            found.append(self.expression())
        self.take(")")
        return found


def _write(node: Node, needed: int = RELATION) -> str:
    """MathML of an expression as one element; in brackets where it holds together less tightly than needed."""
    kind, *held = node
    if kind == "name":
        return _name(held[0])
    if kind == "number":
        return f"<mn>{PRINTED.get(held[0], held[0].replace(' degC', ' °C'))}</mn>"
    if kind == "call":
        return _call(*held)
    if kind == "/" and (rate := _rate(*held)):
        return rate
    if kind == "/":
        written, tightness = f"<mfrac>{_write(held[0])}{_write(held[1])}</mfrac>", PRODUCT
    elif kind == "^":
        written, tightness = f"<msup>{_write(held[0], ATOM)}{_write(held[1])}</msup>", POWER
    elif kind == "*":
        times = "<mo>⋅</mo>" if held[1][0] == "number" else '<mspace width="0.2em"/>'
        written, tightness = _write(held[0], PRODUCT) + times + _write(held[1], PRODUCT), PRODUCT
    elif kind == "sign":
        written, tightness = f"<mo>{PRINTED.get(held[0], held[0])}</mo>{_write(held[1], PRODUCT)}", SUM
    else:
        tightness = BINARY[kind]
        sides = _write(held[0], tightness), _write(held[1], tightness + 1)
        written = f"<mo>{PRINTED.get(kind, kind)}</mo>".join(sides)
    return f"<mrow>{written}</mrow>" if tightness >= needed else _fenced("(", written, ")")


def _fenced(left: str, written: str, right: str) -> str:
    size = "" if "<mfrac>" in written else ' stretchy="false"'
    return f"<mrow><mo{size}>{left}</mo>{written}<mo{size}>{right}</mo></mrow>"


def _call(function: str, arguments: list[Node]) -> str:
    inside = "<mo>,</mo>".join(_write(a) for a in arguments)
    if function == "sqrt":
        return f"<msqrt>{inside}</msqrt>"
    if function == "abs":
        return _fenced("|", inside, "|")
    if function == "integral":
        return f"<mrow><mo>∫</mo>{_fenced('(', inside, ')')}<mi>d</mi><mi>t</mi></mrow>"
    return f"<mrow>{_name(function)}<mo>&#x2061;</mo>{_fenced('(', inside, ')')}</mrow>"


def _rate(above: Node, below: Node) -> str | None:
    """`J*dw/dt` and `d(rise)/dt` as a derivative over time; None: it is none."""
    if below != ("name", "dt"):
        return None
    kind, *held = above
    if kind == "*" and (last := _rate(held[1], below)):
        return f'<mrow>{_write(held[0], PRODUCT)}<mspace width="0.2em"/>{last}</mrow>'
    if kind == "call" and held[0] == "d":
        of = f'<mspace width="0.15em"/>{_write(held[1][0])}'
    elif kind == "name" and RATE.match(held[0]):
        of = _name(held[0][1:])
    else:
        return None
    return f"<mfrac><mrow><mi>d</mi>{of}</mrow><mrow><mi>d</mi><mi>t</mi></mrow></mfrac>"


def _name(name: str) -> str:
    """`tau_b_add` with its subscripts; `ddelta`, which stands alone, with a dot."""
    dotted = bool(RATE.match(name))
    head, *below = name[dotted:].split("_")
    if numbered := re.fullmatch(r"([A-Za-z])(\d+)", head):
        head, below = numbered[1], [numbered[2], *below]
    symbol = f"<mi>{GREEK.get(head, head)}</mi>"
    if dotted:
        symbol = f"<mover>{symbol}<mo>˙</mo></mover>"
    if not below:
        return symbol
    return f"<msub>{symbol}<mtext>{','.join(GREEK.get(part, part) for part in below)}</mtext></msub>"


if __name__ == "__main__":
    given = Path(sys.argv[1])
    given.write_bytes(typeset_page(given.read_bytes().decode("utf-8")).encode("utf-8"))
