"""Fix the answers of a set: `python proof/freeze.py proof/sealed` after `cobot-joint prove proof/sealed`.

Writes SETDIR/frozen.json: the commit and tag that the answers came from, the thresholds they were found with, and the
SHA-256 of every diagnosis.json. A test holds the answers against it ever after. It refuses to be called again.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

from orchestrator.diagnosis import confidence, fit, name, scan, unlisted


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


def main(folder: Path) -> None:
    """See the module."""
    frozen = folder / "frozen.json"
    if frozen.exists():
        sys.exit(f"{frozen} is there: answers are fixed once")
    if changed := _git("status", "--porcelain", "orchestrator", "fmus", "systems"):
        sys.exit(f"the tool is not what was committed:\n{changed}")
    answers = {path.parent.name: digest(path) for path in sorted(folder.glob("*/diagnosis.json"))}
    content = {
        "commit": _git("log", "-1", "--format=%H", "--", "orchestrator", "fmus", "systems"),
        "tag": _git("tag", "--points-at", "HEAD") or None,
        "thresholds": thresholds(name, scan, fit, unlisted, confidence),
        "answers": answers,
    }
    frozen.write_text(json.dumps(content, indent=1) + "\n")
    print(f"{len(answers)} answers fixed in {frozen}")


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], capture_output=True, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
