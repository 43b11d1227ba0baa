"""Calls beside each other, two at a time: one per recording, or one per term."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")
AT_ONCE = 2


def at_once(function: Callable[..., T], *items: Iterable[Any]) -> list[T]:
    """As `list(map(function, *items))`, two at a time. Units' own code and BLAS let other threads run meanwhile."""
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return list(pool.map(function, *items))
