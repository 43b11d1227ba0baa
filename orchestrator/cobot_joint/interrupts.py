"""Ctrl-C and SIGTERM: what is being done stops, its temporary files are removed, and one line is said."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(BaseException):
    """Somebody wants the program to stop. Its argument says what then holds."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Inside, the first SIGINT or SIGTERM raises Interrupted; a second one ends the process. Main thread only."""
    before = {number: signal.signal(number, _stop) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def resumable() -> Iterator[None]:
    """What is interrupted inside goes on when the command is called again."""
    try:
        yield
    except Interrupted:
        raise Interrupted("goes on from here when called again") from None


def _stop(_number: int, _frame: FrameType | None) -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    raise Interrupted
