"""A folder as an FMU: the same files give the same bytes, whoever packs them, when and where.

The build runs it as a script, `pack.py FOLDER FILE`, so that it imports nothing of the package.
"""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

EPOCH = (1980, 1, 1, 0, 0, 0)  # zip knows no earlier one


def pack(folder: Path, fmu: Path) -> None:
    """All files of the folder in the order of their names, modelDescription.xml first."""
    names = sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file())
    with zipfile.ZipFile(fmu, "w") as archive:
        for name in sorted(names, key=lambda name: name != "modelDescription.xml"):
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.create_system, entry.external_attr = 3, 0o644 << 16
            archive.writestr(entry, (folder / name).read_bytes(), zipfile.ZIP_DEFLATED, 9)


if __name__ == "__main__":
    partial = Path(f"{sys.argv[2]}.partial")
    pack(Path(sys.argv[1]), partial)
    partial.replace(sys.argv[2])
