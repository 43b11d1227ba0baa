"""Where the package's own files are: in the installed package, or in the checkout that it is run from."""

from __future__ import annotations

from pathlib import Path

PACKAGE = Path(__file__).parent
CHECKOUT = PACKAGE.parents[1]  # of an installed package: a folder that has none of what is looked for


def folder(name: str) -> Path:
    """`systems`, `scenarios` or `docs` (glossary and references): in the installed package, else in the checkout."""
    inside = PACKAGE / name
    return inside if inside.is_dir() else CHECKOUT / name
