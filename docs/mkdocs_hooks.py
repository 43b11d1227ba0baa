"""The site has the repository's own paths, so that a link that works in one works in the other."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("*.md", "benchmarks/README.md", "docs/**/*.md")
LINK = re.compile(r"\[([^\]]*)\]\(([^)#\s:]+)(?:#[^)\s]*)?\)")


def on_files(files: Files, config: MkDocsConfig, **_: Any) -> Files:
    """The theme's files, the pages under their paths in the repository, and the files that these link to."""
    for file in [f for f in files if f.src_dir == config.docs_dir]:
        files.remove(file)
    pages = {page for pattern in PAGES for page in ROOT.glob(pattern)}
    linked = {target for page in pages for _, target in links(page) if target.is_file()}
    for path in sorted(pages | linked):
        name = path.relative_to(ROOT).as_posix()
        files.append(File(name, str(ROOT), config.site_dir, config.use_directory_urls))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Of a link to a folder, which only the repository shows, its words."""
    folder = (ROOT / page.file.src_uri).parent
    return LINK.sub(lambda link: link[1] if (folder / link[2]).is_dir() else link[0], markdown)


def links(page: Path) -> list[tuple[str, Path]]:
    """Words and targets of a page's links within the repository."""
    found = LINK.findall(page.read_text(encoding="utf-8"))
    return [(words, (page.parent / target).resolve()) for words, target in found]
