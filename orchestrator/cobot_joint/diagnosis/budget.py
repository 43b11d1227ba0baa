"""How long a diagnosis may look further, and what it then did not look at."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field


@dataclass
class Budget:
    """seconds: in which something further may be begun. What was not begun is kept in words."""

    seconds: float = math.inf
    left_out: list[str] = field(default_factory=list)
    begun: float = field(default_factory=time.monotonic)

    @property
    def limited(self) -> bool:
        """Whether the answer depends on how fast the machine is."""
        return math.isfinite(self.seconds)

    def allows(self, what: str) -> bool:
        """Whether there is time to look at it; where not, it is noted."""
        if time.monotonic() - self.begun < self.seconds:
            return True
        self.left_out.append(what)
        return False
