"""The screen: what files say is shown, and never carried out by the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text

from cobot_joint.errors import printable


class Screen(Console):
    """Rich's console with control characters in text as `\\x1b`."""

    def render_str(self, text: str, **options: Any) -> Text:
        """As Console's."""
        return super().render_str(printable(text), **options)
