"""Files that are there as a whole or not at all, and what is said where a disk does not take them."""

from __future__ import annotations

import errno
import glob
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cobot_joint.errors import UserError

REFUSED = {errno.EACCES, errno.EPERM, errno.EROFS}
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def write_atomically(path: Path, write: Callable[[Path], Any]) -> None:
    """`write(file)` to a neighbour of `path` that then takes its name: a reader finds all of it or nothing.

    OSError: it cannot be written; its filename is `path`.
    """
    with _named(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(f".{os.getpid()}.partial", f".{path.name}.", path.parent)
    os.close(handle)
    remove_partial(path)
    neighbour = Path(name)
    try:
        with _named(path):
            write(neighbour)
            neighbour.chmod(0o644)
            neighbour.replace(path)
    finally:
        neighbour.unlink(missing_ok=True)


def remove_partial(path: Path) -> None:
    """Take away what processes that were killed have left of `path`: .NAME[.*].PID.partial beside it."""
    for left in path.parent.glob(f".{glob.escape(path.name)}.*.partial"):
        process = left.name.split(".")[-2]
        if process.isdigit() and not _runs(int(process)):
            left.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    """Whether there is such a process; where the system does not say without harm, there is."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def writable(folder: Path) -> Path:
    """The folder, made where it is missing, after something has been written to it. OSError: that cannot be done."""
    with _named(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"\0")
            file.flush()
    return folder


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Errors about a temporary file, or about none, are about `path`."""
    try:
        yield
    except OSError as error:
        if error.errno and (error.filename is None or Path(error.filename).name.startswith((f".{path.name}.", "tmp"))):
            error.filename = str(path)
        raise


def results_folder(path: Path) -> Path:
    """What --out names, ready to be written to. UserError: it is a file. OSError: it cannot be written to."""
    try:
        return writable(path)
    except (FileExistsError, NotADirectoryError) as error:
        raise UserError(f"--out {path}: a folder that can be written is needed: {error.strerror}") from error


def what_is_missing(error: OSError) -> str:
    """One line for a file that could not be read or written."""
    where = f"{error.filename}: " if error.filename else ""
    said = error.strerror or str(error)
    if error.errno in REFUSED:
        return f"{where}{said}: the permission to write there is missing; --out names another folder"
    if error.errno in FULL:
        return f"{where}{said}: free space is missing; --out names another folder"
    return f"{where}{said}"


def relative(file: Path, folder: Path) -> str:
    """As seen from a folder, with slashes; on another drive there is only the whole path."""
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:
        return file.resolve().as_posix()
