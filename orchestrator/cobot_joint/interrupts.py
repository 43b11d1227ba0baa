"""Ctrl-C, SIGTERM, a parent that was killed: what is being done stops; where it can, tidily and in one line."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
pending = -1  # a file that can be read once one of them has come: native code that waits looks there; -1: none


class Interrupted(BaseException):
    """Somebody wants the program to stop. Its argument says what then holds."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Inside, the first SIGINT or SIGTERM raises Interrupted; a second one ends the process. Main thread only."""
    before = {number: signal.signal(number, _stop) for number in SIGNALS}
    try:
        with _told_natively():
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _told_natively() -> Iterator[None]:
    """Inside, `pending` is such a file, on POSIX: handlers in Python wait until native calls return."""
    global pending
    if os.name != "posix":
        yield
        return
    pending, told = os.pipe()
    os.set_blocking(told, False)
    before = signal.set_wakeup_fd(told, warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        for file in (pending, told):
            os.close(file)
        pending = -1


@contextmanager
def resumable() -> Iterator[None]:
    """What is interrupted inside goes on when the command is called again."""
    try:
        yield
    except Interrupted:
        raise Interrupted("goes on from here when called again") from None


def end_with(parent: int) -> None:
    """From now on this process ends when the one that started it has ended, killed or not. POSIX; nothing elsewhere."""
    name = f"end with {parent}"
    if os.name == "posix" and os.getpid() != parent and name not in [t.name for t in threading.enumerate()]:
        threading.Thread(target=_outlive, args=(parent,), name=name, daemon=True).start()


def _outlive(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _stop(_number: int, _frame: FrameType | None) -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    raise Interrupted
