"""How long a diagnosis may look further, and what it then did not look at."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

T = TypeVar("T")


class OutOfTime(Exception):
    """Raised out of a search whose time is up."""


class _CutShort(Exception):
    """Carries past the keeper what is no result to go on from."""

    def __init__(self, found: object) -> None:
        super().__init__()
        self.found = found


@dataclass
class Budget:
    """seconds: in which something further may be looked at. What was not, or not to its end, is kept in words.

    keep: gives the result that an earlier call has kept under a name, or keeps that of a search.
    """

    seconds: float = math.inf
    left_out: list[str] = field(default_factory=list)
    begun: float = field(default_factory=time.monotonic)
    keep: Callable[[str, Callable[[], Any]], Any] = lambda name, look: look()
    _asked: Counter[str] = field(default_factory=Counter)  # what -> times that it was a stage
    _leaves: float | None = None  # share of the time that what runs now leaves to what follows; None: it is not cut

    @property
    def limited(self) -> bool:
        """Whether the answer depends on how fast the machine is."""
        return math.isfinite(self.seconds)

    def allows(self, what: str, leaves: float = 0.0) -> bool:
        """Whether there is time to begin with it; where not, it is noted. leaves: share of the time that follows it."""
        if not self._is_up(leaves):
            return True
        self._leave_out(what)
        return False

    def spend(self, what: str, look: Callable[[], T], leaves: float = 0.0) -> T | None:
        """What is found. None: there was no time for it, or it was up on the way, which is noted. leaves: share of the
        time that it leaves to what follows, which would else never be asked."""
        outer = self._leaves
        leaves = max(leaves, outer or 0.0)
        if not self.allows(what, leaves):
            return None
        self._leaves = leaves
        try:
            return look()
        except OutOfTime:
            self._leave_out(what)
            return None
        finally:
            self._leaves = outer

    def stage(self, what: str, look: Callable[[], T], leaves: float = 0.0) -> T | None:
        """The same, kept for a later call by how many times it was asked for: what goes before is kept, too, and the
        same, unless time cut it short."""
        self._asked[what] += 1
        if self.left_out:
            return self.spend(what, look, leaves)
        return self.kept(f"{what} {self._asked[what]}", lambda: self.spend(what, look, leaves))

    def kept(self, name: str, look: Callable[[], T]) -> T:
        """What an earlier call has kept under the name, else what is found, kept unless time cut it short."""

        def whole() -> T:
            found = look()
            if self.left_out:
                raise _CutShort(found)
            return found

        try:
            return cast(T, self.keep(name, whole))
        except _CutShort as cut:
            return cast(T, cut.found)

    def _leave_out(self, what: str) -> None:
        """Said once, though several places ask for it."""
        if what not in self.left_out:
            self.left_out.append(what)

    def check(self) -> None:
        """Called on the way, before anything that takes long. OutOfTime: time is up for what runs now."""
        if self._leaves is not None and self._is_up(self._leaves):
            raise OutOfTime

    def _is_up(self, leaves: float) -> bool:
        """Whether all but that share of the time has gone."""
        return time.monotonic() - self.begun >= (1 - leaves) * self.seconds
