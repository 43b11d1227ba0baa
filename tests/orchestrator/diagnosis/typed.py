"""What a command says that is typed in a test's folder."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Done:
    returncode: int
    stdout: str
    stderr: str
