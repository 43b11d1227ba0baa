"""What a draft takes from samples, and from what else was logged."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.orchestrator.diagnosis.typed import Done

SAMPLES = 2000


def drafted(
    tmp_path: Path, cobot_joint: Callable[..., Done], chain: str, columns: dict[str, np.ndarray], *sheet: str
) -> list[str]:
    """Lines of the [channels] of a draft over a log with these columns, at 100 Hz."""
    assert cobot_joint("new", "--chain", chain, *sheet, "--out", "machine").returncode == 0
    rows = np.column_stack([10.0 * np.arange(SAMPLES), *columns.values()])
    header = ",".join(["t [ms]", *columns])
    np.savetxt(tmp_path / "log.csv", rows, fmt="%.6g", delimiter=",", header=header, comments="")
    done = cobot_joint("inspect", "log.csv", "--system", "machine/system.ssd", "--out", "first")
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "first/campaign.toml").read_text()
    return text.split("[channels]")[1].split("[tolerances]")[0].splitlines()


def measured() -> dict[str, np.ndarray]:
    t, rng = 0.01 * np.arange(SAMPLES), np.random.default_rng(1)
    return {
        "U [V]": np.repeat(rng.uniform(-6, 6, SAMPLES // 40), 40),
        "I [A]": rng.normal(np.sin(t), 0.02),
        "Angle [deg]": 400 * (1 - np.cos(t)),
    }


STAIRS = '"U [V]" = { to = "v_command", hold = true }   # guess: '
LINES = '"U [V]" = "v_command"   # guess: '


@pytest.mark.parametrize(("stairs", "drafted_as"), [(True, STAIRS), (False, LINES)])
def test_an_input_in_stairs_is_drafted_to_hold_its_values(
    tmp_path: Path, cobot_joint: Callable[..., Done], stairs: bool, drafted_as: str
) -> None:
    """A laboratory's motor with Stribeck friction was undecided at 30 %, its PWM voltage drawn as straight lines over
    10 ms; with `hold` it is named, 87 % sure."""
    smooth = {} if stairs else {"U [V]": 5 * np.sin(0.01 * np.arange(SAMPLES))}
    lines = drafted(tmp_path, cobot_joint, "motor", measured() | smooth)
    assert any(line.startswith(drafted_as) for line in lines)
    assert sum("hold" in line for line in lines) == stairs


@pytest.mark.parametrize(
    ("chain", "more", "used"),
    [
        ("motor", {}, True),
        ("motor", {"speed [rad/s]": 4 * np.sin(0.01 * np.arange(SAMPLES))}, False),
        ("motor", {"Other [deg]": np.arange(SAMPLES) / 7}, False),
        ("motor,gear,load", {}, False),
    ],
    ids=["no speed", "a speed beside it", "two angles", "several shafts"],
)
def test_an_angle_that_can_be_of_one_shaft_alone_is_drafted_where_no_speed_was_logged(
    tmp_path: Path, cobot_joint: Callable[..., Done], chain: str, more: dict[str, np.ndarray], used: bool
) -> None:
    """It stood there as a comment, and the diagnosis was of a motor's current alone."""
    lines = drafted(tmp_path, cobot_joint, chain, measured() | more)
    (line,) = (line for line in lines if '"Angle [deg]"' in line)
    assert line.startswith('"Angle [deg]" = "motor.phi"   # guess: no speed was recorded') == used
    assert line.startswith("# ") != used


@pytest.mark.parametrize(
    ("column", "top", "scale"),
    [("duty_pct", 80.0, "0.3 V"), ("PWM [%]", 80.0, "30 V"), ("pwm", 255.0, "0.117647 V"), ("Duty Cycle", 0.9, "30 V")],
)
def test_a_duty_cycle_is_drafted_as_the_voltage_that_nobody_logged(
    tmp_path: Path, cobot_joint: Callable[..., Done], column: str, top: float, scale: str
) -> None:
    """Two newcomers had their machines' only input in a comment: no connector is like it."""
    log = {column: top * np.sin(0.01 * np.arange(SAMPLES)), "I [A]": np.ones(SAMPLES)}
    lines = drafted(tmp_path, cobot_joint, "motor", log, "--set", "motor.inverter.v_bus=30")
    assert any(line.startswith(f'"{column}" = {{ to = "v_command", scale = "{scale}"') for line in lines), lines


