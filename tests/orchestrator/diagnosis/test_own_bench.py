"""From a log, or from nothing, to a first campaign."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.diagnosis.checks.inspection import inspect_log
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import guess
from cobot_joint.diagnosis.drafts.chain import chain, with_data_sheet, write_readable
from cobot_joint.diagnosis.plant.correction import formula_parameters
from cobot_joint.diagnosis.repair.export import Correction, with_correction
from cobot_joint.system import load_system
from cobot_joint.system.model import Inputs, System
from tests.orchestrator.diagnosis.typed import Done

T = np.arange(4000) * 1e-3


def write(folder: Path, name: str) -> None:
    rng = np.random.default_rng(2)
    columns = [1e3 * T, 3 * np.sin(3 * T), 300 * np.sin(3 * T) + rng.normal(0, 4, len(T)), 2e3 * np.sin(3 * T)]
    columns[3] = np.minimum(columns[3] + rng.normal(0, 2, len(T)), 1500)
    rows = [";".join(f"{x:.6g}".replace(".", ",") for x in row) for row in zip(*columns, strict=True)]
    text = "Prüfstand;7\n\nZeit;U_soll;I_mot;n_mot\nms;V;mA;U/min\n" + "\n".join(rows)
    (folder / name).write_text(text, encoding="latin-1")


def test_inspect_says_what_a_log_holds_and_what_looks_wrong(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    write(tmp_path, "a.csv")
    done = cobot_joint("inspect", "a.csv", "--out", "look")
    assert (done.returncode, done.stderr) == (0, "")
    assert "a.csv: clock Zeit, 4000 samples, 3.999 s at 1000 Hz, 0 not recorded" in done.stdout
    assert [word in done.stdout for word in ("U_soll", "mA", "U/min", "noise", "saturated")] == [True] * 5
    assert "n_mot: clipped at the top, 1500" in done.stdout
    assert (tmp_path / "look/a.png").stat().st_size > 10_000


def test_inspect_with_a_system_writes_a_campaign_that_loads_with_its_guesses_marked(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    for name in ("a.csv", "b.csv"):
        write(tmp_path, name)
    done = cobot_joint("inspect", "a.csv", "b.csv", "--system", "joint")
    assert (done.returncode, done.stderr) == (0, "")
    text = (tmp_path / "campaign.toml").read_text()
    assert '"n_mot [U/min]" = "w_motor"   # guess: by its name' in text
    campaign = load_campaign(tmp_path / "campaign.toml")
    assert [(r.name, r.role) for r in campaign.recordings] == [("a", "train"), ("b", "holdout")]
    assert (set(campaign.train[0].inputs), set(campaign.train[0].outputs)) == ({"v_command"}, {"i_motor", "w_motor"})
    again = cobot_joint("inspect", "a.csv", "--system", "joint")
    assert again.returncode == 2
    assert "campaign.toml is there already" in again.stderr


@pytest.mark.parametrize(
    ("above", "separator", "encoding", "options"),
    [
        ("bench 7\nrun, 3, of 4\n", ",", "utf-8", ["--skip", "2"]),
        ("", ";", "utf-8", ["--separator", ";"]),
        ("", "\t", "utf-8", ["--separator", "tab"]),
        ("", ",", "latin-1", ["--encoding", "latin-1", "--time", "Zeit [s]"]),
    ],
)
def test_what_inspect_was_told_of_a_file_stands_in_its_draft(
    tmp_path: Path, cobot_joint: Callable[..., Done], above: str, separator: str, encoding: str, options: list[str]
) -> None:
    """Without `skip` its draft was refused, and another remedy offered."""
    names = ["Zeit [s]", "v_command [V]", "w_motor [rad/s]", "Öltemp [degC]"]
    rows = [separator.join(map(str, row)) for row in zip(T, np.sin(T), 20 * np.cos(3 * T), 40 + T, strict=True)]
    text = above + "\n".join([separator.join(names), *rows]) + "\n"
    (tmp_path / "run.csv").write_bytes(text.encode(encoding))
    done = cobot_joint("inspect", "run.csv", "--system", "joint", "--out", "first", *options)
    assert (done.returncode, done.stderr) == (0, "")
    (run,) = load_campaign(tmp_path / "first/campaign.toml").recordings
    np.testing.assert_allclose(run.outputs["w_motor"], 20 * np.cos(3 * T), atol=1e-6)


def test_a_set_value_may_stand_still_and_a_jittered_logs_steps_are_those_of_the_file(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    rng = np.random.default_rng(1)
    t = T + rng.uniform(-1e-4, 1e-4, len(T))
    moves = 300 * np.sin(3 * t) + rng.normal(0, 4, len(t))
    columns = {
        "t [s]": np.sort(t),
        "U_set [V]": np.where(t % 2 < 1, 6.0, -6.0),
        "n_motor [rpm]": np.round(moves / 5) * 5,
    }
    log(tmp_path, "run.csv", columns)
    said = cobot_joint("inspect", "run.csv").stdout
    assert "frozen" not in said
    (row,) = [line.split("│") for line in said.splitlines() if "n_motor" in line and "│" in line]
    assert row[6].strip() == "5"


def test_new_asks_what_a_loop_commands_and_takes_choices_from_the_data_sheet(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    done = cobot_joint("new", "--chain", "loop,motor,load", "--out", "a")
    assert "--set motor.drive.mode=current" in done.stdout
    done = cobot_joint("new", "--chain", "loop,motor,load", "--set", "motor.drive.mode=current", "--set",
                       "motor.friction.law=smooth", "--set", "load.inertia=2 kgm2", "--out", "b")  # fmt: skip
    assert (done.returncode, "--set motor.drive.mode" in done.stdout) == (0, False), done.stderr
    motor = load_system(tmp_path / "b/system.ssd").component("motor")
    assert motor.parameters["drive.mode"] != load_system(tmp_path / "a/system.ssd").component("motor").parameters.get(
        "drive.mode"
    )


def test_pictures_of_logs_of_one_name_are_kept_apart(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    for day in ("day1", "day2"):
        (tmp_path / day).mkdir()
        write(tmp_path / day, "run.csv")
    assert cobot_joint("inspect", "day1/run.csv", "day2/run.csv", "--out", "look").returncode == 0
    assert {"run (1).png", "run (2).png"} <= {p.name for p in (tmp_path / "look").iterdir()}


def test_a_chain_of_two_parts_is_a_chain(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    done = cobot_joint("new", "--chain", "motion,sensor", "--out", "machine")
    assert (done.returncode, done.stderr) == (0, "")
    assert {p.name for p in (tmp_path / "machine").iterdir()} == {"system.ssd", "campaign.toml"}


def test_a_chain_of_no_parts_is_refused(cobot_joint: Callable[..., Done]) -> None:
    done = cobot_joint("new", "--chain", "", "--out", "machine")
    assert done.returncode == 2
    assert "--chain '': there is no such part" in done.stderr


def test_inspect_drafts_a_campaign_from_a_table_that_has_no_clock(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    w = np.linspace(-300, 300, 12)
    lines = [f"{v:.1f},{1e-4 * v + 0.02 * np.sign(v):.6f}" for v in w]
    (tmp_path / "axis.csv").write_text("qd [rad/s],T_mess [N.m]\n" + "\n".join(lines))
    assert cobot_joint("new", "--chain", "friction", "--out", "machine").returncode == 0
    (tmp_path / "machine/campaign.toml").unlink()
    done = cobot_joint("inspect", "axis.csv", "--system", "machine/system.ssd", "--out", "machine")
    assert (done.returncode, done.stderr) == (0, "")
    assert "axis.csv: 12 rows, 0 values missing" in done.stdout
    assert "no column is a clock: each row is taken for a steady state" in done.stdout
    assert 'table = "rows"' in (tmp_path / "machine/campaign.toml").read_text()
    table = load_campaign(tmp_path / "machine/campaign.toml").train[0]
    assert (set(table.inputs), set(table.outputs)) == ({"w"}, {"tau"})
    assert table.scatter


def test_of_columns_in_a_unit_the_only_one_left_is_taken_for_the_connector_that_is_left() -> None:
    nothing = np.zeros(0)
    connectors = {n: Connector(n, "output", "rad/s") for n in ("w_motor", "w_load")}
    columns = [Channel(n, "rpm", nothing, nothing) for n in ("n_motor", "xyz")]
    found = {g.connector: (g.column.name, g.why) for g in guess(columns, connectors)}
    assert found["w_load"] == ("xyz", "the only one left in this unit")
    assert found["w_motor"][0] == "n_motor"
    assert len(guess([*columns, Channel("abc", "rpm", nothing, nothing)], connectors)) == 1


def test_a_slow_clock_is_no_error_for_who_only_looks(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    (tmp_path / "a.csv").write_text("t,w\n" + "\n".join(f"{k},{np.sin(k / 50)}" for k in range(500)))
    done = cobot_joint("inspect", "a.csv")
    assert done.returncode == 0
    assert "the clock steps by 1 s: if it counts ms, say time = 't [ms]'" in done.stdout


def test_new_writes_a_system_and_a_campaign_over_it(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    done = cobot_joint("new", "--chain", "motor,gear,load", "--set", "motor.R=0.61 Ohm", "--out", "mine")
    assert (done.returncode, done.stderr) == (0, "")
    assert "stands between gear and load; that stiffness is assumed" in " ".join(done.stdout.split())
    rows = "\n".join(f"{t},{np.sin(t)},{np.cos(t)},{100 * np.sin(t)},{np.sin(t)}" for t in T)
    for name in ("run1.csv", "run2.csv"):
        (tmp_path / "mine" / name).write_text(f"time,v_command,i_motor,w_motor,w_load\n{rows}")
    campaign = load_campaign(tmp_path / "mine/campaign.toml")
    assert set(campaign.outputs) == {"i_motor", "w_motor", "w_load"}
    assert campaign.tolerances["motor.winding.R"].relative == pytest.approx(0.05)


def test_new_starts_from_a_shipped_system_as_well(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    done = cobot_joint("new", "--from", "joint", "--set", "planetary_gear.N=66", "--out", "mine")
    assert (done.returncode, done.stderr) == (0, "")
    assert 'value="66.0"' in (tmp_path / "mine/system.ssd").read_text()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["new"], "one of --chain motor,gear,sensor,load and --from joint is needed"),
        (["new", "--chain", "motor,frob"], "there is no such part"),
        (["inspect", "gone.csv"], "gone.csv: there is no such file"),
        (["inspect", "text.csv"], "no row of numbers"),
        (["inspect"], "Missing argument"),
    ],
)
def test_a_wrong_call_is_one_line_and_status_2(
    tmp_path: Path, cobot_joint: Callable[..., Done], words: list[str], told: str
) -> None:
    (tmp_path / "text.csv").write_text("dear diary\ntoday\n")
    done = cobot_joint(*words)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert told in done.stderr


def log(folder: Path, name: str, columns: dict[str, np.ndarray]) -> None:
    np.savetxt(
        folder / name, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments=""
    )


def test_what_inspect_drafts_for_a_system_of_ones_own_is_read_as_it_stands(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    assert cobot_joint("new", "--chain", "motor,screw", "--out", "axis").returncode == 0
    rng = np.random.default_rng(4)
    u, i = np.sin(3 * T), rng.normal(0, 0.01, len(T)) + np.cos(3 * T)
    log(tmp_path, "run.csv", {"t [s]": T, "v_command [V]": u, "i_motor [A]": i, "s [mm]": 10 * np.sin(3 * T)})
    done = cobot_joint("inspect", "run.csv", "--system", "axis/system.ssd", "--out", "first")
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "first/campaign.toml").read_text()
    assert '"w_motor"' in text  # no column was found for it
    assert set(load_campaign(tmp_path / "first").train[0].outputs) == {"i_motor", "s"}


def test_every_column_of_a_log_stands_in_what_inspect_drafts(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    assert cobot_joint("new", "--chain", "motor,load", "--out", "axis").returncode == 0
    names = ("t [s]", "u [V]", "i [A]", "n [rpm]", "w_load [rad/s]", "M_brake [N.m]", "T_case [K]", "F [N]", "count")
    log(tmp_path, "run.csv", {n: np.sin((3 + k) * T) if k else T for k, n in enumerate(names)})
    assert cobot_joint("inspect", "run.csv", "--system", "axis/system.ssd", "--out", "first").returncode == 0
    text = (tmp_path / "first/campaign.toml").read_text()
    assert [name for name in names[1:] if f'"{name}" = "' not in text] == []
    assert '# "F [N]" = "load.F_add"   # not used; it could be load.F_add\n' in text
    assert '# "count" = "CONNECTOR"   # not used: no connector is like it' in text
    assert "tau_add" in next(line for line in text.splitlines() if "M_brake" in line)
    assert set(load_campaign(tmp_path / "first").train[0].outputs) == {"i_motor", "w_motor", "w_load"}


def test_a_torque_that_drives_a_system_without_inputs_is_guessed_onto_its_shaft(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    whole = chain(["load"]).system
    wires = tuple(c for c in whole.connections if c.source_component is not None)
    write_readable(replace(whole, inputs={}, connections=wires), [], tmp_path / "system.ssd")
    log(tmp_path, "run.csv", {"t [s]": T, "tau [N.m]": np.sin(3 * T), "w [rad/s]": np.cos(3 * T), "phi [rad]": T})
    assert cobot_joint("inspect", "run.csv", "--system", "system.ssd", "--out", "first").returncode == 0
    text = (tmp_path / "first/campaign.toml").read_text()
    assert '"tau [N.m]" = "load.tau"   # guess: by its name\n' in text
    assert '# "phi [rad]" = "load.phi"' in text
    (tmp_path / "first/campaign.toml").write_text(text.replace('"tau [N.m]"', '# "tau [N.m]"'))
    done = cobot_joint("diagnose", "first/campaign.toml", "--out", "found")
    said = "one of its inputs is needed in [channels]: load.tau; a machine that coasts down has its speed in [initial]"
    assert (done.returncode, said in done.stderr) == (2, True)
    (tmp_path / "first/campaign.toml").write_text(text)
    assert set(load_campaign(tmp_path / "first").train[0].inputs) == {"load.tau"}


def test_tolerances_that_are_drafted_are_those_of_the_part(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    for parts, name, tolerance in (
        ("motor,load", "load.body.J", "10 %"),
        ("motor,pendulum", "pendulum.body.m", "5 %"),
        ("motor,screw", "screw.body.m", "10 %"),
    ):
        assert cobot_joint("new", "--chain", parts, "--out", parts).returncode == 0
        log(tmp_path, "run.csv", {"t [s]": T, "v_command [V]": np.sin(3 * T), "i_motor [A]": np.cos(3 * T)})
        assert cobot_joint("inspect", "run.csv", "--system", f"{parts}/system.ssd", "--out", "f").returncode == 0
        text = (tmp_path / "f/campaign.toml").read_text()
        (tmp_path / "f/campaign.toml").unlink()
        given = dict(line.split(" = ") for line in text.splitlines() if line.startswith('"') and "%" in line)
        assert given[f'"{name}"'] == f'"{tolerance}"'
        assert not any("90 %" in value for value in given.values())


@pytest.mark.parametrize("unit", ["rad", "deg", "rev", "mm"])
def test_an_angle_at_rest_at_the_end_of_its_way_is_not_called_saturated_and_a_clipped_current_is(
    tmp_path: Path, unit: str
) -> None:
    phi, i = np.clip(np.sin(2 * T), -0.8, 0.8), np.clip(np.sin(2 * T), -0.8, 0.8)
    log(tmp_path, "run.csv", {"t [s]": T, f"phi [{unit}]": phi, "i [A]": i})
    quality = inspect_log(tmp_path / "run.csv").quality
    assert quality["phi"].saturated == 0
    assert quality["i"].saturated > 100


def test_dry_friction_of_what_is_drafted_sticks_or_may_be_sharper_than_its_unit_assumes(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    assert cobot_joint("new", "--chain", "motor,gear,load", "--out", "axis").returncode == 0
    log(tmp_path, "run.csv", {"t [s]": T, "v_command [V]": np.sin(3 * T), "i_motor [A]": np.cos(3 * T)})
    assert cobot_joint("inspect", "run.csv", "--system", "axis/system.ssd", "--out", "first").returncode == 0
    system = load_system(tmp_path / "axis/system.ssd")
    assert [system.component(name).parameters["friction.law"] for name in ("motor", "load")] == [2, 2]
    for drafted in ("axis", "first"):
        text = (tmp_path / drafted / "campaign.toml").read_text()
        assert '"gear.friction.w_C" = [0.02, 1]   # guess: the unit smooths dry friction below w_C' in text
        assert '"motor.friction.w_C"' not in text  # which has no say where friction sticks


@pytest.mark.long
@pytest.mark.parametrize(("cogging", "named"), [(0.0, []), (1.6e-3, ["motor.cogging"])])
def test_of_a_motor_whose_friction_sticks_its_cogging_is_named_and_else_nothing(
    tmp_path: Path, cobot_joint: Callable[..., Done], cogging: float, named: list[str]
) -> None:
    sheet = {"motor.friction.tau_C": "5 mN.m", "motor.J": "121 gcm2"}
    words = [word for name, value in sheet.items() for word in ("--set", f"{name}={value}")]
    assert cobot_joint("new", "--chain", "motor", *words, "--out", "machine").returncode == 0
    motor = with_data_sheet(chain(["motor"]), sheet).system
    concealed = {"motor.friction.law": 2, "motor.cogging.A": cogging, "motor.cogging.n": 24}
    rng, t = np.random.default_rng(3), np.arange(6001) * 1e-3
    for name in ("run1.csv", "run2.csv"):
        v = np.interp(t, np.linspace(0, 6, 13), np.r_[0.0, rng.uniform(-1.5, 1.5, 11), 0.0])
        with Simulation(motor) as simulation:
            experiment = Experiment(Inputs(t, {"v_command": v}), 6.0, parameters=concealed)
            run = simulation.run(replace(experiment, record=["i_motor", "w_motor"])).signals
        i, w = run["i_motor"] + rng.normal(0, 4e-3, len(t)), run["w_motor"] + rng.normal(0, 0.15, len(t))
        log(tmp_path, name, {"t [s]": t, "u [V]": v, "i [A]": i, "w [rad/s]": w})
    drafted = cobot_joint("inspect", "run1.csv", "run2.csv", "--system", "machine/system.ssd", "--out", "f")
    assert drafted.returncode == 0
    assert cobot_joint("diagnose", "f/campaign.toml", "--out", "answer").returncode == 0
    found = json.loads((tmp_path / "answer/diagnosis.json").read_text())["findings"]
    assert [f["term"] for f in found if f["confidence"] >= 0.5] == named


def recorded(folder: Path, system: System, drive: str, peak: float, seconds: float, noise: dict[str, float]) -> None:
    """Two logs of a machine, its drive between random values of up to a peak, and back."""
    rng, t = np.random.default_rng(3), np.arange(0, seconds, 1e-3)
    knots = np.linspace(0, seconds, int(2 * seconds) + 1)
    for name in ("run1.csv", "run2.csv"):
        wanted = peak * rng.uniform(0.2, 1.0, len(knots)) * (-1.0) ** np.arange(len(knots))
        u = PchipInterpolator(knots, np.r_[0.0, wanted[1:-1], 0.0])(t)
        with Simulation(system) as simulation:
            run = simulation.run(Experiment(Inputs(t, {drive: u}), float(t[-1]), record=list(noise))).signals
        columns = {f"{c} [{system.outputs[c].unit}]": run[c] + rng.normal(0, s, len(t)) for c, s in noise.items()}
        log(folder, name, {"t [s]": t, f"{drive} [{system.inputs[drive].unit}]": u, **columns})


def only_finding(tmp_path: Path, cobot_joint: Callable[..., Done]) -> dict[str, Any]:
    """The one claim about run1 and run2 of machine/system.ssd."""
    drafted = cobot_joint("inspect", "run1.csv", "run2.csv", "--system", "machine/system.ssd", "--out", "f")
    assert drafted.returncode == 0, drafted.stderr
    assert cobot_joint("diagnose", "f/campaign.toml", "--out", "answer").returncode == 0
    found = json.loads((tmp_path / "answer/diagnosis.json").read_text())["findings"]
    (claim,) = [f for f in found if f["confidence"] >= 0.5]
    return dict(claim)


@pytest.mark.long
def test_friction_over_the_angle_of_a_joint_that_turns_once_there_and_back_is_found(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    sheet = {"load.J": "0.01 kg.m2", "load.tau_C": "0.9 N.m", "load.d": "0.06 N.m.s/rad", "sensor.c_s": "960 N.m/rad"}
    words = [word for name, value in sheet.items() for word in ("--set", f"{name}={value}")]
    assert cobot_joint("new", "--chain", "motion,sensor,load", *words, "--out", "machine").returncode == 0
    parameters, signals = formula_parameters([(-0.28, "sin(1*phi)*sgn(w)")])
    own = tuple(f"load.{signal}" for signal in signals)
    system = with_data_sheet(chain(["motion", "sensor", "load"]), sheet).system
    machine = with_correction(system, Correction("rubs", "load.tau_add", own, parameters), tmp_path)
    recorded(tmp_path, machine, "w", 6.0, 10.0, {"tau_sensor": 0.01})
    claim = only_finding(tmp_path, cobot_joint)
    assert claim["term"] == "load.unlisted"
    assert "sin(1*phi)*sgn(w)" in claim["shape"]["formula"]


@pytest.mark.long
@pytest.mark.machine
def test_gravity_behind_a_gear_whose_friction_sticks_is_placed_at_the_load(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    sheet = {"motor.R": "0.214 Ohm", "motor.L": "0.084 mH", "motor.k": "23.2 mN.m/A", "motor.tau_C": "2.6 mN.m",
             "motor.rotor.J": "64 gcm2", "gear.N": "30", "gear.mesh.c": "3100 N.m/rad", "gear.mesh.b": "0.009 rad",
             "load.J": "0.0343 kg.m2", "load.tau_C": "0.05 N.m", "load.d": "0.01 N.m.s/rad",
             "shaft.c_s": "400 N.m/rad", "shaft.d_s": "0.2 N.m.s/rad"}  # fmt: skip
    words = [word for name, value in sheet.items() for word in ("--set", f"{name}={value}")]
    assert cobot_joint("new", "--chain", "motor,gear,load", *words, "--out", "machine").returncode == 0
    hanging = {"gravity.g": "9.81 m/s2", "body.m": "0.6 kg", "body.r": "0.2 m", "J": "0.0103 kg.m2"}
    truth = sheet | {f"load.{name}": value for name, value in hanging.items()}
    machine = with_data_sheet(chain(["motor", "gear", "load"]), truth).system
    recorded(tmp_path, machine, "v_command", 5.0, 8.0, {"i_motor": 0.006, "w_motor": 0.3, "w_load": 0.02})
    claim = only_finding(tmp_path, cobot_joint)
    assert claim["term"] == "load.imbalance"
    assert claim["parameters"]["G"]["value"] == pytest.approx(0.6 * 9.81 * 0.2, rel=0.01)
