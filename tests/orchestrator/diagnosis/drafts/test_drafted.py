"""What `new` writes and says for machines whose data sheet does not say everything."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import guess
from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.typed import Done


@pytest.mark.parametrize(("spring", "rings"), [([], True), (["sensor.c_s=4935", "sensor.d_s=22"], False)])
def test_a_load_that_would_ring_behind_recorded_motion_is_said_with_what_to_set(
    tmp_path: Path, cobot_joint: Callable[..., Done], spring: list[str], rings: bool
) -> None:
    settings = [word for value in ["load.J=0.05", *spring] for word in ("--set", value)]
    done = cobot_joint("new", "--chain", "motion,sensor,load", "--out", "axis", *settings)
    assert done.returncode == 0
    said = "the load rings at 22 Hz, damped by 1.4 %"
    assert (
        (said in done.stdout) == ("--set sensor.c_s=4935 --set sensor.d_s=22" in " ".join(done.stdout.split())) == rings
    )


def shaft_of(folder: str) -> tuple[float, float]:
    """Stiffness and damping in the system that `new` wrote there."""
    shaft = load_system(f"{folder}/system.ssd").component("shaft").parameters
    return float(shaft["shaft.c_s"]), float(shaft["shaft.d_s"])


def test_behind_recorded_motion_a_shaft_that_hardly_gives_is_one_on_which_the_load_rings_at_100_hz(
    cobot_joint: Callable[..., Done],
) -> None:
    """c = J (2 pi 100 Hz)^2, 0.7 of critical damping. The assumed shaft let a hub motor's rotor ring at 11 Hz, and its
    cogging of order 42 was undecided."""
    done = cobot_joint("new", "--chain", "motion,load", "--set", "load.J=4.1e-3", "--out", "dyno")
    c = 4.1e-3 * (2 * np.pi * 100) ** 2
    assert f"a shaft that hardly gives, of {float(f'{c:.3g}'):g} N.m/rad, stands between motion" in " ".join(
        done.stdout.split()
    )
    assert shaft_of("dyno") == pytest.approx((c, 0.7 * 2 * np.sqrt(c * 4.1e-3)), rel=5e-3)


def test_friction_that_is_zero_in_the_system_stands_in_a_draft_to_be_given_a_range(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    assert cobot_joint("new", "--chain", "load", "--out", "axis").returncode == 0
    lines = (tmp_path / "axis/campaign.toml").read_text().splitlines()
    (line,) = (line for line in lines if "load.friction.tau_C" in line)
    assert line.startswith('# "load.friction.tau_C" = [0.0, MOST]   # it is 0 in the system')
    assert '"load.body.J" = "10 %"' in lines


def test_the_supply_stands_in_the_system_of_a_motor(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    """A motor at 48 V was limited to the bench's 24 V without a word."""
    assert cobot_joint("new", "--chain", "motor", "--set", "motor.v_bus=48", "--out", "motor").returncode == 0
    assert "inverter.v_bus" in (tmp_path / "motor/system.ssd").read_text()
    assert load_system(str(tmp_path / "motor/system.ssd")).component("motor").parameters["inverter.v_bus"] == 48.0


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "the motor's supply of 24 V is assumed, which holds it below 192 rad/s: --set 'motor.v_bus=VALUE'"),
        (["--set", "motor.v_bus=48 V"], ""),
        (["--set", "motor.supply_voltage=48 V"], ""),
    ],
)
def test_a_supply_that_nobody_gave_is_said_with_the_speed_at_which_it_holds_the_motor(
    cobot_joint: Callable[..., Done], given: list[str], said: str
) -> None:
    done = cobot_joint("new", "--chain", "motor,load", "--set", "motor.k=0.125 N.m/A", "--out", "axis", *given)
    assert done.returncode == 0, done.stderr
    words = " ".join(done.stdout.split())
    assert said in words
    assert ("supply" in words) == bool(said)


def test_a_shafts_damping_that_nobody_gave_is_said_beside_its_critical_one(cobot_joint: Callable[..., Done]) -> None:
    """2 sqrt(c J) of 2 kg.m2 and 2 kg.m2 against each other on 100 N.m/rad: 20 N.m.s/rad."""
    given = ("--set", "link.J_l=2", "--set", "harmonic.J_o=2", "--set", "shaft.c_s=100", "--set", "link.m=0")
    done = cobot_joint("new", "--chain", "motor,harmonic,link", "--out", "arm", *given)
    assert done.returncode == 0, done.stderr
    said = (
        "the shaft's damping of 0.01 N.m.s/rad is assumed, 0.05 % of critical; 5 % would be 1: --set 'shaft.d_s=VALUE'"
    )
    assert said in " ".join(done.stdout.split())