@pytest.mark.parametrize(
    ("column", "top", "supply", "drafted_as"),
    [
        ("duty_cycle", 0.9, "input_voltage", 'times = "input_voltage [V]" }'),
        ("pwm", 255.0, "vbat_V", 'scale = "0.00392157", times = "vbat_V [V]" }'),
        ("PWM [%]", 80.0, "Battery [mV]", 'times = "Battery [mV]" }'),
    ],
)
def test_a_duty_cycle_is_drafted_times_the_voltage_of_its_supply_where_that_was_logged(
    tmp_path: Path, cobot_joint: Callable[..., Done], column: str, top: float, supply: str, drafted_as: str
) -> None:
    """The battery's voltage was taken for the motor's, and the duty cycle stood in a comment."""
    t = 0.01 * np.arange(SAMPLES)
    volts = 48 - 2 * np.abs(np.sin(t))
    log = {column: top * np.sin(t), supply: 1e3 * volts if "mV" in supply else volts, "I [A]": np.ones(SAMPLES)}
    lines = drafted(tmp_path, cobot_joint, "motor", log)
    assert any(line.startswith(f'"{column}" = {{ to = "v_command", {drafted_as}') for line in lines), lines
    assert not any(line.startswith(f'"{supply.split()[0]}') for line in lines), lines
    text = (tmp_path / "first/campaign.toml").read_text()
    said = "guess: the highest voltage that its supply was logged at"  # one of 24 V would hold the motor
    assert f'"motor.inverter.v_bus" = 48   # {said}' in text


