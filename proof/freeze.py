"""Fix the answers to a set: `python proof/freeze.py RESULTS proof/sealed`, RESULTS being what `prove --out` wrote.

Copies every diagnosis.json and the repaired systems' descriptions beside the recordings, and writes SETDIR/frozen.json:
the commit and tag that the answers came from, the thresholds they were found with, and the SHA-256 of every file. A
test holds the answers against it ever after. It refuses to be called again.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import cobot_joint.diagnosis.thresholds
from cobot_joint.diagnosis.selection import confidence


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def thresholds(*modules: ModuleType) -> dict[str, dict[str, object]]:
    """Module -> its constants that are numbers."""

    def numeric(value: object) -> bool:
        return isinstance(value, (int, float)) or (
            isinstance(value, tuple) and all(isinstance(v, (int, float)) for v in value)
        )

    return {
        module.__name__.rsplit(".", 1)[1]: {
            constant: value for constant, value in vars(module).items() if constant.isupper() and numeric(value)
        }
        for module in modules
    }


def copy(results: Path, folder: Path) -> None:
    """diagnosis.json, and of repaired*.ssp the description: the units in it are rebuilt from diagnosis.json."""
    for answer in sorted(results.glob("*/diagnosis.json")):
        case = folder / answer.parent.name
        shutil.copy(answer, case)
        for system in answer.parent.glob("repaired*.ssp"):
            with zipfile.ZipFile(system) as archive:
                (case / system.with_suffix(".ssd").name).write_bytes(archive.read("SystemStructure.ssd"))


def main(results: Path, folder: Path) -> None:
    """See the module."""
    frozen = folder / "frozen.json"
    if frozen.exists():
        sys.exit(f"{frozen} is there: answers are fixed once")
    if changed := _git("status", "--porcelain", "orchestrator", "fmus", "systems"):
        sys.exit(f"the tool is not what was committed:\n{changed}")
    copy(results, folder)
    files = sorted([*folder.glob("*/diagnosis.json"), *folder.glob("*/repaired*.ssd")])
    commit = _git("log", "-1", "--format=%H", "--", "orchestrator", "fmus", "systems")
    content = {
        "commit": commit,
        "tag": _git("tag", "--points-at", commit) or None,
        "thresholds": thresholds(cobot_joint.diagnosis.thresholds, confidence),
        "files": {path.relative_to(folder).as_posix(): digest(path) for path in files},
    }
    frozen.write_text(json.dumps(content, indent=1) + "\n")
    print(f"{len(files)} files fixed in {frozen}")


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], capture_output=True, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
