"""An FMU with binaries for five platforms, compiled from its own sources by the compiler of the wheel `ziglang`."""

from __future__ import annotations

import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import fmpy

from cobot_joint.errors import UserError

# as the build compiles them; baseline: any machine of that kind; contraction off: the same roundings on all
MATH = ["-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off"]
FLAGS = ["-std=c99", "-O3", *MATH, "-fvisibility=hidden", "-shared", "-fPIC"]
ZIG = ["-g0", "-s", "-mcpu=baseline", "-fno-sanitize=undefined"]
FAT_MAGIC, PAGE = 0xCAFEBABE, 14  # mach-o/fat.h; both kinds of Mac load at multiples of 2^14


@dataclass(frozen=True)
class Platform:
    """`folder` inside `binaries` (FMI 2.0.4, 2.3; FMI 3.0.2, 2.5.1); `targets` as zig names them, several: fat."""

    folder: str
    suffix: str
    targets: tuple[str, ...]


PLATFORMS = (
    Platform("linux64", ".so", ("x86_64-linux-gnu.2.17",)),  # the oldest glibc that Python's wheels are built for
    Platform("aarch64-linux", ".so", ("aarch64-linux-gnu.2.17",)),
    Platform("win64", ".dll", ("x86_64-windows-gnu",)),
    Platform("win32", ".dll", ("x86-windows-gnu",)),
    Platform("darwin64", ".dylib", ("x86_64-macos", "aarch64-macos")),
)
FMI3_PLATFORMS = (
    Platform("x86_64-linux", ".so", ("x86_64-linux-gnu.2.17",)),
    Platform("aarch64-linux", ".so", ("aarch64-linux-gnu.2.17",)),
    Platform("x86_64-windows", ".dll", ("x86_64-windows-gnu",)),
    Platform("x86-windows", ".dll", ("x86-windows-gnu",)),
    Platform("x86_64-darwin", ".dylib", ("x86_64-macos",)),
    Platform("aarch64-darwin", ".dylib", ("aarch64-macos",)),
)


def compile_for_all(folder: Path, platforms: Sequence[Platform] | None = None) -> None:
    """An unpacked FMU's binaries, all of them new; platforms: None for all that its version of FMI names.

    UserError: it has no sources, or the compiler is missing.
    """
    sources = folder / "sources"
    description = fmpy.read_model_description(str(folder))
    name, fmi = description.coSimulation.modelIdentifier, description.fmiVersion[0]
    if not (sources / "all.c").is_file():
        raise UserError(f"--all-platforms: {name} has no sources/all.c to be compiled")
    if find_spec("ziglang") is None:
        raise UserError("--all-platforms: the compiler is missing, `pip install ziglang` brings it")
    shutil.rmtree(folder / "binaries", ignore_errors=True)
    for platform in platforms or (FMI3_PLATFORMS if fmi == "3" else PLATFORMS):
        binary = folder / "binaries" / platform.folder / f"{name}{platform.suffix}"
        binary.parent.mkdir(parents=True)
        parts = [_compiled(sources, target, binary.name, fmi) for target in platform.targets]
        binary.write_bytes(parts[0] if len(parts) == 1 else universal(parts))


def _compiled(sources: Path, target: str, name: str, fmi: str) -> bytes:
    """Compiled in `sources` itself, by relative paths, so that no folder of this machine gets into it."""
    headers = Path(fmpy.__file__).parent / "c-code"
    own = [f"-Wl,-install_name,@rpath/{name}"] if target.endswith("macos") else []
    with tempfile.TemporaryDirectory() as folder:
        binary = Path(folder, name)
        call = [sys.executable, "-m", "ziglang", "cc", "-target", target, *FLAGS, *ZIG, *own]
        call += [f"-DFMI{fmi}_OVERRIDE_FUNCTION_PREFIX", "-I", ".", "-I", str(headers)]
        call += ["all.c", "-o", str(binary), "-lm"]
        done = subprocess.run(call, cwd=sources, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"{name} for {target}: {done.stderr.strip()}")
        return binary.read_bytes()


def universal(parts: Sequence[bytes]) -> bytes:
    """Mach-O files of several processors as one: mach-o/fat.h."""
    size = 1 << PAGE
    head, body, at = struct.pack(">II", FAT_MAGIC, len(parts)), b"", size
    for part in parts:
        processor = struct.unpack("<II", part[4:12])  # cputype, cpusubtype
        head += struct.pack(">IIIII", *processor, at + len(body), len(part), PAGE)
        body += part + bytes(-len(part) % size)
    return head.ljust(size, b"\0") + body
