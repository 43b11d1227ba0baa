"""A set of cases: finished ones are kept, failed ones reported, published answers checked and scored."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet
import pytest

from cobot_joint.diagnosis import commands
from cobot_joint.diagnosis.data.campaign import holdouts
from cobot_joint.diagnosis.evaluation.prove import cases_of, prove
from cobot_joint.diagnosis.evaluation.score import seal
from cobot_joint.errors import UserError

CAMPAIGN = 'title = "c"\nsystem = "joint"\n[[recording]]\nfile = "load.parquet"\nsetup = "loaded"\nrole = "train"\n'
HEALTHY = {"verdict": "nothing_missing", "findings": [], "seconds": 40.0}
WRONG = {"verdict": "explained", "findings": [{"term": "motor_bldc.cogging", "equivalent": [], "confidence": 0.9}]}


def sealed_set(folder: Path, diagnoses: list[dict | None], published: bool) -> None:
    """A small set in which nothing is concealed, with its seals, and its answers where published."""
    answers = {f"case{k:02d}": {"effects": [], "noise_rho": 0.0, "salt": f"salt {k}"} for k in range(len(diagnoses))}
    for case, diagnosis in zip(answers, diagnoses, strict=True):
        (folder / case).mkdir()
        (folder / case / "campaign.toml").write_text(CAMPAIGN)
        (folder / case / "load.parquet").touch()  # there; a kept answer does not read it
        if diagnosis is not None:
            (folder / case / "diagnosis.json").write_text(json.dumps(diagnosis))
    (folder / "seals.json").write_text(json.dumps({case: seal(answer) for case, answer in answers.items()}))
    if published:
        (folder / "answers.json").write_text(json.dumps(answers))


def test_finished_cases_are_kept_as_they_are_and_scored(tmp_path: Path) -> None:
    sealed_set(tmp_path, [HEALTHY, HEALTHY, WRONG], published=True)
    before = {path: path.read_bytes() for path in tmp_path.glob("*/diagnosis.json")}
    proof = prove(tmp_path, jobs=1)
    assert [r.status for r in proof.results] == ["kept"] * 3
    assert proof.broken_seals == {}
    assert {path: path.read_bytes() for path in tmp_path.glob("*/diagnosis.json")} == before
    assert proof.score
    assert proof.score["summary"]["right"] == {"k": 2, "n": 3, "rate": 0.6667, "ci95": [0.208, 0.939]}
    assert proof.score["summary"]["healthy_with_a_claim"]["k"] == 1
    assert proof.score["seconds_median"] == 40.0
    assert json.loads((tmp_path / "scoreboard.json").read_text())["summary"] == proof.score["summary"]


def test_intervals_that_hold_the_true_value_are_counted(tmp_path: Path) -> None:
    """Not that of the gap, which is what was concealed: its published value is the one before."""
    gap = {"name": "backlash", "accept": ["planetary_gear.backlash"]}
    truth = {"effects": [gap], "true_parameters": {"R": 0.21, "kt": 0.0233, "backlash": 0.0175, "ke": 0.0233}}
    names = {"motor_bldc.winding.R": [0.2, 0.22], "motor_bldc.winding.k": [0.0234, 0.0236]}
    repaired = {name: {"value": low, "ci95": [low, high]} for name, (low, high) in names.items()}
    repaired["planetary_gear.mesh.b"] = {"value": 0.03, "ci95": [0.029, 0.031]}
    sealed_set(tmp_path, [HEALTHY | {"repaired": repaired}], published=False)
    (tmp_path / "answers.json").write_text(json.dumps({"case00": truth}))
    proof = prove(tmp_path, jobs=1)
    assert proof.score
    assert proof.score["true_value_in_interval"] == {"k": 1, "n": 2, "rate": 0.5, "ci95": [0.095, 0.905]}


def test_a_case_without_its_recordings_is_left_as_it_is_and_said(tmp_path: Path) -> None:
    sealed_set(tmp_path, [HEALTHY, None], published=False)
    for case in ("case00", "case01"):
        (tmp_path / case / "load.parquet").unlink()
    results = prove(tmp_path, jobs=1).results
    assert [(r.case, r.status) for r in results] == [("case00", "absent"), ("case01", "absent")]
    assert "load.parquet is not here" in results[0].message


def test_a_case_that_fails_is_reported_and_does_not_stop_the_rest(tmp_path: Path) -> None:
    """The empty file of case01 is no Parquet file."""
    sealed_set(tmp_path, [HEALTHY, None, HEALTHY], published=False)
    results = prove(tmp_path, jobs=2).results
    assert [r.status for r in results] == ["kept", "failed", "kept"]
    assert "load.parquet: cannot be read as parquet" in results[1].message


def test_without_answers_there_is_no_score_and_no_seal_to_check(tmp_path: Path) -> None:
    sealed_set(tmp_path, [HEALTHY], published=False)
    proof = prove(tmp_path, jobs=1)
    assert proof.score is None
    assert proof.broken_seals is None


def test_an_answer_that_was_changed_after_sealing_is_seen(tmp_path: Path) -> None:
    sealed_set(tmp_path, [HEALTHY, HEALTHY], published=True)
    answers = json.loads((tmp_path / "answers.json").read_text())
    answers["case01"]["noise_rho"] = 0.5
    (tmp_path / "answers.json").write_text(json.dumps(answers))
    assert list(prove(tmp_path, jobs=1).broken_seals or {}) == ["case01"]


def test_a_held_out_run_that_is_published_later_is_found(tmp_path: Path) -> None:
    sealed_set(tmp_path, [HEALTHY], published=True)
    assert holdouts(tmp_path / "case00/campaign.toml") == []
    pa.parquet.write_table(pa.table({"time [s]": [0.0, 1.0]}), tmp_path / "case00/holdout.parquet")
    assert [file.name for file in holdouts(tmp_path / "case00/campaign.toml")] == ["holdout.parquet"]


@pytest.mark.parametrize("make", [False, True])
def test_a_folder_without_cases_is_refused(tmp_path: Path, make: bool) -> None:
    folder = tmp_path / "set"
    if make:
        folder.mkdir()
    with pytest.raises(UserError, match="a set is a folder of folders with a"):
        cases_of(folder)


@pytest.mark.parametrize(("excess", "said"), [(None, ""), (0.9993, "99.9 %"), (-5.839, "worse")])
def test_no_share_that_is_removed_is_printed_below_zero(excess: float | None, said: str) -> None:
    """a withheld repair of proof/sealed/case13 had printed -583.9 %"""
    row = {"effects": [], "false": [], "why": "", "excess_removed": excess}
    assert commands._case_row(row)[2] == said
