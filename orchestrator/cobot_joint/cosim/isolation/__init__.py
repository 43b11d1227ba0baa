"""Units in processes of their own: which of them, within which limits, and how such a process ended.

Only units whose library was built with this package run in its process; what others do to theirs is theirs alone.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
from ctypes import POINTER, c_char_p, c_double, c_int32, c_size_t, c_uint32, c_uint64, c_void_p
from functools import cache
from pathlib import Path
from typing import Literal

from fmpy import platform, sharedLibraryExtension

from cobot_joint import interrupts
from cobot_joint.cosim import library
from cobot_joint.errors import UserError, among
from cobot_joint.paths import CHECKOUT, PACKAGE
from cobot_joint.units import Unit

WHICH, TIME_LIMIT, MEMORY_LIMIT = "COBOT_JOINT_ISOLATE", "COBOT_JOINT_TIME_LIMIT", "COBOT_JOINT_MEMORY_LIMIT"
RECORD = "libraries.sha256"  # beside the shipped units, written when they are built
TYPES = {"Real": "R", "Integer": "I", "Enumeration": "I", "Boolean": "B"}
Outcome = Literal["runs", "no process", "not opened", "refused", "ended"]
OUTCOMES: tuple[Outcome, ...] = ("runs", "no process", "not opened", "refused", "ended")  # as in isolation.h


def is_isolated(unit: Unit) -> bool:
    """Whether the unit runs in a process of its own: COBOT_JOINT_ISOLATE of `foreign` (default), `all` or `none`.

    UserError: another value; or `all` where the system has no such processes.
    """
    which = os.environ.get(WHICH, "foreign")
    if which not in ("foreign", "all", "none"):
        raise UserError(f"{WHICH} {which!r} is given, {among(('foreign', 'all', 'none'))} is allowed")
    if not hasattr(library.load(), "cosim_isolate"):
        if which == "all":
            raise UserError("--isolate is given: units in processes of their own need a POSIX system")
        return False
    return which == "all" or (which == "foreign" and not is_shipped(unit))


def is_shipped(unit: Unit) -> bool:
    """Whether the unit's library is, byte for byte, one that was built with this package."""
    path = library_of(unit)
    return path.is_file() and _digest(path, path.stat().st_mtime_ns) in _shipped()


def library_of(unit: Unit) -> Path:
    """Where the unit's library for this machine is, if it has one."""
    name = f"{unit.description.coSimulation.modelIdentifier}{sharedLibraryExtension}"
    return unit.directory / "binaries" / platform / name


def limits() -> tuple[float, int]:
    """Of one call, s, and of a unit's memory, bytes. UserError: a limit that is none."""
    seconds = _number(TIME_LIMIT, "--time-limit", 30.0, "seconds of one call of a unit")
    return seconds, int(1e6 * _number(MEMORY_LIMIT, "--memory-limit", 4000.0, "MB of a unit's memory"))


def _number(variable: str, option: str, usual: float, what: str) -> float:
    given = os.environ.get(variable)
    try:
        value = usual if given is None else float(given)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise UserError(f"{option} {given!r} is given, a positive number is allowed: {what}")
    return value


@cache
def _shipped() -> frozenset[str]:
    records = [place / RECORD for place in (PACKAGE / "fmus", CHECKOUT / "build" / "fmus")]
    lines = [line for record in records if record.is_file() for line in record.read_text(encoding="utf-8").splitlines()]
    return frozenset(line.split()[0] for line in lines if line.strip())


@cache
def _digest(path: Path, _modified: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


class _Isolation(ctypes.Structure):
    _fields_ = [
        ("host", c_char_p),
        ("library", c_char_p),
        ("time_limit", c_double),
        ("memory_limit", c_uint64),
        ("n_inputs", c_size_t),
        ("input_names", POINTER(c_char_p)),
        ("input_refs", POINTER(c_uint32)),
        ("input_types", c_char_p),
        ("pending", c_int32),
        ("outcome", c_int32),
    ]


class Isolation:
    """What the process of one unit is started with."""

    def __init__(self, unit: Unit) -> None:
        """UserError: a limit is none, or the FMU has no library for this machine."""
        path = library_of(unit)
        if not path.is_file():
            there = sorted(p.name for p in (unit.directory / "binaries").glob("*"))
            raise UserError(
                f"{unit.path}: holds no binaries/{platform}/{path.name}; it has binaries for {among(there)}"
            )
        inputs = [v for v in unit.variables.values() if v.causality == "input" and v.type in TYPES]
        seconds, memory = limits()
        self._wanted = _Isolation(
            host=os.fsencode(library.host()),
            library=os.fsencode(path),
            time_limit=seconds,
            memory_limit=memory,
            n_inputs=len(inputs),
            input_names=(c_char_p * len(inputs))(*(v.name.encode() for v in inputs)),
            input_refs=(c_uint32 * len(inputs))(*(v.valueReference for v in inputs)),
            input_types="".join(TYPES[v.type] for v in inputs).encode(),
            pending=interrupts.pending,
        )

    def prepare(self) -> None:
        """The next fmi2Instantiate of this thread starts a process for the unit."""
        prepare = library.load().cosim_isolate
        prepare.argtypes, prepare.restype = [POINTER(_Isolation)], None
        prepare(ctypes.byref(self._wanted))

    @property
    def outcome(self) -> Outcome:
        """Of that."""
        return OUTCOMES[self._wanted.outcome]


def ended(component: int | None) -> str | None:
    """How the process of an isolated component ended, in words; None: it runs. Of None: of the one freed last."""
    tell = library.load().cosim_ended
    tell.argtypes, tell.restype = [c_void_p], c_char_p
    words = tell(component)
    return words.decode("utf-8", "replace") if words else None
