"""`diagnose`, `verify` and `prove` as typed: what they print, write and refuse."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer
from typer.testing import CliRunner

from cobot_joint import cli
from cobot_joint.diagnosis import commands, run
from cobot_joint.diagnosis.budget import Budget
from cobot_joint.diagnosis.data.campaign import Campaign, load_campaign
from cobot_joint.diagnosis.findings import Diagnosis
from cobot_joint.diagnosis.store import Store
from cobot_joint.errors import UserError
from tests.orchestrator.diagnosis.made_up import CONCEALED, ONSET, R, explained, knows, record


@pytest.mark.parametrize("command", ["diagnose", "verify"])
def test_json_is_the_file_on_stdout_and_nothing_else(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str],
    command: str,
) -> None:  # fmt: skip
    monkeypatch.setattr(run, "engine", knows(explained()))
    out = tmp_path / "d"
    run.diagnose_campaign(load_campaign(campaign_file), out)
    monkeypatch.setattr(commands.console, "quiet", False)  # as it is afterwards, too
    told = ["--out", str(out)] if command == "diagnose" else [str(out)]
    monkeypatch.setattr(sys, "argv", ["cobot-joint", command, *told, str(campaign_file), "--json"])
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == 0
    said = json.loads(capfd.readouterr().out)
    assert said == json.loads((out / ("diagnosis.json" if command == "diagnose" else "verify.json")).read_text())


def test_json_of_a_command_that_has_none_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["cobot-joint", "prove", str(tmp_path), "--json"])
    with pytest.raises(SystemExit) as left:
        cli.main()
    allowed = "check, demo, diagnose, export, run, verify"
    assert (left.value.code, capfd.readouterr().err) == (
        2, f"cobot-joint: --json is given with prove, it is allowed with {allowed}\n"
    )  # fmt: skip


def test_the_commands_answer_as_promised(campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    app = typer.Typer()
    commands.register(app)
    monkeypatch.setattr(run, "engine", knows(explained()))
    runner = CliRunner()
    answer = runner.invoke(app, ["diagnose", str(campaign_file), "--out", str(tmp_path / "d")])
    assert answer.exit_code == 0, answer.output
    assert "The model lacks" in answer.output
    assert "held-out runs" in answer.output
    answer = runner.invoke(app, ["verify", str(tmp_path / "d"), str(campaign_file)])
    assert answer.exit_code == 0, answer.output
    assert (tmp_path / "d/verify.json").is_file()
    for arguments in (["verify", str(tmp_path), str(campaign_file)], ["diagnose", str(tmp_path / "none.toml")]):
        assert isinstance(runner.invoke(app, arguments).exception, UserError)


def test_a_set_is_scored_by_the_command_and_a_broken_seal_fails_it(tmp_path: Path) -> None:
    from cobot_joint.diagnosis.evaluation.score import seal

    app = typer.Typer()
    commands.register(app)
    (tmp_path / "case01").mkdir()
    (tmp_path / "case01/campaign.toml").write_text('[[recording]]\nfile = "load.parquet"\n')
    (tmp_path / "case01/load.parquet").touch()
    (tmp_path / "case01/diagnosis.json").write_text('{"verdict": "nothing_missing", "findings": []}')
    answers = {"case01": {"effects": [], "salt": "s"}}
    (tmp_path / "answers.json").write_text(json.dumps(answers))
    (tmp_path / "seals.json").write_text(json.dumps({"case01": seal(answers["case01"])}))
    answer = CliRunner().invoke(app, ["prove", str(tmp_path)])
    assert answer.exit_code == 0, answer.output
    assert "1 answers are those that were sealed" in answer.output
    assert "0.207 to 1.000" in answer.output
    (tmp_path / "seals.json").write_text(json.dumps({"case01": "0" * 64}))
    assert CliRunner().invoke(app, ["prove", str(tmp_path)]).exit_code == 1


@pytest.mark.long
def test_a_sealed_set_is_diagnosed_verified_and_scored_by_one_command(tmp_path: Path) -> None:
    """Two cases without load: one conceals cogging, one nothing; answers and held-out runs are published afterwards."""
    from cobot_joint.diagnosis.evaluation.prove import prove
    from cobot_joint.diagnosis.evaluation.score import seal

    answers = {
        "case01": {"effects": [{"name": "cogging", "accept": ["motor_bldc.cogging"], "onset_s": ONSET}], "salt": "a"},
        "case02": {"effects": [], "salt": "b"},
    }
    for seed, case in enumerate(answers):
        (tmp_path / case).mkdir()
        concealed = CONCEALED if answers[case]["effects"] else {"motor_bldc.winding.R": R}
        record(tmp_path / case, "noload", "no_load", seed, concealed)
        entry = '[[recording]]\nfile = "noload.parquet"\nsetup = "no_load"\nrole = "train"\n'
        (tmp_path / case / "campaign.toml").write_text(f'title = "{case}"\nsystem = "joint"\n{entry}')
    (tmp_path / "seals.json").write_text(json.dumps({case: seal(answer) for case, answer in answers.items()}))
    first = prove(tmp_path)
    assert [r.status for r in first.results] == ["done", "done"], first.results
    assert first.score is None
    said = {case: (tmp_path / case / "diagnosis.json").read_bytes() for case in answers}
    for case in answers:
        concealed = CONCEALED if answers[case]["effects"] else {"motor_bldc.winding.R": R}
        record(tmp_path / case, "holdout", "no_load", 7, concealed)
    (tmp_path / "answers.json").write_text(json.dumps(answers))
    second = prove(tmp_path)
    assert second.broken_seals == {}
    assert second.score
    assert second.score["summary"]["right"]["k"] == 2, second.score
    for case in answers:
        assert (tmp_path / case / "diagnosis.json").read_bytes() == said[case]
        assert (tmp_path / case / "verify.json").is_file()


@pytest.mark.long
def test_a_diagnosis_that_is_killed_goes_on_and_says_the_same(tmp_path: Path) -> None:
    record(tmp_path, "noload", "no_load", 0)
    entry = '[[recording]]\nfile = "noload.parquet"\nsetup = "no_load"\nrole = "train"\n'
    (tmp_path / "campaign.toml").write_text(f'title = "killed"\nsystem = "joint"\n{entry}')

    def start(out: str) -> subprocess.Popen:
        call = [sys.executable, "-m", "cobot_joint", "diagnose", str(tmp_path), "--out", str(tmp_path / out)]
        return subprocess.Popen(call, stdout=subprocess.DEVNULL)

    killed, work = start("killed"), tmp_path / "killed/.work"
    while killed.poll() is None and not list(work.glob("*.npz")):
        time.sleep(0.05)
    killed.kill()
    killed.wait()
    assert not (tmp_path / "killed/diagnosis.json").exists()
    assert start("killed").wait() == 0
    assert start("whole").wait() == 0
    assert not work.exists()
    answers = [json.loads((tmp_path / out / "diagnosis.json").read_text()) for out in ("killed", "whole")]
    for answer in answers:
        del answer["seconds"]
    assert answers[0] == answers[1]


def test_progress_that_is_piped_is_written_in_whole_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[str] = []
    monkeypatch.setattr(sys, "stderr", SimpleNamespace(write=written.append, flush=lambda: None, isatty=lambda: False))
    with commands._stages() as say:
        for stage in ("reading", "simulating", "re-fitting"):
            say(stage)
    assert [len(said.splitlines()) for said in written] == [1, 1, 1]
    assert all(said.endswith("\n") for said in written)


def test_a_baseline_that_does_not_exist_is_refused() -> None:
    with pytest.raises(UserError, match="--baseline 'magic' is given"):
        run.engine("magic", Budget())


def test_a_limit_in_time_is_refused_where_nothing_can_be_left_out() -> None:
    with pytest.raises(UserError, match="--within 5 is given, a baseline"):
        run.engine("refit", Budget(5.0))


def test_the_stages_are_kept_and_the_answer_says_so_where_time_was_up(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cut_short(campaign: Campaign, *, progress=None, store: Store | None = None) -> Diagnosis:
        assert store is not None
        store.remember("calibrated", None, lambda: 1.0)
        return replace(explained(), left_out=left_out)

    app = typer.Typer()
    commands.register(app)
    monkeypatch.setattr(run, "engine", lambda baseline, budget: cut_short)
    for left_out in (["formulas", "the recorded motion"], []):
        arguments = ["diagnose", str(campaign_file), "--out", str(tmp_path / "d"), "--within", "5"]
        answer = CliRunner().invoke(app, arguments)
        assert answer.exit_code == 0, answer.output
        said = "time was up: not looked at are formulas, the recorded motion"
        assert (said in answer.output) == bool(left_out)
        assert (said in (tmp_path / "d/report.html").read_text()) == bool(left_out)
        assert (tmp_path / "d/.work").is_dir() == bool(left_out)


def test_figures_that_a_repair_is_judged_by_are_printed_beside_those_of_free_runs() -> None:
    """99.9 % were said to be removed above a table in which the error grew."""
    free = {"noise": 0.02, "nominal": 0.55, "calibrated": 0.4, "repaired": 0.67}
    predicted = {"horizon": 0.2, "nominal": 0.16, "calibrated": 0.15, "repaired": 0.031}
    for channel, there in (({**free, "predicted": predicted}, True), ({**free, "predicted": None}, False)):
        with commands.console.capture() as shown:
            commands._print_figures("held-out runs", {"w": channel}, {"w": "rad/s"})
        assert "0.67" in shown.get()
        assert ("predictions over 0.2 s, held-out runs" in shown.get()) == there
        assert ("0.031" in shown.get()) == there
