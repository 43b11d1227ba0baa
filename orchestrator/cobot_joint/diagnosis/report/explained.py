"""What the report's words mean and where its equations come from, as the pages docs/glossary.md and docs/references.md
have them: each is said there alone.
"""

from __future__ import annotations

import re
import unicodedata
from functools import cache

from markupsafe import Markup, escape

from cobot_joint import paths

WORD = re.compile(r"^\| (?!word \|)([^|`-][^|]*) \| ([^|]+) \| [^|]+ \|$", flags=re.M)
WORK = re.compile(r"^- (?P<author>[^,*]+), .+?\((?P<year>\d{4})\)\. .+?(?= - |$)", flags=re.M)
THESIS = re.compile(r"^## The thesis\n\n(?P<title>\*.+?\*\.)", flags=re.M)


def glossary(text: str) -> list[tuple[str, Markup]]:
    """The glossary's words that occur in a page of HTML, and what they mean, in the glossary's order."""
    shown = re.sub(r"<(script|style)\b.*?</\1>|<[^>]+>", " ", text, flags=re.S)
    return [(words, meaning) for words, said, meaning in _words() if said.search(shown)]


def cited(source: str) -> Markup:
    """A term's source: works that are cited link to themselves, and stand below it in full."""
    said, full = escape(source), []
    for name, entry, link in _works():
        found = name.search(_plain(str(said)))
        if found:
            full.append(entry)
        if found and link:
            start, end = found.span()
            said = said[:start] + Markup('<a href="{}">{}</a>').format(link, said[start:end]) + said[end:]
    return Markup("<br>").join([said, *full])


@cache
def _words() -> list[tuple[str, re.Pattern[str], Markup]]:
    rows = WORD.findall((paths.folder("docs") / "glossary.md").read_text(encoding="utf-8"))
    return [(words, _any_of(words.split(", ")), _markup(meaning)) for words, meaning in rows]


def _any_of(words: list[str]) -> re.Pattern[str]:
    return re.compile(rf"(?<!\w)({'|'.join(map(re.escape, words))})s?(?!\w)", flags=re.I)


@cache
def _works() -> list[tuple[re.Pattern[str], Markup, str | None]]:
    """How a source names a work, the work in full, and its address if it has one."""
    page = (paths.folder("docs") / "references.md").read_text(encoding="utf-8")
    thesis = THESIS.search(page)
    assert thesis, "docs/references.md does not say what the thesis is"
    works: list[tuple[re.Pattern[str], Markup, str | None]] = [
        (re.compile(r"\bthesis\b"), _markup(f"The thesis: {thesis['title']}"), None)
    ]
    for work in WORK.finditer(page):
        name = re.compile(rf"\b{re.escape(_plain(work['author']))}\b[^;\d]* {work['year']}\b")
        link = re.search(r"<(https://[^>]+)>", work[0])
        works.append((name, _markup(work[0].removeprefix("- ")), link and link[1]))
    return works


def _plain(text: str) -> str:
    """The same letters, and as many, without accents."""
    return "".join(unicodedata.normalize("NFD", letter)[0] for letter in text)


def _markup(text: str) -> Markup:
    """Code, emphasis and addresses of Markdown."""
    shown = str(escape(text))
    shown = re.sub(r"`(.+?)`", r"<code>\1</code>", shown)
    shown = re.sub(r"\*(.+?)\*", r"<em>\1</em>", shown)
    return Markup(re.sub(r"&lt;(https://\S+?)&gt;", r'<a href="\1">\1</a>', shown))