def test_a_chain_that_nothing_drives_is_refused_with_what_may_stand_first(cobot_joint: Callable[..., Done]) -> None:
    done = cobot_joint("new", "--chain", "harmonic,link", "--out", "arm")
    assert done.returncode == 2
    assert "--chain harmonic,link is given, and nothing drives its first part; motor, loop" in " ".join(
        done.stderr.split()
    )


@pytest.mark.parametrize(("given", "assumed"), [([], True), (["--set", "shaft.c_s=5000"], False)])
def test_a_shaft_whose_stiffness_is_given_is_not_said_to_be_assumed(
    cobot_joint: Callable[..., Done], given: list[str], assumed: bool
) -> None:
    done = cobot_joint("new", "--chain", "motor,harmonic,link", "--out", "arm", *given)
    assert done.returncode == 0
    assert ("that stiffness is assumed" in " ".join(done.stdout.split())) == assumed


@pytest.mark.parametrize(
    "name", ["PosCmd", "phi_soll", "pos_ref", "Positionssollwert", "Sollposition", "Lagesollwert", "q_des"]
)
def test_a_set_value_is_not_taken_for_what_the_machine_did(name: str) -> None:
    """The position that a loop was told to reach, the only column in mm beside its voltage, became the measured one."""
    column, none = Channel(name, "rad", np.zeros(0), np.zeros(0)), Connector("phi", "output", "rad")
    assert guess([column], {"phi": none}) == []
    assert [g.connector for g in guess([replace(column, name="PosAct")], {"phi": none})] == ["phi"]


@pytest.mark.parametrize("name", ["Istposition", "Lageistwert", "pos_act", "phi_measured"])
def test_what_the_machine_did_is_not_taken_for_a_set_value(name: str) -> None:
    column, asked = Channel(name, "rad", np.zeros(0), np.zeros(0)), Connector("phi_command", "input", "rad")
    assert guess([column], {"phi_command": asked}) == []
    assert [g.connector for g in guess([replace(column, name="phi_soll")], {"phi_command": asked})] == ["phi_command"]


def test_a_column_that_others_could_stand_for_is_not_called_the_only_one() -> None:
    columns = [Channel(name, "rad", np.zeros(0), np.zeros(0)) for name in ("a", "b")]
    (found,) = guess(columns, {"load": Connector("load", "output", "rad")})
    assert found.why == f"by its unit, as {'b' if found.column.name == 'a' else 'a'} could be"


@pytest.mark.parametrize(("begins", "said"), [(100.0, True), (0.0, False)])
def test_a_displacement_that_begins_elsewhere_begins_there_in_a_draft(
    tmp_path: Path, cobot_joint: Callable[..., Done], begins: float, said: bool
) -> None:
    """Friction near one end of a carriage's way was not found: the simulation began at another place."""
    time = np.arange(0, 2, 2e-3)
    rows = np.column_stack([time, np.ones_like(time), begins + 50 * time**2])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t [s],u [V],s [mm]", comments="")
    assert cobot_joint("new", "--chain", "motor,screw", "--out", "axis").returncode == 0
    done = cobot_joint("inspect", "log.csv", "--system", "axis/system.ssd", "--out", "first")
    assert done.returncode == 0, done.stderr
    assert ('"screw.s" = "first sample of s"' in (tmp_path / "first/campaign.toml").read_text()) == said


def test_a_motor_has_no_limits_that_nobody_gave(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    assert cobot_joint("new", "--chain", "motor,load", "--set", "motor.w_max=500", "--out", "axis").returncode == 0
    values = load_system(str(tmp_path / "axis/system.ssd")).component("motor").parameters
    assert [values[f"drive.{name}"] for name in ("v_max", "i_peak", "w_max")] == [0.0, 0.0, 500.0]


def test_a_decimal_comma_in_a_value_is_said_to_be_one(cobot_joint: Callable[..., Done]) -> None:
    done = cobot_joint("new", "--chain", "motor", "--set", "motor.R=0,4 Ohm", "--out", "motor")
    assert done.returncode == 2
    assert "'0,4 Ohm' is given, a decimal point is needed: '0.4 Ohm'" in " ".join(done.stderr.split())


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("n_rpm", "rpm"),
        ("rpm", "rpm"),
        ("speed (rpm)", "rpm"),
        ("speed in rad/s", "rad/s"),
        ("w_deg_s", "deg/s"),
        ("speed (1/min)", "1/min"),
        ("w (1)", None),
        ("w_b", None),
    ],
)
def test_a_unit_at_the_end_of_a_columns_name_is_that_columns(name: str, unit: str | None) -> None:
    """`n_rpm` was drafted as rad/s."""
    column, speed = Channel(name, None, np.zeros(0), np.zeros(0)), {"w": Connector("w", "output", "rad/s")}
    assert [g.column.unit for g in guess([column], speed)] == [unit]


