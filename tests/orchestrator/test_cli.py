"""The command as a user types it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import fmpy
import pyarrow.parquet as pq
import pytest

from cobot_joint.cli import main
from cobot_joint.cosim import SCHEMES
from cobot_joint.results.files import read_provenance
from cobot_joint.scenario.model import scenario_names
from cobot_joint.scenario.options import LEVELS
from cobot_joint.system import load_system
from cobot_joint.version import __version__


def cobot_joint(*words: str, folder: Path, columns: int | None = None) -> subprocess.CompletedProcess[str]:
    call = [sys.executable, "-m", "cobot_joint", *words]
    here = {name: value for name, value in os.environ.items() if name != "COLUMNS"}  # of whoever runs the tests
    here |= {"COLUMNS": str(columns)} if columns else {}
    return subprocess.run(call, cwd=folder, env=here, capture_output=True, text=True, check=False)


def test_run_prints_tables_and_where_its_files_are(tmp_path: Path) -> None:
    done = cobot_joint("run", "load_mr_brake", "--set", "stop_time=0.2", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    for name in ("signals.parquet", "signals.html", "signals.png", "summary.json"):
        assert f"results/load_mr_brake/{name}" in done.stdout
        assert (tmp_path / "results" / "load_mr_brake" / name).is_file()
    assert "motor_bldc.shaft -> planetary_gear.input" in done.stdout
    assert "w_motor [rad/s]" in done.stdout


def test_run_takes_a_scenario_of_ones_own_and_writes_where_it_is_told(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('system = "joint"\nstop_time = 0.1\n[inputs.v_command]\npoints = [[0, 2]]\n')
    assert cobot_joint("run", "mine.toml", "--out", "here", folder=tmp_path).returncode == 0
    assert pq.read_metadata(tmp_path / "here" / "signals.parquet").num_rows == 101


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "laod"], "scenario 'laod': there is none, allowed are"),
        (["run"], "Missing argument"),
        (["rum", "no_load"], "No such command 'rum'."),
        (["run", "no_load", "--steps", "1"], "No such option: --steps"),
        (["run", "no_load", "--step", "short"], "Invalid value for '--step'"),
        (["run", "no_load", "--step", "0"], "step 0 s is given, it has to be positive"),
        (["run", "no_load", "--scheme", "jacobi", "--step", "3e-4"], "has to be a multiple of it"),
        (["run", "no_load", "--scheme", "newton"], "scheme 'newton' is given, allowed are jacobi"),
        (["run", "no_load", "--level", "simple"], "--level 'simple' is given, transfer_function, averaged"),
        (["run", "no_load", "--set", "stop_time"], "NAME=VALUE is allowed"),
        (["run", "no_load", "--set", "stop=1"], "stop: no such key, allowed are"),
        (["run", "no_load", "--set", "motor_bldc.winding.R=-1"], "-1 Ohm is given, 1e-06 to 10000 Ohm is allowed"),
        (["run", "no_load", "--set", "motor.winding.R=1"], "no such component of joint_no_load, it has motor_bldc"),
        (["run", "no_load", "--out", "file"], "--out file: a folder that can be written is needed"),
        (["run", "no_load", "--unit", "planetary_gear"], "NAME=FILE is allowed"),
        (["run", "no_load", "--unit", "planetary_gear=file"], "file: not a zip file"),
        (["export", "--system", "joynt"], "system 'joynt': there is none, allowed are"),
    ],
)
def test_wrong_call_is_one_line_on_stderr_and_status_2(
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["cobot-joint", *words])
    with pytest.raises(SystemExit) as left:
        main()
    out, error = capfd.readouterr()
    assert (left.value.code, out) == (2, "")
    assert said in error
    assert error.count("\n") == 1


def test_missing_fmu_is_one_line_on_stderr_and_status_2(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('system = "mine.ssd"\nstop_time = 1\n')
    (tmp_path / "mine.ssd").write_text(
        '<ssd:SystemStructureDescription version="1.0" name="mine"'
        ' xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"><ssd:System name="mine"><ssd:Elements>'
        '<ssd:Component name="a" source="nowhere.fmu"/></ssd:Elements></ssd:System></ssd:SystemStructureDescription>'
    )
    done = cobot_joint("run", "mine.toml", folder=tmp_path)
    assert done.returncode == 2
    assert "nowhere.fmu: there is no such FMU, looked for in" in done.stderr
    assert done.stderr.count("\n") == 1


def test_check_says_what_a_foreign_unit_lacks_and_fails_where_it_does_not_fit(
    foreign_gear: Callable[..., Path], tmp_path: Path
) -> None:
    fits = cobot_joint("--json", "check", str(foreign_gear()), "--as", "planetary_gear", folder=tmp_path)
    assert fits.returncode == 0
    lacks = [f["what"] for f in json.loads(fits.stdout)["findings"] if f["verdict"] == "lacks"]
    assert "takes a step back" in lacks
    other = foreign_gear("other", names={"tau": "tau_m"})
    refused = cobot_joint("check", str(other), "--as", "planetary_gear", folder=tmp_path)
    assert refused.returncode == 1
    assert "its outputs in [N.m] are tau_m" in refused.stdout


def test_a_foreign_unit_runs_in_a_scenario_with_its_own_names(
    foreign_gear: Callable[..., Path], tmp_path: Path
) -> None:
    gear = foreign_gear(names={"tau": "tau_m"}, without=("J_coupled", "tau_g"))
    words = ["--unit", f"planetary_gear={gear}:tau=tau_m,J_coupled=,tau_g=", "--set", "stop_time=2"]
    done = cobot_joint("--json", "run", "load_mr_brake", *words, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)["values"]
    assert values["scheme"] == "gauss_seidel_extrapolated"
    assert abs(values["energy residual motor_bldc.shaft -> planetary_gear.tau_m"]) < 0.01


def test_unit_that_fails_while_it_runs_is_one_line_and_status_1(tmp_path: Path) -> None:
    # a communication step of a second over a mesh of 3000 N.m/rad: torques grow beyond all numbers
    words = ["--scheme", "jacobi", "--step", "1", "--set", "output_step=1", "--set", "stop_time=400"]
    done = cobot_joint("run", "load_mr_brake", *words, folder=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("cobot-joint: ")
    assert done.stderr.count("\n") == 1
    assert [p.name for p in (tmp_path / "results" / "load_mr_brake").iterdir()] == ["signals.parquet"]
    assert "signals.parquet has the " in done.stderr


def test_export_holds_the_four_fmus_and_the_system(tmp_path: Path) -> None:
    done = cobot_joint("export", "--out", "out", folder=tmp_path)
    assert done.returncode == 0
    units = ["motor_bldc", "planetary_gear", "torque_sensor", "mr_brake_belt"]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {*(f"{unit}.fmu" for unit in units), "joint.ssp"}
    for unit in units:
        assert fmpy.read_model_description(str(tmp_path / "out" / f"{unit}.fmu")).modelName == unit
    exported = load_system(tmp_path / "out" / "joint.ssp")
    assert exported.connections == load_system("joint").connections
    assert all(c.unit.path.is_relative_to(exported.components[0].unit.path.parent) for c in exported.components)


def test_units_of_no_shipped_system_can_be_exported(tmp_path: Path) -> None:
    done = cobot_joint("export", "--unit", "driven_load", "--unit", "acquisition", "--flat-names", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    for unit in ("driven_load", "acquisition"):
        description = fmpy.read_model_description(str(tmp_path / "export" / f"{unit}.fmu"))
        assert not [v.name for v in description.modelVariables if "." in v.name]
    refused = cobot_joint("export", "--unit", "gear", folder=tmp_path)
    assert refused.returncode == 2
    assert "gear.fmu: there is no such FMU" in refused.stderr


@pytest.mark.parametrize("importer", ["ecos", "libcosim"])
def test_export_for_an_importer_leaves_out_what_it_does_not_open(importer: str, tmp_path: Path) -> None:
    done = cobot_joint("export", "--for", importer, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "export" / "OspSystemStructure.xml").is_file() == (importer == "libcosim")
    assert not load_system(tmp_path / "export" / "joint.ssp").inputs


def test_export_writes_reference_files_for_every_unit(tmp_path: Path) -> None:
    cobot_joint("export", "--reference", "--unit", "driven_load", folder=tmp_path)
    units = [fmu.stem for fmu in (tmp_path / "export").glob("*.fmu")]
    assert len(units) == 5
    expected = {f"{unit}_{kind}" for unit in units for kind in ("in.csv", "ref.csv", "ref.opt")}
    assert {f.name for f in (tmp_path / "export").iterdir() if f.suffix in (".csv", ".opt")} == expected


def test_exported_unit_runs_in_fmpy(tmp_path: Path) -> None:
    cobot_joint("export", folder=tmp_path)
    result = fmpy.simulate_fmu(
        str(tmp_path / "export" / "motor_bldc.fmu"), stop_time=0.1, start_values={"set_value": 6.0}
    )
    assert result["w"][-1] > 50


def test_help_names_every_command(tmp_path: Path) -> None:
    done = cobot_joint("--help", folder=tmp_path)
    assert done.returncode == 0
    assert all(command in done.stdout for command in ("run", "demo", "export"))


def test_help_of_run_names_every_scheme_and_every_level(tmp_path: Path) -> None:
    said = cobot_joint("run", "--help", folder=tmp_path).stdout
    assert set(SCHEMES) <= set(said.split())
    assert all(level in said for level in LEVELS)


@pytest.mark.parametrize(("begun", "offered"), [(["dia"], "diagnose"), (["run", "load_mr"], "load_mr_brake")])
def test_the_shell_completes_commands_and_scenarios(
    begun: list[str], offered: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("_COBOT_JOINT_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", " ".join(["cobot-joint", *begun]))
    monkeypatch.setenv("COMP_CWORD", str(len(begun)))
    assert cobot_joint(folder=tmp_path).stdout.split() == [offered]


def test_version_is_the_packages(tmp_path: Path) -> None:
    assert cobot_joint("--version", folder=tmp_path).stdout == f"cobot-joint {__version__}\n"


def test_list_has_every_scenario_with_its_settings(tmp_path: Path) -> None:
    lines = cobot_joint("run", "--list", folder=tmp_path).stdout.splitlines()
    assert {line.split()[0] for line in lines if line[0] != " "} == {"scenario", *scenario_names()}
    assert any("load_mr_brake" in line and "stop_time=20" in line for line in lines)


def test_quiet_says_nothing(tmp_path: Path) -> None:
    done = cobot_joint("run", "load_mr_brake", "--set", "stop_time=0.1", "-q", folder=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_json_has_values_tables_and_files(tmp_path: Path) -> None:
    done = cobot_joint("run", "load_mr_brake", "--set", "stop_time=0.1", "--json", folder=tmp_path)
    said = json.loads(done.stdout)
    assert said["values"]["scheme"] == "adaptive"
    assert [table["title"] for table in said["tables"]] == ["signals", "energy"]
    assert all((tmp_path / file).is_file() for file in said["files"])
    exported = json.loads(cobot_joint("export", "--json", folder=tmp_path).stdout)
    assert "export/joint.ssp" in exported["files"]


def test_verbose_traces_an_error_to_where_it_arose(tmp_path: Path) -> None:
    done = cobot_joint("run", "laod", "-v", folder=tmp_path)
    assert done.returncode == 2
    assert "Traceback" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("cobot-joint: scenario 'laod'")


@pytest.mark.parametrize("scenario", ["load_mr_brake", "torque_calibration", "current_sensor_calibration"])
def test_tables_fit_80_columns(scenario: str, tmp_path: Path) -> None:
    settings = ["--set", "stop_time=0.1"] if scenario == "load_mr_brake" else ["--set", "settle=0.05"]
    done = cobot_joint("run", scenario, *settings, folder=tmp_path, columns=80)
    assert done.returncode == 0
    tables = [line for line in done.stdout.splitlines() if line[:1] in "┏┃┡│└"]
    assert tables
    assert max(map(len, tables)) <= 80
    assert "…" not in done.stdout


def test_a_unit_takes_anothers_place(tmp_path: Path, fmu: Callable[[str], Path]) -> None:
    shutil.copy(fmu("planetary_gear"), tmp_path / "my_gear.fmu")
    words = ["run", "load_mr_brake", "--set", "stop_time=0.1"]
    assert cobot_joint(*words, "--unit", "planetary_gear=my_gear.fmu", "--out", "own", folder=tmp_path).returncode == 0
    assert cobot_joint(*words, "--out", "shipped", folder=tmp_path).returncode == 0
    own, shipped = (tmp_path / name / "signals.parquet" for name in ("own", "shipped"))
    assert pq.read_table(own).equals(pq.read_table(shipped))
    assert read_provenance(own)["fmus"]["planetary_gear"]["file"] == "my_gear.fmu"


def test_a_system_runs_its_default_experiment(tmp_path: Path) -> None:
    assert cobot_joint("export", "--out", ".", folder=tmp_path).returncode == 0
    done = cobot_joint("run", "joint.ssp", "--set", "stop_time=0.1", "--set", "output_step=0.01", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert pq.read_metadata(tmp_path / "results" / "joint" / "signals.parquet").num_rows == 11
    by_name = cobot_joint("run", "joint", "--set", "stop_time=0.1", "--out", "named", folder=tmp_path)
    assert by_name.returncode == 0


def test_a_system_without_outputs_records_those_of_its_units(tmp_path: Path) -> None:
    (tmp_path / "bare.ssd").write_text(
        '<ssd:SystemStructureDescription version="1.0" name="bare"'
        ' xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"><ssd:System name="bare"><ssd:Elements>'
        '<ssd:Component name="sensor" source="torque_sensor.fmu"/></ssd:Elements></ssd:System>'
        '<ssd:DefaultExperiment startTime="0" stopTime="0.1"/></ssd:SystemStructureDescription>'
    )
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "bare.toml").write_text('system = "bare.ssd"\nstop_time = 0.1\n')
    for what in ("../bare.ssd", "../bare.toml"):  # a file's system is looked for beside that file
        done = cobot_joint("run", what, "--out", "out", folder=tmp_path / "elsewhere")
        assert done.returncode == 0, done.stderr
        names = pq.read_schema(tmp_path / "elsewhere" / "out" / "signals.parquet").names
        assert "sensor.tau_s [N.m]" in names


@pytest.mark.long
def test_demo_says_where_the_pictures_are(tmp_path: Path) -> None:
    done = cobot_joint("demo", folder=tmp_path)
    assert done.returncode == 0
    said = done.stdout.split("The pictures are")[1].split()
    assert [Path(p).name for p in said] == ["frequency_response.png", "signals.png"]
    assert all((tmp_path / p).stat().st_size > 10_000 for p in said)


@pytest.mark.skipif(sys.platform == "win32", reason="file names there hold no control characters")
def test_control_characters_of_files_are_shown_and_not_carried_out(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text('title = "\\u001b[31mred"\nsystem = "joint"\nstop_time = 0.01\n')
    (tmp_path / "a\x1b[31m.csv").write_text("time [s],v [V]\n" + "\n".join(f"{k / 1000},{k}" for k in range(99)))
    for words in (["run", "s.toml"], ["inspect", "a\x1b[31m.csv"], ["inspect", "none\x1b[31m.csv"]):
        done = cobot_joint(*words, folder=tmp_path)
        assert "\x1b" not in done.stdout + done.stderr
        assert r"\x1b[31m" in done.stdout + done.stderr
