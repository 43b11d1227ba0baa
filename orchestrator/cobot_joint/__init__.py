"""The test bench of a cobot's joint: units (FMUs) coupled as an SSP system, run, swept, and compared with recordings.

import cobot_joint as cj

result = cj.run("load_mr_brake", parameters={"motor_bldc.winding.R": 0.22})
result.plot("i_motor", "w_motor")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from cobot_joint.version import __version__

if TYPE_CHECKING:
    from cobot_joint.api import Experiment, Inputs, diagnose, load_results, load_system, run, sweep

__all__ = ["Experiment", "Inputs", "__version__", "diagnose", "load_results", "load_system", "run", "sweep"]


def __getattr__(name: str) -> Any:
    """Names are imported when they are first used: `import cobot_joint` itself takes milliseconds."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}, it has {', '.join(__all__)}")
    return getattr(import_module("cobot_joint.api"), name)


def __dir__() -> list[str]:
    return __all__
