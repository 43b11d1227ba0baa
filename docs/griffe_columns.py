"""Docstrings list arguments in two columns, name and what it is; on the site each row is an item of a list."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

ROW = re.compile(r"^(\w+(?:, \w+)*) {2,}(\S.*(?:\n {2,}\S.*)*)", flags=re.M)


class Columns(Extension):
    """Rewrites every docstring that has such rows."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        if obj.docstring:
            obj.docstring.value = ROW.sub(_item, obj.docstring.value)


def _item(row: re.Match[str]) -> str:
    name, what = row[1], " ".join(row[2].split())
    return f"- `{name}`: {what}"
