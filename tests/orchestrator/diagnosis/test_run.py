"""A diagnosis becomes files that agree with one another, and commands that answer as promised.

The engine is replaced by one that knows what a made-up bench conceals, so that only what follows it is tested here.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import joblib
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import typer
from typer.testing import CliRunner

from cobot_joint import cli
from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis import commands, run
from cobot_joint.diagnosis.budget import Budget
from cobot_joint.diagnosis.data.campaign import Campaign, load_campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.evaluation.baselines import DiscrepancyDiagnosis
from cobot_joint.diagnosis.findings import Diagnosis, Estimate, Feature, Finding, Form
from cobot_joint.diagnosis.plant.correction import Factor, Product
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.diagnosis.provenance import provenance
from cobot_joint.diagnosis.repair.discrepancy import Discrepancy, Process
from cobot_joint.diagnosis.repair.export import repaired_system
from cobot_joint.diagnosis.repair.verify import verify
from cobot_joint.diagnosis.store import Store
from cobot_joint.errors import UserError
from cobot_joint.system.read import load_system
from cobot_joint.system.write import write_ssp
from cobot_joint.version import __version__

R, A, ONSET = 0.215, 2e-3, 1.0
CONCEALED = {"motor_bldc.winding.R": R, "motor_bldc.cogging.A": A}
UNITS = {"i_motor": "A", "w_motor": "rad/s", "tau_sensor": "N.m"}
NOISE = {"i_motor": 4e-3, "w_motor": 0.3, "tau_sensor": 5e-3}
LOADED, NO_LOAD = ("i_motor", "w_motor", "tau_sensor"), ("i_motor", "w_motor")


def record(folder: Path, name: str, setup: str, seed: int, concealed: dict[str, float] = CONCEALED) -> None:
    """A short run of the bench with what is concealed, as a logger writes it."""
    rng = np.random.default_rng(seed)
    t = np.arange(2001) * 1e-3
    inputs = {"v_command": np.interp(t, [0.3, 0.6, 1.4, 1.8], [0, 8 + seed, 8 + seed, -3])}
    if setup == "loaded":
        inputs["i_brake"] = np.interp(t, [0.9, 1.0], [0, 0.3])
    outputs = {n: np.zeros(len(t)) for n in (LOADED if setup == "loaded" else NO_LOAD)}
    system = load_system("joint_logged" if setup == "loaded" else "joint_no_load_logged")
    late = {name: ONSET for name in concealed if "cogging" in name}
    with Simulator({setup: system}, concealed, late) as bench:
        signals = bench(Recording(name, "train", setup, t, inputs, outputs, UNITS))
    measured = {n: x + NOISE[n] * rng.standard_normal(len(t)) for n, x in signals.items()}
    units = UNITS | {"v_command": "V", "i_brake": "A"}
    columns = {f"{n} [{units[n]}]": x for n, x in (inputs | measured).items()}
    pa.parquet.write_table(pa.table({"time [s]": t} | columns), folder / f"{name}.parquet")


@pytest.fixture(scope="module")
def campaign_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaign")
    text = 'title = "Concealed cogging"\nsystem = "joint"\n'
    runs = [("noload", "no_load", "train"), ("load", "loaded", "train"), ("later", "loaded", "holdout")]
    for seed, (name, setup, role) in enumerate(runs):
        record(folder, name, setup, seed)
        text += f'[[recording]]\nfile = "{name}.parquet"\nsetup = "{setup}"\nrole = "{role}"\n'
    (folder / "campaign.toml").write_text(text)
    return folder / "campaign.toml"


def estimate(value: float, unit: str) -> Estimate:
    return Estimate(value, unit, (0.95 * value, 1.05 * value))


WHERE = {
    "recording": "noload",
    "channel": "i_motor",
    "time": [0.0, 1.0],
    "by_recording": {"noload": 1.0},
    "by_channel": {"i_motor": 1.0},
    "by_regime": [],
}


def explained() -> Diagnosis:
    finding = Finding(
        term="motor_bldc.cogging",
        equivalent=(),
        confidence=0.98,
        onset=ONSET,
        parameters={"A": estimate(A, "N.m")},
        where=WHERE,
        gain=1e4,
    )
    calibrated = {"motor_bldc.winding.R": estimate(R, "Ohm")}
    repaired = calibrated | {"motor_bldc.cogging.A": estimate(A, "N.m")}
    return Diagnosis("explained", [finding], calibrated, repaired)


def unlisted(formula: bool) -> Diagnosis:
    """The same effect as something that no list names: -A*sin(n*phi) at the rotor, or a table of nothing."""
    n = float(load_system("joint").component("motor_bldc").unit.variables["cogging.n"].start)
    form = Form(
        port="motor_bldc.tau_add",
        unit="N.m",
        signals=("phi",),
        features=(Feature(Product((Factor("phi", "sin", n),)), estimate(-A, "N.m")),) if formula else (),
        explains=0.9,
        signal="phi",
        table=None if formula else (np.array([0.0, 1.0]), np.array([0.0, 0.0])),
    )
    finding = Finding("motor_bldc.unlisted", (), 0.9, ONSET, {}, WHERE, 1e4, form)
    calibrated = {"motor_bldc.winding.R": estimate(R, "Ohm")}
    return Diagnosis("unlisted", [finding], calibrated, calibrated)


def knows(diagnosis: Diagnosis):
    def diagnose(campaign: Campaign, *, progress=None, store: Store | None = None) -> Diagnosis:
        return diagnosis

    return lambda baseline, budget: diagnose


def test_the_files_of_a_diagnosis_are_there_and_agree(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "engine", knows(explained()))
    outcome = run.diagnose_campaign(load_campaign(campaign_file), tmp_path)
    assert {"diagnosis.json", "report.html", "repaired.ssp", "repaired_no_load.ssp", "fmus"} <= {
        p.name for p in tmp_path.iterdir()
    }
    content = json.loads((tmp_path / "diagnosis.json").read_text())
    assert content["verdict"] == "explained"
    assert content["findings"][0]["onset"] == ONSET
    for name, sigma in NOISE.items():
        channel = content["channels"][name]
        assert channel["noise"] == pytest.approx(sigma, rel=0.1)
        for role in ("train", "holdout"):
            assert channel[role]["repaired"] == pytest.approx(sigma, rel=0.05)
    for role in ("train", "holdout"):
        assert content["channels"]["w_motor"][role]["calibrated"] > 1.1 * NOISE["w_motor"]
    assert "cogging" in outcome.sentence
    assert "Concealed cogging" in (tmp_path / "report.html").read_text()
    assert content["provenance"] == provenance(
        campaign_file, "Concealed cogging", load_campaign(campaign_file).systems()
    )
    verified = verify(tmp_path, load_campaign(campaign_file))
    for name, channel in verified["channels"].items():
        for variant in ("nominal", "calibrated", "repaired"):
            assert channel[variant] == pytest.approx(content["channels"][name]["holdout"][variant])


def test_an_answer_says_which_files_and_versions_it_comes_from(campaign_file: Path, tmp_path: Path) -> None:
    folder = tmp_path / "moved"
    shutil.copytree(campaign_file.parent, folder)
    campaign = load_campaign(folder)
    said = provenance(campaign.path, campaign.title, campaign.systems())
    read = {name: folder / name for name in ("noload.parquet", "load.parquet", "later.parquet")}
    read |= {path.name: path for path in campaign.setups.values()} | {"campaign.toml": campaign.path}
    text = " ".join(said.values())
    for name, file in read.items():
        assert f"{name} (SHA-256 {hashlib.sha256(file.read_bytes()).hexdigest()[:12]})" in text
    assert said["tool"] == f"cobot-joint {__version__}"
    assert f"numpy {np.__version__}" in said["versions"]
    assert str(tmp_path) not in text
    assert said == provenance(campaign_file, campaign.title, campaign.systems())


@pytest.fixture
def other_machine(tmp_path: Path) -> Path:
    """The bench with another gearhead and thicker grease, which its campaign says."""
    machine = {"planetary_gear.ratio.N": 66.0, "motor_bldc.friction.d": 9e-6}
    text = 'system = "joint"\n[parameters]\n"planetary_gear.ratio.N" = 66\n"motor_bldc.friction.d" = "9 uN.m.s/rad"\n'
    for seed, role in enumerate(("train", "holdout")):
        record(tmp_path, role, "loaded", seed, machine | CONCEALED)
        text += f'[[recording]]\nfile = "{role}.parquet"\nsetup = "loaded"\nrole = "{role}"\n'
    (tmp_path / "campaign.toml").write_text(text)
    return tmp_path / "campaign.toml"


def test_this_machine_s_parameters_are_in_every_result(
    other_machine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "engine", knows(explained()))
    outcome = run.diagnose_campaign(load_campaign(other_machine), tmp_path / "d")
    exported = load_system(tmp_path / "d/repaired.ssp")
    expected = {"planetary_gear.ratio.N": 66.0, "motor_bldc.friction.d": 9e-6, "motor_bldc.winding.R": R}
    for name, value in expected.items():
        component, variable = name.split(".", 1)
        assert float(exported.component(component).unit.variables[variable].start) == value
    told = "planetary_gear.ratio.N = 66.0, motor_bldc.friction.d = 9 uN.m.s/rad"
    assert told in (tmp_path / "d/report.html").read_text()
    assert outcome.diagnosis["channels"]["w_motor"]["train"]["repaired"] == pytest.approx(NOISE["w_motor"], rel=0.1)
    (tmp_path / "alone").mkdir()
    (tmp_path / "alone/diagnosis.json").write_bytes((tmp_path / "d/diagnosis.json").read_bytes())
    for folder in ("d", "alone"):
        figures = verify(tmp_path / folder, load_campaign(other_machine, roles=("holdout",)))["channels"]
        assert figures["tau_sensor"]["repaired"] == pytest.approx(NOISE["tau_sensor"], rel=0.1)
        assert figures["w_motor"]["repaired"] == pytest.approx(NOISE["w_motor"], rel=0.1)
        assert figures["w_motor"]["nominal"] > 1.1 * NOISE["w_motor"]


@pytest.mark.parametrize("formula", [True, False])
def test_an_unlisted_effect_becomes_a_unit_on_the_port(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, formula: bool
) -> None:
    monkeypatch.setattr(run, "engine", knows(unlisted(formula)))
    run.diagnose_campaign(load_campaign(campaign_file), tmp_path)
    assert (tmp_path / "fmus/motor_bldc_correction.fmu").is_file()
    w = json.loads((tmp_path / "diagnosis.json").read_text())["channels"]["w_motor"]["holdout"]
    if formula:
        assert w["repaired"] == pytest.approx(NOISE["w_motor"], rel=0.1)
    else:  # a table of zeros repairs nothing
        assert w["repaired"] == pytest.approx(w["calibrated"], rel=1e-3)


@pytest.mark.parametrize("diagnosis", [explained(), unlisted(True)], ids=["onset", "correction"])
def test_the_repaired_system_is_rebuilt_from_the_answer_alone(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, diagnosis: Diagnosis
) -> None:
    monkeypatch.setattr(run, "engine", knows(diagnosis))
    run.diagnose_campaign(load_campaign(campaign_file), tmp_path / "here")
    (tmp_path / "there").mkdir()
    (tmp_path / "there/diagnosis.json").write_bytes((tmp_path / "here/diagnosis.json").read_bytes())
    campaign = load_campaign(campaign_file, roles=("holdout",))
    there, here = verify(tmp_path / "there", campaign), verify(tmp_path / "here", campaign)
    assert there["channels"] == here["channels"]
    assert (there["system"], here["system"]) == ("built from diagnosis.json", "repaired.ssp, repaired_no_load.ssp")
    assert (tmp_path / "there/repaired.ssp").read_bytes() == (tmp_path / "here/repaired.ssp").read_bytes()


def test_a_wrong_export_does_not_pass(campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """diagnosis.json is right, the exported system lacks the cogging, or one of its units."""
    monkeypatch.setattr(run, "engine", knows(explained()))
    run.diagnose_campaign(load_campaign(campaign_file), tmp_path)
    campaign = load_campaign(campaign_file, roles=("holdout",))
    right = verify(tmp_path, campaign)
    calibrated = repaired_system(load_system("joint_logged"), {"motor_bldc.winding.R": R}, tmp_path / "wrong")
    write_ssp(calibrated, tmp_path / "repaired.ssp")
    wrong = verify(tmp_path, campaign)
    assert wrong["system"] == "repaired.ssp, repaired_no_load.ssp, changed since diagnose wrote it"
    assert wrong["channels"]["w_motor"]["repaired"] > 1.1 * right["channels"]["w_motor"]["repaired"]
    assert wrong["channels"]["w_motor"]["repaired"] == pytest.approx(
        wrong["channels"]["w_motor"]["calibrated"], rel=1e-3
    )
    (tmp_path / "repaired.ssp").unlink()
    with pytest.raises(UserError, match=r"repaired\.ssp': there is none"):
        verify(tmp_path, campaign)


class Evil:
    """What a pickle could carry: creating a file when it is read."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple:
        return (Path.touch, (self.file,))


