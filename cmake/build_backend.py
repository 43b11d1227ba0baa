"""scikit-build-core as it is; where the machine has no C compiler, the one of the `ziglang` wheel builds the FMUs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from scikit_build_core import build as skbuild
from scikit_build_core.build import (
    build_sdist,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

Settings = dict[str, list[str] | str] | None


def has_compiler() -> bool:
    """Whether CMake will find a C compiler."""
    if os.environ.get("CC"):
        return True
    if sys.platform == "darwin":  # /usr/bin/cc is there even without a compiler behind it
        return subprocess.run(["xcode-select", "-p"], capture_output=True).returncode == 0
    if sys.platform == "win32":
        programs = Path(os.environ.get("PROGRAMFILES(X86)", "C:/Program Files (x86)"))
        if (programs / "Microsoft Visual Studio/Installer/vswhere.exe").exists():
            return True
    return any(shutil.which(name) for name in ("cc", "gcc", "clang", "cl"))


def ensure_compiler() -> None:
    """Hand the zig compiler to CMake where nothing else is there. SystemExit: neither is."""
    if has_compiler():
        return
    ziglang = find_spec("ziglang")
    if ziglang is None or not ziglang.submodule_search_locations:
        raise SystemExit(
            "No C compiler found. Install one (Debian, Ubuntu: apt install gcc; macOS: xcode-select --install; "
            "Windows: Visual Studio Build Tools), or `pip install ziglang`."
        )
    zig = Path(ziglang.submodule_search_locations[0], "zig.exe" if sys.platform == "win32" else "zig")
    # baseline: the wheel may be carried to another machine; the rest switches off what zig adds by itself
    os.environ["CC"] = f"{zig} cc -mcpu=baseline -fno-sanitize=undefined -g0"


def _zig() -> list[str]:
    return [] if has_compiler() else ["ziglang"]


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    return [*skbuild.get_requires_for_build_wheel(config_settings), *_zig()]


def get_requires_for_build_editable(config_settings: Settings = None) -> list[str]:
    return [*skbuild.get_requires_for_build_editable(config_settings), *_zig()]


def build_wheel(directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> str:
    ensure_compiler()
    return skbuild.build_wheel(directory, config_settings, metadata_directory)


def build_editable(directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> str:
    ensure_compiler()
    return skbuild.build_editable(directory, config_settings, metadata_directory)