def test_a_moving_average_is_no_milliampere() -> None:
    current = {"i_motor": Connector("i_motor", "output", "A")}
    found = [guess([Channel(name, None, np.zeros(0), np.zeros(0))], current) for name in ("i_motor_ma", "i_motor_mA")]
    assert [g.column.unit for (g,) in found] == [None, "mA"]


def test_a_torque_in_lower_case_is_no_length() -> None:
    column, torque = Channel("tau_nm", None, np.zeros(0), np.zeros(0)), Connector("tau", "output", "N.m")
    (found,) = guess([column], {"tau": torque})
    assert found.column.unit == "N.m"
    assert found.why == "by its name; its unit by its name"


def test_a_gyro_shows_the_load_and_no_drive_s_own_speed(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    """It was taken for the motor's, and with it a temperature for a voltage."""
    t = np.arange(400) * 1e-2
    columns = {"t_s": t, "u_cmd_V": np.sin(t), "gyro_z_dps": np.cos(t), "mot_temp_degC": 20 + t}
    np.savetxt(
        tmp_path / "run.csv", np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments=""
    )
    assert cobot_joint("new", "--chain", "motor,shaft,load", "--out", "pan").returncode == 0
    assert cobot_joint("inspect", "run.csv", "--system", "pan/system.ssd", "--out", "first").returncode == 0
    text = (tmp_path / "first/campaign.toml").read_text()
    assert '"gyro_z_dps [deg/s]" = "w_load"   # guess: by its name' in text
    assert '# "mot_temp_degC [degC]" = "motor.T_w"   # not used; it could be motor.T_w' in text


def test_a_link_s_inertia_may_be_off_as_its_mass(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    assert cobot_joint("new", "--chain", "link", "--set", "link.J_l=0.18 kg m2", "--out", "arm").returncode == 0
    assert '"link.arm.J_l" = "10 %"' in (tmp_path / "arm/campaign.toml").read_text()


@pytest.mark.parametrize(
    "given", [{}, {"shaft.d_s": 0.3}, {"shaft.c_s": 850.0}, {"shaft.c_s": 850.0, "shaft.d_s": 0.3}]
)
def test_a_shaft_whose_stiffness_nobody_gave_is_a_coupling_that_hardly_gives(
    cobot_joint: Callable[..., Done], given: dict[str, float]
) -> None:
    """0.0125 kg.m2 at 100 Hz, and damped by 0.7 of critical against the gear's own 0.0003 kg.m2. On 20 N.m/rad, which
    was assumed, a leg's drive had no answer in nine minutes."""
    values = {"load.J": 0.0125, "gear.J_o": 3e-4, **given}
    sets = [word for name, value in values.items() for word in ("--set", f"{name}={value}")]
    done = cobot_joint("new", "--chain", "motor,gear,shaft,load", "--out", "knee", *sets)
    assert done.returncode == 0, done.stderr
    c = 0.0125 * (2 * np.pi * 100) ** 2
    d = 2 * 0.7 * np.sqrt(c * 0.0125 * 3e-4 / (0.0125 + 3e-4))
    free = d if not given else 0.01  # that of a stiffness that was given is the part's own
    assert shaft_of("knee") == pytest.approx((given.get("shaft.c_s", c), given.get("shaft.d_s", free)), rel=5e-3)
    said = f"a shaft that hardly gives, of {float(f'{c:.3g}'):g} N.m/rad, stands between gear and load"
    assert (said in " ".join(done.stdout.split())) == ("shaft.c_s" not in given)


@pytest.mark.parametrize(("given", "c", "d"), [((), 16000.0, 2.67), (("gear.mesh.c=9000",), 9000.0, 0.5)])
def test_beside_a_series_elastic_spring_a_gear_whose_stiffness_nobody_gave_hardly_gives(
    cobot_joint: Callable[..., Done], given: tuple[str, ...], c: float, d: float
) -> None:
    """The bench's 3000 N.m/rad took a tenth of it away."""
    sets = [word for value in ("elastic.spring.c=320", *given) for word in ("--set", value)]
    done = cobot_joint("new", "--chain", "motor,gear,elastic,link", "--out", "elbow", *sets)
    assert done.returncode == 0, done.stderr
    mesh = load_system("elbow/system.ssd").component("gear").parameters
    assert (mesh["mesh.c"], mesh.get("mesh.d_g", 0.5)) == pytest.approx((c, d), rel=5e-3)
    assert ("the gear's mesh of 16000 N.m/rad is assumed, beside the spring" in done.stdout) == (not given)


@pytest.mark.parametrize(("given", "told"), [((), True), (("gear.stiffness=4e4",), False)])
def test_a_gear_s_stiffness_that_nobody_gave_is_said_beside_a_shaft_s_that_was_given(
    cobot_joint: Callable[..., Done], given: tuple[str, ...], told: bool
) -> None:
    """A conveyor's shaft of 850 N.m/rad gave 662 with it, and ended at the end of its tolerance."""
    values = [word for value in ("shaft.c_s=850", "shaft.d_s=1.2", *given) for word in ("--set", value)]
    done = cobot_joint("new", "--chain", "motor,gear,shaft,load", "--out", "conveyor", *values)
    said = "the gear's mesh of 3000 N.m/rad is assumed, and makes 662 of the shaft's 850"
    assert (said in " ".join(done.stdout.split())) == told
    assert ("--set gear.mesh.c=42500" in done.stdout) == told


def test_an_angle_whose_speed_is_used_is_offered_to_the_same_part_first_and_to_no_error_of_an_angle(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    t = np.arange(400) * 1e-2
    columns = {"t [s]": t, "u_cmd_V": np.sin(t), "n_mot [rad/s]": 9 * np.sin(t), "knee_speed [rad/s]": np.sin(t)}
    columns |= {"knee_angle [rad]": np.cos(t), "mot_angle [rad]": 9 * np.cos(t)}
    table = np.column_stack([*columns.values()])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=",".join(columns), comments="")
    assert cobot_joint("new", "--chain", "motor,gear,shaft,load", "--out", "knee").returncode == 0
    assert cobot_joint("inspect", "run.csv", "--system", "knee/system.ssd", "--out", "first").returncode == 0
    text = (tmp_path / "first/campaign.toml").read_text()
    (line,) = (line for line in text.splitlines() if "knee_angle" in line)
    assert line.startswith('# "knee_angle [rad]" = "load.phi"   # not used; it could be load.phi, ')
    assert "delta_add" not in line
    assert '# "mot_angle [rad]" = "motor.phi"   # not used' in text
    assert '"u_cmd_V [V]" = "v_command"' in text


@pytest.mark.parametrize(
    ("part", "damping", "bounds"),
    [
        ("gear", "mesh.d_g", "[0.05, 15]"),
        ("harmonic", "flex_spline.d_g", "[0.2, 60]"),
        ("elastic", "spring.d", "[0.005, 1.5]"),
    ],
)
def test_damping_that_is_on_no_data_sheet_is_offered_and_does_not_vary_unasked(
    tmp_path: Path, cobot_joint: Callable[..., Done], part: str, damping: str, bounds: str
) -> None:
    chain = "motor,gear,elastic,load" if part == "elastic" else f"motor,{part},load"
    stiff = ("--set", "gear.stiffness=2000") if part == "gear" else ()
    assert cobot_joint("new", "--chain", chain, *stiff, "--out", "axis").returncode == 0
    lines = (tmp_path / "axis/campaign.toml").read_text().splitlines()
    assert f'# "{part}.{damping}" = {bounds}   # damping, on no data sheet: let it vary if a resonance shows' in lines


@pytest.mark.parametrize(("given", "stiffness"), [((), "[300, 30000]"), (("--set", "gear.stiffness=2000"), '"30 %"')])
def test_teeth_of_which_nobody_said_how_stiff_they_are_may_be_anything(
    tmp_path: Path, cobot_joint: Callable[..., Done], given: tuple[str, ...], stiffness: str
) -> None:
    """Of a conveyor whose gear hardly gave, its supply that sags was named, and a stiffness that grows beside it, 95 %
    sure: ringing, with 3000 N.m/rad within 30 %."""
    assert cobot_joint("new", "--chain", "motor,gear,load", *given, "--out", "axis").returncode == 0
    lines = (tmp_path / "axis/campaign.toml").read_text().splitlines()
    (teeth,) = (line for line in lines if '"gear.mesh.c"' in line)
    assert teeth.split(" = ")[1].split("   #")[0] == stiffness
    assert any(line.startswith('"gear.mesh.d_g" = [') for line in lines) == (not given)


def test_what_is_given_beside_the_base_model_has_a_tolerance(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    """A fan's drag from its data sheet; the stiffness of a coupling and a drive's loop are offered."""
    given = [word for value in ("load.fan=1.6e-5", "motor.drive.mode=current") for word in ("--set", value)]
    assert cobot_joint("new", "--chain", "motor,load", "--out", "fan", *given).returncode == 0
    lines = (tmp_path / "fan/campaign.toml").read_text().splitlines()
    (drag,) = (line for line in lines if "windage" in line)
    assert drag.startswith('"load.windage.c" = "30 %"   # guess: given beside the base model')
    for offered in ('# "shaft.shaft.c_s" = "30 %"', '# "motor.drive.w_c" = "30 %"'):
        assert any(line.startswith(offered) for line in lines)
