"""Our scoreboard is the published one, and a seal that does not fit is seen."""

from __future__ import annotations

import importlib.util
import json
import random
import sys
from pathlib import Path

import pytest

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


@pytest.mark.parametrize("seed", range(5))
def test_the_scoreboard_equals_the_published_scorer(
    shared: Path, tmp_path: Path, seed: int, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = random_set(random.Random(seed), tmp_path)
    (tmp_path / "answers.json").write_text(json.dumps(answers))
    spec = importlib.util.spec_from_file_location("published_score", shared / "score.py")
    assert spec
    assert spec.loader
    published = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(published)
    monkeypatch.setattr(
        sys,
        "argv",
        ["score.py", str(tmp_path / "answers.json"), str(tmp_path), "--json", str(tmp_path / "theirs.json")],
    )
    published.main()
    theirs, ours = (
        json.loads((tmp_path / "theirs.json").read_text()),
        json.loads(json.dumps(scoreboard(answers, tmp_path))),
    )
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