@pytest.mark.parametrize("name", ["discrepancy.joblib", "discrepancy.npz", ".work/calibrated-0.joblib"])
def test_verify_executes_nothing_that_lies_in_the_folder(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(run, "engine", knows(explained()))
    run.diagnose_campaign(load_campaign(campaign_file), tmp_path / "d")
    (tmp_path / "d" / name).parent.mkdir(exist_ok=True)
    joblib.dump(Evil(tmp_path / "harm"), tmp_path / "d" / name)
    campaign = load_campaign(campaign_file, roles=("holdout",))
    if name.startswith(".work"):
        verify(tmp_path / "d", campaign)
    else:
        with pytest.raises(UserError, match="run cobot-joint diagnose --baseline again"):
            verify(tmp_path / "d", campaign)
    assert not (tmp_path / "harm").exists()


def test_a_baseline_s_correction_of_the_outputs_is_kept_and_verified(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process of one far sample with no weight: an offset of each speed, wherever."""
    one = np.zeros(1)
    shift = Process(one, one + 1, one + 1, 1.0, np.full((1, 1), 1e3), one, offset=2.0, gain=1.0)
    corrected = DiscrepancyDiagnosis(
        "undecided", [], {}, {}, discrepancy=Discrepancy(("v_command",), {"w_motor": shift})
    )
    outputs = {}
    for name, diagnosis in (("plain", Diagnosis("undecided", [], {}, {})), ("corrected", corrected)):
        monkeypatch.setattr(run, "engine", knows(diagnosis))
        run.diagnose_campaign(load_campaign(campaign_file), tmp_path / name)
        verify(tmp_path / name, load_campaign(campaign_file, roles=("holdout",)))
        table = pa.parquet.read_table(tmp_path / name / "verify.parquet")
        outputs[name] = table["w_motor.repaired [rad/s]"].to_numpy()
    assert np.allclose(outputs["corrected"], outputs["plain"] + 2.0, rtol=0, atol=1e-9)


def test_verify_writes_what_anyone_can_recompute(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "engine", knows(explained()))
    run.diagnose_campaign(load_campaign(campaign_file), tmp_path)
    verify(tmp_path, load_campaign(campaign_file, roles=("holdout",)))
    content = json.loads((tmp_path / "verify.json").read_text())
    signals = pa.parquet.read_table(tmp_path / "verify.parquet").to_pandas()
    for name, unit in UNITS.items():
        for variant in ("nominal", "calibrated", "repaired"):
            error = signals[f"{name}.recorded [{unit}]"] - signals[f"{name}.{variant} [{unit}]"]
            assert np.sqrt(np.mean(error**2)) == pytest.approx(content["channels"][name][variant])


def test_where_no_prediction_can_be_had_verify_writes_the_free_runs_and_says_why(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise SimulationError("planetary_gear: fmi2SetReal returned error at t = 0.2 s")

    monkeypatch.setattr(run, "engine", knows(explained()))
    run.diagnose_campaign(load_campaign(campaign_file), tmp_path)
    monkeypatch.setattr("cobot_joint.diagnosis.repair.verify.predicted_figures", fails)
    verify(tmp_path, load_campaign(campaign_file, roles=("holdout",)))
    content = json.loads((tmp_path / "verify.json").read_text())
    assert content["not_predicted"] == "planetary_gear: fmi2SetReal returned error at t = 0.2 s"
    for figures in content["channels"].values():
        assert figures["predicted"] is None
        assert figures["repaired"] > 0


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
        2, f"cobot-joint: --json is given with prove; allowed it is with {allowed}\n"
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
