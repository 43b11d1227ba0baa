"""Scenario files: the shipped ones say what the bench did; wrong ones are refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cobot_joint.errors import UserError
from cobot_joint.scenario.model import Grips, load_scenario, scenario_names
from cobot_joint.system import load_system

TIME = ["no_load", "load_mr_brake", "load_hand", "reversals"]


def test_shipped_scenarios_are_the_benchs() -> None:
    assert set(scenario_names()) == {
        *TIME,
        "compliance",
        "compliance_torque_feedback",
        "frequency_response",
        "torque_calibration",
        "current_sensor_calibration",
        "thesis",
    }


@pytest.mark.parametrize("name", TIME)
def test_inputs_are_those_of_the_reference(name: str, shared: Path) -> None:
    reference = pq.read_table(shared / "reference" / f"{name}.parquet")
    scenario = load_scenario(name)
    time = reference["time [s]"].to_numpy()
    assert scenario.stop_time == time[-1]
    for header in ("v_command [V]", "i_brake [A]", "tau_hold [N.m]"):
        signal = scenario.inputs.get(header.split()[0])
        given = signal.at(time) if signal else np.zeros_like(time)
        # 1e-12: the reference's own corners of the grips carry rounding of that size
        np.testing.assert_allclose(given, reference[header].to_numpy(), rtol=0, atol=1e-12, err_msg=header)


@pytest.mark.parametrize("name", TIME)
def test_inputs_at_their_corners_are_the_inputs(name: str) -> None:
    scenario = load_scenario(name)
    inputs = scenario.signals(load_system(scenario.system))
    time = np.linspace(0, scenario.stop_time, 20_001)
    for key, signal in scenario.inputs.items():
        np.testing.assert_allclose(
            np.interp(time, inputs.time, inputs.values[key]), signal.at(time), rtol=0, atol=1e-12
        )


def test_grip_is_a_trapezoid() -> None:
    grips = Grips(at=[1.0], height=4.0, rise=0.15, hold=0.4, fall=0.2)
    expected = [(1.0, 0.0), (1.15, 4.0), (1.55, 4.0), (1.75, 0.0)]
    np.testing.assert_allclose(grips.points(), expected)


def test_setting_replaces_what_the_file_says() -> None:
    assert load_scenario("no_load", {"stop_time": "5"}).stop_time == 5
    assert load_scenario("frequency_response", {"bias_from": "commanded_current"}).bias_from == "commanded_current"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("system = 'joint'", "stop_time: is missing"),
        ("stop_time = 1\nsystem = 'joint'\nstep_time = 2", "step_time: no such key, allowed are title, system"),
        ("stop_time = -1\nsystem = 'joint'", "stop_time: -1 is given, allowed is greater than 0"),
        ("stop_time = inf\nsystem = 'joint'", "stop_time: inf is given, allowed is a finite number"),
        ("kind = 'tome'", "kind: 'tome' is given, allowed are time, frequency_response"),
        ("stop_time = ", "not a TOML file"),
        ("stop_time = 1\nsystem = 'joint'\n[inputs.v_command]", "one of points and grips is allowed"),
        ("stop_time = 1\nsystem = 'joint'\n[inputs.v_command]\npoints = [[1, 0], [0, 1]]", "times have to rise"),
    ],
)
def test_wrong_file_is_refused_with_the_place(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(UserError) as refused:
        load_scenario(path)
    assert words in str(refused.value)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_unknown_scenario_is_refused_with_the_shipped_ones() -> None:
    with pytest.raises(
        UserError,
        match=r"scenario 'laod': there is none, allowed are .*load_hand.*, a \.toml file, or a system: .*joint",
    ):
        load_scenario("laod")


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        ("[inputs.v_comand]\npoints = [[0, 1]]", "joint has no such input, it has v_command, i_brake, tau_hold"),
        ("[inputs.v_command]\nunit = 'A'\npoints = [[0, 1]]", "unit 'A' is given, 'V' is allowed"),
    ],
)
def test_input_that_the_system_lacks_is_refused(signal: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"system = 'joint'\nstop_time = 1\n{signal}")
    with pytest.raises(UserError) as refused:
        load_scenario(path).signals(load_system("joint"))
    assert words in str(refused.value)
