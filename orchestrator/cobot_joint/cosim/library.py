"""The native library and the program that hosts an isolated unit: where they are."""

from __future__ import annotations

import ctypes
import os
import sys
from functools import cache
from pathlib import Path

from cobot_joint.paths import CHECKOUT, PACKAGE

NAME = {"win32": "cosim_native.dll", "darwin": "libcosim_native.dylib"}.get(sys.platform, "libcosim_native.so")


HOST = "cosim_host"


@cache
def load() -> ctypes.CDLL:
    """The native library. FileNotFoundError: it was not built."""
    return ctypes.CDLL(str(path()))


@cache
def path() -> Path:
    """COBOT_JOINT_LIBRARY, the installed package's, a checkout's build tree's. FileNotFoundError: none is built."""
    named = os.environ.get("COBOT_JOINT_LIBRARY")
    return _first(([Path(named)] if named else []) + [PACKAGE / "cosim" / NAME, CHECKOUT / "build" / NAME])


@cache
def host() -> Path:
    """Beside the native library, else as that is found. FileNotFoundError: it was not built."""
    return _first([path().with_name(HOST), PACKAGE / "cosim" / HOST, CHECKOUT / "build" / HOST])


def _first(places: list[Path]) -> Path:
    for place in places:
        if place.is_file():
            return place
    raise FileNotFoundError(f"the native master is not built: looked for {', '.join(map(str, places))}")
