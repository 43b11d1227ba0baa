"""Pictures into files: here and now, or by a process that loads matplotlib while the caller still simulates."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from cobot_joint.paths import PACKAGE

if TYPE_CHECKING:
    from cobot_joint.results.figures import Picture


def draw(picture: Picture) -> dict[Path, str]:
    """`stem`.html and `stem`.png; path -> what it shows."""
    from cobot_joint.results.figures import write_html
    from cobot_joint.results.png import write_png

    write_html(picture)
    write_png(picture)
    return picture.files


class Stills:
    """PNGs from a process of its own. When it ends as a context manager, all are there. RuntimeError: one is not."""

    def __enter__(self) -> Stills:
        here = os.pathsep.join(filter(None, [str(PACKAGE.parent), os.environ.get("PYTHONPATH")]))
        self._process = subprocess.Popen(
            [sys.executable, "-m", "cobot_joint.results.png"],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": here},
        )
        return self

    def draw(self, picture: Picture) -> Path:
        """The PNG's path; the file is complete when the context manager ends."""
        assert self._process.stdin is not None
        try:
            pickle.dump(picture, self._process.stdin)
            self._process.stdin.flush()
        except BrokenPipeError:
            self._finish()
        return picture.stem.with_suffix(".png")

    def _finish(self) -> None:
        _, said = self._process.communicate()
        if self._process.returncode:
            raise RuntimeError(f"pictures were not drawn: {said.decode(errors='replace').strip()}")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._finish()
        else:
            self._process.kill()
            self._process.communicate()
