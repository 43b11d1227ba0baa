"""`import cobot_joint`: what it offers, that it is light, and ten lines from a system to results."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cobot_joint as cj
from cobot_joint.errors import UserError
from cobot_joint.results.diagnosed import Diagnosed
from cobot_joint.results.files import SignalsWriter


def test_the_import_loads_no_library() -> None:
    heavy = {"numpy", "fmpy", "pyarrow", "scipy", "matplotlib", "plotly", "pydantic", "typer"}
    program = f"import sys, cobot_joint; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_help_loads_nothing_that_simulates() -> None:
    heavy = {"numpy", "fmpy", "pyarrow", "scipy", "matplotlib", "plotly", "pydantic"}
    program = f"import sys, cobot_joint.cli; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_run_of_a_scenario_loads_neither_scipy_nor_plotly_nor_matplotlib_nor_pandas(tmp_path: Path) -> None:
    heavy = {"scipy", "plotly", "matplotlib", "pandas", "joblib"}
    program = (
        "import sys; from cobot_joint.cli import _status\n"
        "status = _status(['-q', 'run', 'load_mr_brake', '--set', 'stop_time=0.1', '--out', sys.argv[1]])\n"
        f"print(status, sorted({heavy} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program, tmp_path], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0 []"
    assert (tmp_path / "signals.png").read_bytes()[:4] == b"\x89PNG"


def test_what_is_offered_is_there() -> None:
    for name in cj.__all__:
        assert getattr(cj, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'simulate', it has Experiment"):
        cj.simulate  # noqa: B018


def test_run_takes_a_scenario_by_name_and_parameters_over_it() -> None:
    short = cj.load_system("joint")
    experiment = cj.Experiment(cj.Inputs(np.array([0.0, 0.1]), {"v_command": np.array([0.0, 6.0])}), 0.3)
    plain = cj.run(short, experiment)
    weak = cj.run("joint", experiment, parameters={"motor_bldc.winding.R": 0.4})
    assert plain.units["i_motor"] == "A"
    assert weak["i_motor"].max() < 0.95 * plain["i_motor"].max()
    named = cj.run(short, "load_mr_brake")
    assert named.time[-1] == pytest.approx(20.0)
    np.testing.assert_array_equal(named["i_motor"], cj.run("load_mr_brake")["i_motor"])


def test_a_system_without_an_experiment_runs_its_default_one() -> None:
    system = cj.load_system("joint")
    result = cj.run(system)
    assert result.time[-1] == pytest.approx(system.default_experiment.stop_time)
    assert np.all(result["w_motor"] == 0)  # nothing drives it


def test_run_refuses_what_takes_several_runs() -> None:
    with pytest.raises(UserError, match="frequency_response takes several runs: `cobot-joint run frequency_response`"):
        cj.run("frequency_response")


def test_sweep_runs_the_grid_and_gives_what_single_runs_give() -> None:
    experiment = cj.Experiment(cj.Inputs(np.array([0.0, 0.1]), {"v_command": np.array([0.0, 6.0])}), 0.1)
    grid = {"motor_bldc.winding.R": [0.2, 0.3], "motor_bldc.winding.k": [0.023, 0.024]}
    found = cj.sweep("joint", experiment, grid, jobs=1)
    assert len(found) == 4
    assert not found.errors
    for at, result in found:
        alone = cj.run("joint", experiment, parameters=at)
        assert result["i_motor"].tobytes() == alone["i_motor"].tobytes()


def test_load_results_opens_what_run_wrote(tmp_path: Path) -> None:
    call = [sys.executable, "-m", "cobot_joint", "run", "load_mr_brake", "--set", "stop_time=0.2"]
    subprocess.run([*call, "--out", tmp_path], check=True, capture_output=True)
    for path in (tmp_path, tmp_path / "signals.parquet", str(tmp_path)):
        result = cj.load_results(path)
        assert result.units["tau_sensor"] == "N.m"
        assert result.provenance["scenario"] == "load_mr_brake"
        assert abs(result.energy_residual("motor_bldc.shaft -> planetary_gear.input")) < 1e-3


def test_load_results_opens_what_diagnose_wrote(root: Path) -> None:
    found = cj.load_results(root / "proof/sealed/case30")
    assert found.verdict in ("nothing_missing", "explained", "unlisted", "undecided")
    assert found.findings == found.content["findings"]


@pytest.mark.long
def test_diagnose_takes_a_campaign_and_its_results_open_again(tmp_path: Path) -> None:
    step = cj.Inputs(np.array([0.0, 0.3, 0.6]), {"v_command": np.array([0.0, 0.0, 9.0])})
    run = cj.run("joint_no_load", cj.Experiment(step, 1.5, record=["v_command", "i_motor", "w_motor"]))
    noise = {"i_motor": 4e-3, "w_motor": 0.3, "v_command": 0.0}
    rng = np.random.default_rng(3)
    columns = {"time": "s", **run.units}
    with SignalsWriter(tmp_path / "log.parquet", columns, {}) as writer:
        measured = {name: x + noise[name] * rng.standard_normal(len(x)) for name, x in run.signals.items()}
        writer.write({"time": run.time, **measured})
    (tmp_path / "campaign.toml").write_text(
        'title = "Healthy"\nsystem = "joint"\n[[recording]]\nfile = "log.parquet"\nsetup = "no_load"\nrole = "train"\n'
    )
    said: list[str] = []
    found = cj.diagnose(tmp_path, progress=said.append)
    assert said
    assert found.verdict == "nothing_missing"
    assert found.report.is_file()
    assert cj.load_system(found.repaired).components
    again = cj.load_results(tmp_path / "diagnosis")
    assert isinstance(again, Diagnosed)
    assert (again.verdict, again.findings) == (found.verdict, found.findings)


def test_diagnose_refuses_what_is_no_campaign(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"campaign\.toml"):
        cj.diagnose(tmp_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_load_results_says_what_it_needs(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"a folder with signals\.parquet or diagnosis\.json, or a \.parquet file"):
        cj.load_results(tmp_path)
