"""A diagnosis becomes files that agree with one another, and commands that answer as promised.

The engine is replaced by one that knows what a made-up bench conceals, so that only what follows it is tested here.
"""

from __future__ import annotations

import hashlib
import html
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import joblib
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis import run
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.evaluation.baselines import DiscrepancyDiagnosis
from cobot_joint.diagnosis.findings import Diagnosis, Finding
from cobot_joint.diagnosis.provenance import provenance
from cobot_joint.diagnosis.repair import verify as repair_verify
from cobot_joint.diagnosis.repair.discrepancy import Discrepancy, Process
from cobot_joint.diagnosis.repair.export import repaired_system
from cobot_joint.diagnosis.repair.verify import verify
from cobot_joint.diagnosis.store import Store
from cobot_joint.diagnosis.thresholds import WITHHELD
from cobot_joint.errors import UserError
from cobot_joint.system.read import load_system
from cobot_joint.system.write import write_ssp
from cobot_joint.version import __version__
from tests.orchestrator.diagnosis.made_up import (
    CONCEALED,
    NOISE,
    ONSET,
    UNITS,
    WHERE,
    R,
    estimate,
    explained,
    knows,
    record,
    unlisted,
)


def test_where_all_that_was_found_is_refuted_the_refitted_base_model_is_written(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An arm's system was written with a rejected inertia, its angle off by 24 times as much as re-fitted."""
    name = "motor_bldc.winding.R"
    found = Finding(name, (), 0.9, None, {}, dict(WHERE), 1e4)
    monkeypatch.setattr(
        run,
        "engine",
        knows(Diagnosis("explained", [found], {name: estimate(R, "Ohm")}, {name: estimate(9 * R, "Ohm")})),
    )
    run.diagnose_campaign(load_campaign(campaign_file), tmp_path)
    content = json.loads((tmp_path / "diagnosis.json").read_text())
    assert (content["verdict"], content["findings"], content["refuted"]) == ("undecided", [], [name])
    exported = load_system(tmp_path / "repaired.ssp").component("motor_bldc").unit.variables["winding.R"]
    assert float(exported.start) == R
    figures = content["channels"]["i_motor"]["holdout"]
    assert figures["repaired"] == pytest.approx(figures["calibrated"], rel=1e-4)
    assert figures["nominal"] != figures["calibrated"]


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


def test_what_is_no_measurement_is_told_and_not_compared(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(campaign_file.parent, tmp_path / "clipped")
    file = tmp_path / "clipped/later.parquet"
    table = pa.parquet.read_table(file)
    k = next(k for k, name in enumerate(table.column_names) if name.startswith("w_motor"))
    w = table.column(k).to_numpy()
    limited = np.minimum(w, 0.6 * w.max())
    pa.parquet.write_table(table.set_column(k, table.column_names[k], pa.array(limited)), file)
    monkeypatch.setattr(run, "engine", knows(explained()))
    run.diagnose_campaign(load_campaign(tmp_path / "clipped"), tmp_path / "out")
    content = json.loads((tmp_path / "out/diagnosis.json").read_text())
    (out,) = content["not_compared"]
    assert (out["recording"], out["channel"], out["why"], out["of"]) == ("later", "w_motor", "clipped", len(w))
    assert (limited == limited.max()).sum() <= out["samples"] < 0.6 * len(w)
    assert content["channels"]["w_motor"]["holdout"]["repaired"] == pytest.approx(NOISE["w_motor"], rel=0.05)
    said = f"w_motor: {out['samples']} of {len(w)} samples are clipped and not compared, in later"
    assert said in content["notes"]
    assert said in (tmp_path / "out/report.html").read_text()


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


def test_a_repair_that_cannot_be_simulated_in_a_held_out_run_is_withheld_and_the_report_says_so(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The whole diagnosis was lost."""

    def fails(plant: object, loads: object) -> Callable[[Recording], dict[str, np.ndarray]]:
        def simulate(r: Recording) -> dict[str, np.ndarray]:
            if r.role == "holdout":
                raise SimulationError("motor_bldc: fmi2DoStep at 0.3 s gives fmi2Error")
            return {n: np.nan_to_num(y) for n, y in r.outputs.items()}

        return simulate

    monkeypatch.setattr(run, "engine", knows(explained()))
    monkeypatch.setattr(repair_verify, "acted_on", fails)
    outcome = run.diagnose_campaign(load_campaign(campaign_file), tmp_path)
    assert (outcome.diagnosis["verdict"], outcome.diagnosis["repair"]) == ("undecided", "withheld")
    why = "the repaired system cannot be simulated (motor_bldc: fmi2DoStep at 0.3 s gives fmi2Error)"
    assert any(why in note for note in outcome.diagnosis["notes"])
    assert why in (tmp_path / "report.html").read_text()
    assert outcome.diagnosis["channels"]["w_motor"]["holdout"]["repaired"] is None


def test_a_confidence_that_something_else_limits_says_what(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The report quoted the count of findings that are as unsure by themselves."""
    limited = explained()
    limited.findings = [f.withheld("a channel's time stamps may be wrong") for f in limited.findings]
    monkeypatch.setattr(run, "engine", knows(limited))
    (finding,) = run.diagnose_campaign(load_campaign(campaign_file), tmp_path).diagnosis["findings"]
    assert (finding["confidence"], finding["limited_by"]) == (WITHHELD, "a channel's time stamps may be wrong")
    told = "45 %: less than even, since a channel's time stamps may be wrong"
    assert told in html.unescape((tmp_path / "report.html").read_text())


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


def test_killed_while_finished_stages_are_deleted_it_has_not_answered_yet(
    campaign_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`prove` takes a case with a diagnosis.json for finished, and left hundreds of MB beside one."""

    def killed(store: Store) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "engine", knows(explained()))
    monkeypatch.setattr(Store, "clear", killed)
    with pytest.raises(KeyboardInterrupt):
        run.diagnose_campaign(load_campaign(campaign_file), tmp_path / "d")
    assert not (tmp_path / "d/diagnosis.json").exists()


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
