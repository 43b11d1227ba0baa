"""Our scoreboard is the published one, and a seal that does not fit is seen."""

from __future__ import annotations

import importlib.util
import json
import random
import sys
from pathlib import Path

import pytest

from cobot_joint.diagnosis.evaluation import field_score
from cobot_joint.diagnosis.evaluation.prove import prove
from cobot_joint.diagnosis.evaluation.score import broken_seals, rate, scoreboard, seal
from cobot_joint.errors import UserError

TERMS = [
    "motor_bldc.stribeck",
    "planetary_gear.stribeck",
    "torque_sensor.offset",
    "mr_brake_belt.unlisted",
    "motor_bldc.unlisted",
    "planetary_gear.mesh.b",
    "planetary_gear.mesh.eta",
    "planetary_gear.friction.d",
]


def random_set(rng: random.Random, folder: Path) -> dict:
    """Answers and results of all sorts: healthy, listed and unlisted effects; no, wrong, honest and odd diagnoses."""
    answers = {}
    for k in range(40):
        case = f"case{k:02d}"
        kinds = [
            ["motor_bldc.stribeck", "planetary_gear.stribeck"],
            ["torque_sensor.offset"],
            ["unlisted:mr_brake_belt|torque_sensor"],
        ]
        effects = [
            {
                "name": rng.choice(["e", "backlash", "load_friction"]),
                "accept": a,
                "onset_s": rng.choice([0.0, 2.5]),
                "parameters": rng.choice([{}, {"x_thin_T": 1e-4}, {"x_thin_T": 1e-3}]),
            }
            for a in rng.sample(kinds, rng.choice([0, 1, 1, 2]))
        ]
        answers[case] = {"effects": effects, "noise_rho": 0.0}
        (folder / case).mkdir()
        if rng.random() < 0.1:
            continue
        findings = [
            {
                "term": rng.choice(TERMS),
                "equivalent": rng.sample(TERMS, rng.choice([0, 0, 2, 4])),
                "confidence": rng.random(),
                "onset": rng.choice([None, 2.0]),
            }
            for _ in range(rng.choice([0, 1, 1, 2]))
        ]
        verdict = "explained" if findings else rng.choice(["nothing_missing", "undecided"])
        (folder / case / "diagnosis.json").write_text(json.dumps({"verdict": verdict, "findings": findings}))
        channels = {
            n: {"noise": 0.1, "calibrated": rng.uniform(0, 1), "repaired": rng.uniform(0, 1)}
            for n in ("i_motor", "other")
        }
        (folder / case / "verify.json").write_text(json.dumps({"channels": channels}))
    return answers


