"""What a diagnosis has finished, kept on disk: an interrupted one, called again, goes on from there."""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from cobot_joint.diagnosis.archive import DamagedError, fingerprint, load, save
from cobot_joint.files import write_atomically

T = TypeVar("T")
log = logging.getLogger("cobot_joint")


class Store:
    """Results by the content of what they were computed from.

    folder: where they lie (created when the first is kept); None keeps nothing. basis: what every result depends on,
    such as recordings, units and the tool's version: another basis finds nothing of the old one. Values, inputs and
    basis: what `archive.save` takes.
    """

    def __init__(self, folder: Path | None, basis: Any = None) -> None:
        self.folder = folder
        self.basis = fingerprint(basis)

    def remember(self, stage: str, inputs: Any, compute: Callable[[], T]) -> T:
        """The kept result of `stage` for these `inputs`, or that of `compute()`, which is then kept.

        One that is damaged is computed again; a warning says so.
        """
        if self.folder is None:
            return compute()
        key = f"{stage}-{fingerprint((self.basis, stage, inputs))}"
        path = self.folder / f"{key}.npz"
        try:
            return cast(T, load(path, key))
        except FileNotFoundError:
            pass
        except DamagedError as error:
            log.warning("%s: %s; %r is computed again", path, error, stage)
        result = compute()
        write_atomically(path, lambda file: save(file, result, key))
        return result

    def clear(self) -> None:
        """Forget everything: the answer is ready, and what it went through takes more room than all the rest."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


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
