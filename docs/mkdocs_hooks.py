"""The site has the repository's own paths, so that a link that works in one works in the other; beside them it has
pages of the units, made from their FMUs, of the Python interface, made from its docstrings, and of results, made from
the answers that are kept.
"""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from typing import Any

from figures import benchmarks, proof, reliability, svg
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import cobot_joint
from cobot_joint.mathml import typeset
from cobot_joint.units import fmu_directories

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("*.md", "benchmarks/README.md", "docs/**/*.md")
UNITS = sorted(table.parent.name for table in ROOT.glob("fmus/*/model.def"))
LINK = re.compile(r"\[([^\]]*)\]\(([^)#\s:]+)(?:#[^)\s]*)?\)")
EQUATIONS = re.compile(r"^```equations\n(.+?)^```$", flags=re.M | re.S)
PART = re.compile(r"`([a-z_]+)\.([a-z_0-9]+)`")
CLASSES = ("system.model.System", "results.result.Result", "results.sweep.Sweep", "results.diagnosed.Diagnosed")


def on_files(files: Files, config: MkDocsConfig, **_: Any) -> Files:
    """The theme's files, the pages under their paths in the repository, what these link to, and the pages made here."""
    for file in [f for f in files if f.src_dir == config.docs_dir]:
        files.remove(file)
    pages = {page for pattern in PAGES for page in ROOT.glob(pattern)}
    linked = {target for page in pages for _, target in links(page) if target.is_file()}
    icons = {ROOT / "fmus" / unit / "model.png" for unit in UNITS}
    for path in sorted(pages | linked | icons):
        name = path.relative_to(ROOT).as_posix()
        files.append(File(name, str(ROOT), config.site_dir, config.use_directory_urls))
    for unit in UNITS:
        files.append(File.generated(config, f"docs/units/{unit}.md", content=unit_page(unit)))
    files.append(File.generated(config, "docs/api.md", content=api_page()))
    files.append(File.generated(config, "docs/figures/proof.md", content=proof.page(ROOT)))
    files.append(File.generated(config, "docs/figures/reliability.md", content=reliability.page(ROOT)))
    files.append(File.generated(config, "docs/figures/benchmarks.md", content=benchmarks.page(ROOT)))
    files.append(File.generated(config, "docs/figures/style.css", content=svg.style()))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Of a link to a folder, which only the repository shows, its words; equations typeset; a unit's parts linked."""
    folder = (ROOT / page.file.src_uri).parent
    markdown = LINK.sub(lambda link: link[1] if (folder / link[2]).is_dir() else link[0], markdown)
    if page.file.src_uri == "docs/equations.md":
        markdown = PART.sub(lambda p: f"[{p[0]}](units/{p[1]}.md#{p[2]})" if p[1] in UNITS else p[0], markdown)
    return EQUATIONS.sub(lambda block: equations(block[1]), markdown)


def links(page: Path) -> list[tuple[str, Path]]:
    """Words and targets of a page's links within the repository."""
    found = LINK.findall(page.read_text(encoding="utf-8"))
    return [(words, (page.parent / target).resolve()) for words, target in found]


def equations(block: str) -> str:
    """A table: equations, and what is said beside them."""
    rows = [re.split(r" {2,}", re.sub(" +=", " =", line)) for line in block.splitlines()]
    cells = ["".join(f'<td style="padding-right: 2em">{typeset(cell)}</td>' for cell in row) for row in rows]
    return f'<table class="equations">{"".join(f"<tr>{row}</tr>" for row in cells)}</table>\n'


def unit_page(unit: str) -> str:
    """The reference page that the unit brings along, with its headings and its picture as the site's."""
    (fmus, *_) = fmu_directories()
    with zipfile.ZipFile(fmus / f"{unit}.fmu") as archive:
        page = archive.read("documentation/index.html").decode()
    icon = f"![Icon of {unit}](../../fmus/{unit}/model.png){{ align=right width=128 }}\n"
    body = page.partition("<main>")[2].partition("</main>")[0]
    body = re.sub(r'<a class="anchor".*?</a>', "", body)  # the site has its own
    body = re.sub(r"</?header>|<img [^>]*>", "", body)
    body = re.sub(r"<h1>(.*?)</h1>", rf"\n# \1\n\n{icon}", body)
    return re.sub(r'<h([23]) id="([\w-]+)">(.*?)</h\1>', lambda h: f"\n{'#' * int(h[1])} {h[3]} {{ #{h[2]} }}\n", body)


def api_page() -> str:
    """What `import cobot_joint as cj` offers, and what its functions return."""
    offered = [f"cobot_joint.{name}" for name in cobot_joint.__all__ if not name.startswith("_")]
    returned = [f"cobot_joint.{name}" for name in CLASSES]
    return "\n".join(
        [
            "# Python interface",
            f"\n{cobot_joint.__doc__.partition(chr(10))[0]} `import cobot_joint as cj` offers:\n",
            *(f"::: {name}\n" for name in offered),
            "## What these return\n",
            *(f"::: {name}\n" for name in returned),
        ]
    )
