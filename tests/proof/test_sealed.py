"""The answers to the sealed campaigns are those that were fixed."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

SEALED = Path(__file__).parents[2] / "proof" / "sealed"
FROZEN = SEALED / "frozen.json"
if not FROZEN.is_file():
    pytest.skip("proof/sealed/frozen.json is not here: no answers have been fixed yet", allow_module_level=True)
FILES = json.loads(FROZEN.read_text())["files"]
ANSWERS = [file.split("/")[0] for file in FILES if file.endswith("/diagnosis.json")]


def test_every_sealed_campaign_is_answered() -> None:
    assert sorted(ANSWERS) == sorted(path.parent.name for path in SEALED.glob("*/campaign.toml"))


@pytest.mark.parametrize("file", sorted(FILES))
def test_an_answer_was_not_touched_after_it_was_fixed(file: str) -> None:
    assert hashlib.sha256((SEALED / file).read_bytes()).hexdigest() == FILES[file]


@pytest.mark.parametrize("case", sorted(ANSWERS))
def test_an_answer_has_a_verdict_and_keeps_the_promised_format(case: str) -> None:
    answer = json.loads((SEALED / case / "diagnosis.json").read_text())
    assert answer["verdict"] in ("nothing_missing", "explained", "unlisted", "undecided")
    assert (answer["verdict"] == "nothing_missing") <= (answer["findings"] == [])
    for finding in answer["findings"]:
        assert 0 <= finding["confidence"] <= 1
        assert len(finding["equivalent"]) <= 3
        assert {"recording", "regime"} <= set(finding["where"])
