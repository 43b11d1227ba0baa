"""The native library: where it is."""

from __future__ import annotations

import ctypes
import os
import sys
from functools import cache
from pathlib import Path

from cobot_joint.paths import CHECKOUT, PACKAGE

NAME = {"win32": "cosim_native.dll", "darwin": "libcosim_native.dylib"}.get(sys.platform, "libcosim_native.so")


@cache
def load() -> ctypes.CDLL:
    """COBOT_JOINT_LIBRARY, the installed package's, a checkout's build tree's. FileNotFoundError: it was not built."""
    named = os.environ.get("COBOT_JOINT_LIBRARY")
    places = ([Path(named)] if named else []) + [PACKAGE / "cosim" / NAME, CHECKOUT / "build" / NAME]
    for place in places:
        if place.is_file():
            return ctypes.CDLL(str(place))
    looked = ", ".join(str(place) for place in places)
    raise FileNotFoundError(f"the native master is not built: looked for {looked}")
