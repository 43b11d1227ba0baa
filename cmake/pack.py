"""A folder as an FMU, `pack.py FOLDER FILE`: the same files give the same bytes, whoever packs them, when and where."""

import sys
import zipfile
from pathlib import Path

EPOCH = (1980, 1, 1, 0, 0, 0)  # zip knows no earlier one


def pack(folder: Path, fmu: Path) -> None:
    """All files of the folder in the order of their names, modelDescription.xml first."""
    names = sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file())
    partial = fmu.with_suffix(".partial")
    with zipfile.ZipFile(partial, "w") as archive:
        for name in sorted(names, key=lambda name: name != "modelDescription.xml"):
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.create_system, entry.external_attr = 3, 0o644 << 16
            archive.writestr(entry, (folder / name).read_bytes(), zipfile.ZIP_DEFLATED, 9)
    partial.replace(fmu)


if __name__ == "__main__":
    pack(Path(sys.argv[1]), Path(sys.argv[2]))
