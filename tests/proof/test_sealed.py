"""The answers to the sealed campaigns are those that were fixed."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.evaluation.score import broken_seals, scoreboard
from cobot_joint.diagnosis.repair.verify import verify

PROOF = Path(__file__).parents[2] / "proof"
SEALED = PROOF / "sealed"
SETS = ("sealed", "field_sealed")
FILES = {
    f"{name}/{file}": digest
    for name in SETS
    for file, digest in json.loads((PROOF / name / "frozen.json").read_text())["files"].items()
}
ANSWERS = [str(Path(file).parent) for file in FILES if file.endswith("/diagnosis.json")]


def test_every_sealed_campaign_is_answered() -> None:
    campaigns = [path.parent for name in SETS for path in (PROOF / name).glob("*/campaign.toml")]
    assert sorted(ANSWERS) == sorted(path.relative_to(PROOF).as_posix() for path in campaigns)


@pytest.mark.parametrize("file", sorted(FILES))
def test_an_answer_was_not_touched_after_it_was_fixed(file: str) -> None:
    assert hashlib.sha256((PROOF / file).read_bytes()).hexdigest() == FILES[file]


@pytest.mark.parametrize("case", sorted(ANSWERS))
def test_an_answer_has_a_verdict_and_keeps_the_promised_format(case: str) -> None:
    answer = json.loads((PROOF / case / "diagnosis.json").read_text())
    assert answer["verdict"] in ("nothing_missing", "explained", "unlisted", "undecided")
    assert (answer["verdict"] == "nothing_missing") <= (answer["findings"] == [])
    for finding in answer["findings"]:
        assert 0 <= finding["confidence"] <= 1
        assert len(finding["equivalent"]) <= 3
        assert {"recording", "regime"} <= set(finding["where"])


def test_the_published_truths_are_those_that_were_sealed() -> None:
    truths, seals = (json.loads((SEALED / name).read_text()) for name in ("answers.json", "seals.json"))
    assert len(truths) == 30
    assert broken_seals(truths, seals) == {}


def test_the_committed_scoreboard_is_that_of_the_committed_answers() -> None:
    told = json.loads((SEALED / "scoreboard.json").read_text())
    found = json.loads(json.dumps(scoreboard(json.loads((SEALED / "answers.json").read_text()), SEALED)))
    assert {key: told[key] for key in found} == found


@pytest.mark.long
def test_the_verified_figures_of_an_answer_are_repeated(tmp_path: Path) -> None:
    shutil.copy(SEALED / "case02" / "diagnosis.json", tmp_path)
    figures = verify(tmp_path, load_campaign(SEALED / "case02", roles=("holdout",)))["channels"]
    told = json.loads((SEALED / "case02" / "verify.json").read_text())["channels"]
    for name, channel in told.items():
        assert {key: figures[name][key] for key in channel} == pytest.approx(channel, rel=1e-3)