def published(script: Path, answers: dict, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict:
    """What a published scorer says of the results in a folder."""
    (folder / "answers.json").write_text(json.dumps(answers))
    spec = importlib.util.spec_from_file_location(script.stem, script)
    assert spec
    assert spec.loader
    scorer = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(scorer)
    told = [script.name, str(folder / "answers.json"), str(folder), "--json", str(folder / "theirs.json")]
    monkeypatch.setattr(sys, "argv", told)
    scorer.main()
    return json.loads((folder / "theirs.json").read_text())


@pytest.mark.parametrize("seed", range(5))
def test_the_scoreboard_equals_the_published_scorer(
    shared: Path, tmp_path: Path, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = random_set(random.Random(seed), tmp_path)
    theirs = published(shared / "score.py", answers, tmp_path, monkeypatch)
    ours = json.loads(json.dumps(scoreboard(answers, tmp_path)))
    for key, their in theirs["summary"].items():
        our, interval = ours["summary"][key], their.pop("ci95", None) if isinstance(their, dict) else None
        if interval:
            assert our.pop("ci95") == pytest.approx(interval, abs=1.01e-3)  # half a digit may round either way
        elif isinstance(our, dict):
            our.pop("ci95")
        assert our == their
    assert ours["summary"].keys() == theirs["summary"].keys()
    for our, their in zip(ours["rows"], theirs["rows"], strict=True):
        assert our == their


def random_field_set(rng: random.Random, folder: Path) -> dict:
    """The same of machines with a background: odd confidences, predictions of any horizon, withheld repairs."""
    answers = random_set(rng, folder)
    for case, answer in answers.items():
        answer["style"] = rng.choice(["tidy", "untidy", "other"])
        for effect in answer["effects"]:
            effect["over_background"] = round(rng.uniform(1.6, 84), 2)
        path = folder / case / "diagnosis.json"
        if path.is_file():
            diagnosis = json.loads(path.read_text()) | rng.choice([{}, {"repair": "offered"}, {"repair": "withheld"}])
            for finding in diagnosis["findings"]:
                finding["confidence"] = rng.choice([finding["confidence"], 0.5, None, float("nan"), "high", 1])
            diagnosis["findings"] += rng.choice([[], ["?"], [{"term": None}], [{"term": "motor_bldc.unlisted"}]])
            path.write_text(rng.choice([json.dumps(diagnosis)] * 9 + ["{"]))
        if rng.random() < 0.9:
            channels = {name: channel(rng) for name in ("i_motor", "w_motor", *rng.choice([[], [], [], ["other"]]))}
            (folder / case / "verify.json").write_text(json.dumps({"channels": channels}))
    return answers


def channel(rng: random.Random) -> dict:
    def figure() -> float | None:
        return rng.choice([rng.uniform(0, 0.4), rng.uniform(0, 0.004), *rng.choice([[], [], [None, float("nan")]])])

    figures = [{name: figure() for name in ("calibrated", "repaired")} for _ in range(2)]
    predicted = rng.choice([None, {"horizon": 0.2} | figures[1], {"horizon": 0.1} | figures[1], {"horizon": 0.5}])
    return figures[0] | rng.choice([{}, {"predicted": predicted}])


@pytest.mark.parametrize("seed", range(10))
def test_the_scoreboard_of_the_field_equals_the_published_scorer(
    shared: Path, tmp_path: Path, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = random_field_set(random.Random(seed), tmp_path)
    theirs = published(shared / "score_field.py", answers, tmp_path, monkeypatch)
    ours = json.loads(json.dumps(field_score.scoreboard(answers, tmp_path)))
    assert ours["summary"] == theirs["summary"]
    for our, their in zip(ours["rows"], theirs["rows"], strict=True):
        assert our == their


def test_answers_with_a_style_are_scored_by_the_rules_of_the_field(tmp_path: Path) -> None:
    case = tmp_path / "case01"
    case.mkdir()
    (case / "campaign.toml").write_text('[[recording]]\nfile = "run.parquet"\n')
    (case / "run.parquet").touch()
    weak = {"term": "motor_bldc.stribeck", "equivalent": [], "confidence": 0.3}  # no claim, where there is a background
    (case / "diagnosis.json").write_text(json.dumps({"verdict": "undecided", "findings": [weak]}))
    (tmp_path / "answers.json").write_text(json.dumps({"case01": {"effects": [], "style": "tidy"}}))
    score = prove(tmp_path, jobs=1).score
    assert score
    assert score["summary"]["right"] == 1
    assert score["rows"][0]["false"] == []
    assert score["summary"]["brier"] == 0.09


def test_a_rate_has_a_wilson_interval() -> None:
    assert rate(13, 14) == {"k": 13, "n": 14, "rate": 0.9286, "ci95": [0.685, 0.987]}  # closed form, z = 1.96
    assert rate(0, 0)["ci95"] is None


def test_a_seal_is_broken_by_any_change_and_by_nothing_else() -> None:
    answers = {"case01": {"effects": [], "b": 1.5, "salt": "s1"}, "case02": {"effects": [{"name": "x"}], "salt": "s2"}}
    seals = {case: seal(answer) for case, answer in answers.items()}
    reordered = {"case01": dict(reversed(answers["case01"].items())), "case02": answers["case02"]}
    assert broken_seals(reordered, seals) == {}
    for change in ({"b": 1.6}, {"salt": "s3"}, {"more": None}):
        assert list(broken_seals({**answers, "case01": answers["case01"] | change}, seals)) == ["case01"]
    assert broken_seals(answers, {"case01": seals["case01"]}) == {"case02": "has no seal"}
    assert broken_seals({}, {"case01": "0"}) == {"case01": "is sealed and has no answer"}


def test_a_seal_is_the_sha256_of_sorted_json_and_salt() -> None:
    """Computed with coreutils: printf '{"a": 1, "b": [2]}pepper' | sha256sum"""
    assert (
        seal({"b": [2], "a": 1, "salt": "pepper"}) == "78b4d41e39196fe646a36be06506aa7e5bd774ad7ecacfad2b2ec78663002366"
    )


def test_answers_of_another_form_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="not in the form of answers"):
        scoreboard({"case01": {"effect": []}}, tmp_path)
