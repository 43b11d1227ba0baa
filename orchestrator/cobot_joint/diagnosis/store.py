"""What a diagnosis has finished, kept on disk: an interrupted one, called again, goes on from there."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import joblib
import numpy as np

T = TypeVar("T")


class Store:
    """Results by the content of what they were computed from.

    folder: where they lie (created when the first is kept); None keeps nothing. basis: what every result depends on,
    such as recordings, units and the tool's version: another basis finds nothing of the old one.
    """

    def __init__(self, folder: Path | None, basis: Any = None) -> None:
        self.folder = folder
        self.basis = joblib.hash(basis)

    def remember(self, stage: str, inputs: Any, compute: Callable[[], T]) -> T:
        """The kept result of `stage` for these `inputs`, or that of `compute()`, which is then kept.

        inputs: anything picklable that the result depends on (arrays by content).
        """
        if self.folder is None:
            return compute()
        path = self.folder / f"{stage}-{joblib.hash((self.basis, stage, inputs))}.joblib"
        if path.is_file():
            try:
                return cast(T, joblib.load(path))
            except (EOFError, ValueError, OSError, KeyError, ImportError, AttributeError):
                path.unlink(missing_ok=True)  # of another version, or of a full disk: worth computing again
        result = compute()
        write_atomically(path, lambda file: joblib.dump(result, file))
        return result

    def clear(self) -> None:
        """Forget everything: the answer is written, and what it went through takes more room than all the rest."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


def write_atomically(path: Path, write: Callable[[Path], Any]) -> None:
    """`write(file)` to a neighbour of `path` that then takes its name: a reader finds all of it or nothing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    neighbour = Path(name)
    try:
        write(neighbour)
        neighbour.chmod(0o644)
        neighbour.replace(path)
    finally:
        neighbour.unlink(missing_ok=True)


def plain(value: Any) -> Any:
    """For json: numpy's numbers and arrays as Python's, what is not finite as null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, np.generic):
        return value.item()
    return value


def read_object(path: Path) -> tuple[dict[str, Any] | None, str | None]:
    """A JSON object, or None and why not."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None, "no answer"
    except (OSError, ValueError) as error:
        return None, f"unreadable: {error}"
    return (content, None) if isinstance(content, dict) else (None, "not an object")
