"""The bench written as one C loop, apart from the FMUs: the yardstick for speed and for the FMUs' own equations.

`averaged` and `three_phase` take the inputs' table (rows, 3): v_command [V], i_brake [A], tau_hold [N.m], at 1 kHz
and linear between rows, and return one array (rows,) per column, recorded at 1 kHz.
"""

import ctypes
import enum
import functools
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SOURCES = Path(__file__).parent
FLAGS = ["-std=c11", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fPIC", "-shared"]
SAMPLE = 1e-3  # s, between rows of inputs and results
INPUTS = ["v_command", "i_brake", "tau_hold"]
COLUMNS = ["i_motor", "w_motor", "phi_motor", "tau_gear", "tau_sensor"]
COLUMNS += ["w_pulley", "phi_pulley", "w_brake", "tau_belt"]
PHASE_COLUMNS = [*COLUMNS, "i_a", "i_b", "i_c", "charge"]

Table = NDArray[np.float64]


class Setup(enum.IntEnum):
    """What hangs on the motor. `MOTOR_ALONE` takes the third input as the torque on its rotor."""

    LOADED = 0
    NO_LOAD = 1
    MOTOR_ALONE = 2


def compile_library(source: Path, flags: list[str], depends: list[Path] | None = None) -> Path:
    """Shared library of one C file, built once per content in the user's cache of temporary files."""
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise RuntimeError("no C compiler found: install one or set CC to it; the monolithic loops are C")
    content = b"".join(path.read_bytes() for path in [source, *(depends or [])]) + " ".join([compiler, *flags]).encode()
    folder = Path(tempfile.gettempdir()) / f"cobot-joint-benchmarks-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    library = folder / f"{source.stem}-{hashlib.sha256(content).hexdigest()[:16]}.so"
    if not library.exists():
        built = library.with_suffix(f".{os.getpid()}")
        subprocess.run([compiler, *flags, str(source), "-o", str(built), "-lm"], check=True)
        built.replace(library)
    return library


@functools.cache
def _function(name: str) -> Callable[..., None]:
    library = ctypes.CDLL(str(compile_library(SOURCES / f"{name}.c", FLAGS, [SOURCES / "bench.h"])))
    table = np.ctypeslib.ndpointer(np.float64, ndim=2, flags="C_CONTIGUOUS")
    function = library[f"{name}_run"]
    locate = [ctypes.c_int] if name == "three_phase" else []
    function.argtypes = [ctypes.c_int, ctypes.c_int, *locate, ctypes.c_size_t, table, table]
    function.restype = None
    return function


def _steps_per_sample(step: float) -> int:
    steps = round(SAMPLE / step) if step > 0 else 0
    if steps < 1 or abs(steps * step - SAMPLE) > 1e-12:
        raise ValueError(f"step = {step!r} s: allowed are whole parts of the sample, {SAMPLE} s")
    return steps


def averaged(inputs: Table, step: float, setup: Setup = Setup.LOADED) -> dict[str, Table]:
    """The bench with the averaged motor, from rest, RK4 with a fixed `step` [s]. Columns as in the references."""
    inputs = np.ascontiguousarray(inputs, dtype=np.float64)
    results = np.zeros((len(inputs), len(COLUMNS)))
    _function("averaged")(setup, _steps_per_sample(step), len(inputs), inputs, results)
    return dict(zip(COLUMNS, results.T, strict=True))


def three_phase(inputs: Table, step: float, setup: Setup = Setup.LOADED, locate: bool = False) -> dict[str, Table]:
    """The bench with the three-phase motor (thesis eq. 2.9-2.20), from rest, RK4 with a fixed `step` [s].

    Switches and diodes change between steps, as in the thesis's own runs at 1 us; with `locate` a step is cut at
    every commutation, freewheel end and contact. `i_motor` is half the difference of the two active legs' currents,
    `charge` [A.s] its integral.
    """
    inputs = np.ascontiguousarray(inputs, dtype=np.float64)
    results = np.zeros((len(inputs), len(PHASE_COLUMNS)))
    _function("three_phase")(setup, _steps_per_sample(step), locate, len(inputs), inputs, results)
    return dict(zip(PHASE_COLUMNS, results.T, strict=True))
