"""Baselines answer in the diagnosis's own form, so that the same scoreboard holds them against it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis import archive
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.evaluation import baselines
from cobot_joint.diagnosis.evaluation.sparse import sparse_regression
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.errors import UserError
from cobot_joint.system.read import find_system, load_system

pytest.importorskip("pysindy", reason="baselines need the optional extra [baselines]")
pytest.importorskip("sklearn", reason="baselines need the optional extra [baselines]")

SYSTEM = "joint_no_load_logged"
NOISE = {"i_motor": 4e-3, "w_motor": 0.3}


def recorded(concealed: dict[str, float], seed: int, role: str = "train") -> Recording:
    """Four seconds without load, both ways."""
    rng = np.random.default_rng(seed)
    t = np.arange(4001) * 1e-3
    command = np.interp(t, [0.2, 0.6, 1.4, 2.2, 3.0, 3.6], [0, 8 + seed, 8 + seed, -6, -6, 3])
    empty = {name: np.zeros(len(t)) for name in NOISE}
    units = {"i_motor": "A", "w_motor": "rad/s"}
    run = Recording(f"run{seed}", role, "no_load", t, {"v_command": command}, empty, units)  # type: ignore[arg-type]
    with Simulator({"no_load": load_system(SYSTEM)}, concealed) as bench:
        run.outputs = {name: x + NOISE[name] * rng.standard_normal(len(t)) for name, x in bench(run).items()}
    return run


def campaign(concealed: dict[str, float]) -> Campaign:
    runs = [recorded(concealed, 0), recorded(concealed, 1), recorded(concealed, 2, "holdout")]
    return Campaign("made up", Path("campaign.toml"), "joint", {"no_load": find_system(SYSTEM)}, {}, {}, {}, runs)


@pytest.mark.parametrize(
    ("concealed", "claims"),
    [
        ({}, set()),
        ({"motor_bldc.dead_time.V": 0.1}, {"motor_bldc.dead_time"}),
        ({"motor_bldc.friction_asymmetry.tau_A": 4e-4}, {"motor_bldc.friction_asymmetry"}),
    ],
)
def test_sparse_regression_names_what_stands_alone(concealed: dict[str, float], claims: set[str]) -> None:
    found = sparse_regression(campaign(concealed), {})
    assert {f.term for f in found.findings} == claims
    assert found.verdict == ("explained" if claims else "nothing_missing")


def test_sparse_regression_knows_one_system_only() -> None:
    other = campaign({})
    other.system = "axis.ssd"
    with pytest.raises(UserError, match=r"knows the equations of the joint, system 'axis\.ssd' is given"):
        sparse_regression(other, {})


def test_a_gaussian_process_corrects_runs_it_has_not_seen_and_names_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(baselines, "calibrate", lambda *_: ({}, False))
    made_up = campaign({"motor_bldc.winding.k": 0.0228})
    found = baselines.gaussian_process(made_up)
    assert found.findings == []
    assert found.verdict == "undecided"
    discrepancy = found.discrepancy  # type: ignore[attr-defined]
    (unseen,) = made_up.holdout
    with Simulator({"no_load": load_system(SYSTEM)}) as before:
        plain, corrected = before(unseen)["w_motor"], discrepancy.around(before)(unseen)["w_motor"]
    error = [np.sqrt(np.mean((unseen.outputs["w_motor"] - x) ** 2)) for x in (plain, corrected)]
    assert error[1] < 0.5 * error[0]


def test_a_process_predicts_what_scikit_learn_does_and_is_kept_without_it(tmp_path: Path) -> None:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
    from sklearn.preprocessing import StandardScaler

    rng = np.random.default_rng(2)
    z = rng.normal(3.0, [1.0, 20.0], (80, 2))
    y = 5 + np.sin(z[:, 0]) + 0.1 * z[:, 1] + 0.05 * rng.standard_normal(80)
    scaler = StandardScaler().fit(z)
    process = GaussianProcessRegressor(ConstantKernel() * RBF(np.ones(2)) + WhiteKernel(), normalize_y=True)
    process.fit(scaler.transform(z), y)
    at = rng.normal(3.0, [1.5, 30.0], (50, 2))
    archive.save(tmp_path / "p.npz", baselines._plain(scaler, process))
    kept = archive.load(tmp_path / "p.npz")
    assert np.allclose(kept(at), process.predict(scaler.transform(at)), rtol=1e-12, atol=1e-12)