def test_what_a_loop_reads_already_is_not_offered_to_a_column(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    """A carriage's place, fed to its loop beside the motor's angle, was 0.1 m off in simulation."""
    t = 0.01 * np.arange(SAMPLES)
    log = {"set_mm": 30 * np.sin(t), "motor_mm": 30 * np.sin(t - 0.01), "scale_mm": 30 * np.sin(t - 0.02)}
    lines = drafted(tmp_path, cobot_joint, "loop,motor,screw", log)
    assert not any("loop.s" in line for line in lines), lines


@pytest.mark.parametrize(
    ("named", "connector"),
    [("actual_deg", "motor.phi"), ("lag_error_deg", "loop.e_phi"), ("following_error_deg", "loop.e_phi")],
)
def test_what_a_servo_did_is_drafted_as_the_angle_that_its_loop_reads_and_its_error_as_that(
    tmp_path: Path, cobot_joint: Callable[..., Done], named: str, connector: str
) -> None:
    """A camera's pan axis was offered its position as the loop's error, in a comment."""
    t = 0.01 * np.arange(SAMPLES)
    log = {"setpoint_deg": 30 * np.sin(t), named: 30 * np.sin(t - 0.01), "current_A": np.cos(t)}
    lines = drafted(tmp_path, cobot_joint, "loop,motor,load", log)
    (line,) = (line for line in lines if named in line)
    assert line.startswith(f'"{named} [deg]" = "{connector}"')


@pytest.mark.parametrize(
    ("rate", "connector", "said"),
    [(1.0, "w_link", "it is the rate of 'q [deg]'"), (100.0, "w_motor", "the motor's, since a drive logs its own")],
    ids=["of the arm", "of the motor"],
)
def test_a_speed_that_is_the_rate_of_a_logged_angle_is_that_shafts(
    tmp_path: Path, cobot_joint: Callable[..., Done], rate: float, connector: str, said: str
) -> None:
    """A robot logs `actual_q`, `actual_qd`: the speed had been drafted as the motor's, a hundredth of what it does."""
    t, rng = 0.01 * np.arange(SAMPLES), np.random.default_rng(2)
    columns = {
        "qd [deg/s]": rng.normal(rate * 40 * np.sin(t), 0.1 * rate),
        "q [deg]": 30 + 40 * (1 - np.cos(t)),
        "cmd [V]": 5 * np.sin(t),
    }
    lines = drafted(tmp_path, cobot_joint, "motor,gear,link", columns)
    (line,) = (line for line in lines if '"qd [deg/s]"' in line)
    assert line.startswith(f'"qd [deg/s]" = "{connector}"   # guess: {said}')
    assert any(line.startswith('"q [deg]" = "phi_link"') for line in lines)


def test_motion_that_was_recorded_as_angle_and_speed_drives_and_is_where_it_is(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    """The speed had no line, and nothing drove the system."""
    t, rng = 0.01 * np.arange(SAMPLES), np.random.default_rng(2)
    columns = {
        "q [rad]": 0.6 + 0.7 * (1 - np.cos(t)),
        "qd [rad/s]": rng.normal(0.7 * np.sin(t), 2e-3),
        "torque [N.m]": rng.normal(5 * np.sign(np.sin(t)), 0.1),
    }
    lines = drafted(tmp_path, cobot_joint, "motion,link", columns)
    assert any(line.startswith('"qd [rad/s]" = "w"   # guess: nothing else can drive the system') for line in lines)
    assert any(line.startswith('"q [rad]" = "motion.phi"   # guess: ') for line in lines)
    assert '"link.phi_p" = "first sample of motion.phi"' in lines


def test_a_servo_drive_s_log_of_an_axis_is_drafted_by_its_units_its_rates_and_what_was_asked_of_it(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    """The measured torque, in %, became what the loop was asked for: nothing else could drive the system."""
    t = 0.01 * np.arange(SAMPLES)
    columns = {
        "Position demand value [mm]": 20 * (1 - np.cos(t)),
        "Position actual value [mm]": 20 * (1 - np.cos(t - 0.02)),
        "Velocity actual value [mm/s]": 20 * np.sin(t - 0.02),
        "Torque actual value [%]": 30 * np.cos(t),
    }
    mode = ["--set", "motor.drive.mode=current", "--set", "motor.k=0.4"]
    lines = drafted(tmp_path, cobot_joint, "loop,motor,screw", columns, *mode)
    assert '"Position demand value [mm]" = "s_command"   # guess: by its name' in lines
    assert '"Position actual value [mm]" = "s"   # guess: the only one in this unit' in lines
    rate = "guess: it is the rate of 'Position actual value [mm]'"
    assert f'"Velocity actual value [mm/s]" = "screw.v"   # {rate}' in lines
    (torque,) = (line for line in lines if "Torque" in line)
    assert torque.startswith('# "Torque actual value [%]" = { to = "i_motor", scale = "RATED A" }')
    assert torque.endswith("1 A is a torque of 0.4 N.m")


def counted(per_turn: int, rounding: float) -> dict[str, np.ndarray]:
    """A speed in rpm, as an encoder counts from sample to sample, and rounded."""
    angle = 60.0 * np.arange(SAMPLES) * 0.01 + 150 * (1 - np.cos(0.004 * np.arange(SAMPLES)))
    ticks = np.floor(angle * per_turn / (2 * np.pi)) if per_turn else angle
    per_turn = per_turn or 2 * np.pi
    rpm = np.diff(ticks, prepend=ticks[0] - 60 * 0.01 * per_turn / 2 / np.pi) * 60 / per_turn / 0.01
    return measured() | {"n [rpm]": rounding * np.round(rpm / rounding)}


@pytest.mark.parametrize(("per_turn", "rounding", "mean"), [(2048, 1.0, True), (0, 1.0, False), (0, 2.9, False)])
def test_a_speed_in_steps_of_an_encoder_s_counts_is_drafted_as_their_mean(
    tmp_path: Path, cobot_joint: Callable[..., Done], per_turn: int, rounding: float, mean: bool
) -> None:
    """A hoist 30 % too heavy was a friction by direction, 45 %: where its voltage jumped, the mean since the sample
    before was 40 sigma off the speed of an instant, half a sample earlier or not."""
    lines = drafted(tmp_path, cobot_joint, "motor", counted(per_turn, rounding))
    (line,) = (line for line in lines if '"n [rpm]"' in line)
    assert ("mean = true" in line) == mean
    assert ("its steps are counts of an encoder, 2048 per turn, from sample to sample" in line) == mean


@pytest.mark.parametrize("mean", [True, False])
def test_a_speed_that_is_what_its_angle_went_since_the_sample_before_is_too(
    tmp_path: Path, cobot_joint: Callable[..., Done], mean: bool
) -> None:
    angle = measured()["Angle [deg]"]
    rates = {True: np.diff(angle, prepend=angle[0]) / 0.01, False: np.gradient(angle, 0.01)}
    lines = drafted(tmp_path, cobot_joint, "motor", measured() | {"n [deg/s]": rates[mean]})
    (line,) = (line for line in lines if '"n [deg/s]"' in line)
    assert ("mean = true" in line) == mean
    assert ("it is what 'Angle' went since the sample before" in line) == mean


def test_an_encoder_s_counts_are_drafted_as_an_angle_whose_counts_per_turn_are_to_be_given(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    """ "no connector is like it", though a motor's angle was the one motion that a conveyor's log had."""
    counts = {"enc_ticks": np.floor(measured()["Angle [deg]"] * 4096 / 360)}
    without_angle = {name: x for name, x in measured().items() if name != "Angle [deg]"}
    lines = drafted(tmp_path, cobot_joint, "motor,gear,load", without_angle | counts)
    (line,) = (line for line in lines if "enc_ticks" in line)
    assert line.startswith('# "enc_ticks" = { to = "motor.phi", scale = "RATED rad" }   # not used: in place of RATED')
    assert "6.283185 over the counts per turn" in line


def test_a_motor_s_electrical_speed_is_drafted_as_one_whose_pole_pairs_are_to_be_given(
    tmp_path: Path, cobot_joint: Callable[..., Done]
) -> None:
    lines = drafted(tmp_path, cobot_joint, "motor", measured() | {"erpm": 7e3 * np.sin(0.01 * np.arange(SAMPLES))})
    (line,) = (line for line in lines if "erpm" in line)
    assert line.startswith('# "erpm" = { to = "w_motor", scale = "RATED rad/s" }   # not used: in place of RATED, ')
    assert line.endswith("0.1047198 over the motor's pole pairs")
