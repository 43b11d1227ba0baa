"""Scheme monolithic: the units' equations as one system, against closed forms and units that step themselves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from cobot_joint.cosim import Experiment, Simulation, SimulationError, simulate
from cobot_joint.cosim.instances import UnfitError
from cobot_joint.cosim.schemes import MONOLITHIC
from cobot_joint.cosim.simulation import Engine
from cobot_joint.errors import UserError
from cobot_joint.system import Inputs, System, load_system
from cobot_joint.system.model import Value

Signals = Mapping[str, NDArray[np.float64]]
HOLD = np.array([0.0, 0.02, 0.1, 0.6, 0.65, 1.5])
INPUTS = Inputs(
    HOLD,
    {
        "v_command": np.array([0.0, 12.0, 12.0, 12.0, -6.0, -6.0]),
        "i_brake": np.array([0.0, 0.0, 0.3, 0.3, 0.3, 0.8]),
        "tau_hold": np.array([0.0, 0.0, 0.0, 2.0, 0.0, 0.0]),
    },
)
NOTHING = Inputs(np.array([0.0]))  # inputs keep their start values
CHANNELS = ("i_motor", "w_motor", "tau_sensor")


def both(system: System, stop: float = 1.5, **parameters: Value) -> tuple[Signals, Signals]:
    """Monolithic, and from units that step themselves."""
    named = {name.replace("__", "."): value for name, value in parameters.items()}
    run = Experiment(INPUTS, stop, parameters=named)
    return tuple(simulate(system, replace(run, scheme=s)).signals for s in ("monolithic", "adaptive"))  # type: ignore[return-value]


def near(system: System, names: tuple[str, ...] = CHANNELS, **parameters: Value) -> None:
    """The same within a tenth of the logger's noise, rms."""
    one, many = both(system, **parameters)
    for name, noise in zip(names, (4e-3, 0.32, 5e-3), strict=True):
        assert np.ptp(one[name]) > 10 * noise
        assert np.sqrt(np.mean((one[name] - many[name]) ** 2)) <= noise / 10, name


def test_a_coil_follows_a_ramp_as_its_closed_form_says() -> None:
    """held rotor: L di/dt = v - R i, v = s t: i = s/R (t - L/R (1 - exp(-R t/L)))"""
    R, L, slope = 0.209, 84.3e-6, 10.0
    system = load_system("joint_no_load")
    ramp = Inputs(np.array([0.0, 0.1]), {"v_command": np.array([0.0, 1.0])})
    held = {"motor_bldc.friction.tau_C": 1.0, "motor_bldc.friction.w_C": 1e-3}
    result = simulate(system, Experiment(ramp, 0.01, output_step=1e-4, scheme="monolithic", parameters=held))
    t = result.time
    expected = slope / R * (t - L / R * (1 - np.exp(-R * t / L)))
    np.testing.assert_allclose(result.signals["i_motor"], expected, atol=2e-3 * expected[-1])
    assert np.max(np.abs(result.signals["w_motor"])) < 1e-3


@pytest.mark.parametrize(
    ("scheme", "engine"),
    [("monolithic", "native"), *((s, e) for s in ("adaptive", "jacobi") for e in ("native", "reference"))],
)
def test_an_input_that_holds_its_samples_jumps_at_each_as_the_closed_form_says(scheme: str, engine: Engine) -> None:
    """held rotor, v = v_k from t_k on: i = v_k/R + (i_k - v_k/R) exp(-R (t - t_k)/L)"""
    R, L = 0.209, 84.3e-6
    at, v = np.arange(11) * 1e-3, np.array([0.0, 1, 1, -0.5, 0.7, 0.7, 0, 0, 1, -1, 0.3])
    held = {"motor_bldc.friction.tau_C": 1.0, "motor_bldc.friction.w_C": 1e-3}
    stairs = Inputs(at, {"v_command": v}, frozenset({"v_command"}))
    record = ["i_motor", "v_command"]
    run = Experiment(stairs, 0.01, output_step=1e-4, scheme=scheme, parameters=held, record=record)
    result = simulate(load_system("joint_no_load"), run, engine=engine)
    t, i, expected = result.time, 0.0, []
    for k, time in enumerate(t):
        since = v[max(int(np.floor((time + 1e-9) / 1e-3)), 0)]
        expected.append(i)
        assert result.signals["v_command"][k] == since  # from its sample on, not only behind it
        i = since / R + (i - since / R) * np.exp(-R * 1e-4 / L)
    np.testing.assert_allclose(result.signals["i_motor"], expected, atol=2e-3 * np.max(np.abs(expected)))


def test_a_held_input_without_samples_is_refused() -> None:
    with pytest.raises(ValueError, match="v is held, and has no samples"):
        Inputs(np.zeros(1), {}, frozenset({"v"}))


def test_an_input_at_a_time_is_its_line_or_what_it_holds() -> None:
    values = {"line": np.array([0.0, 2.0]), "stairs": np.array([0.0, 2.0])}
    inputs = Inputs(np.array([1.0, 2.0]), values, frozenset({"stairs"}))
    assert [inputs.at(t) for t in (0.5, 1.5, 2.0)] == [
        {"line": 0.0, "stairs": 0.0},
        {"line": 1.0, "stairs": 0.0},
        {"line": 2.0, "stairs": 2.0},
    ]


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"motor_bldc__cogging.A": 2e-3, "motor_bldc__cogging.n": 6.0},
        {"torque_sensor__hysteresis.H": 0.05, "torque_sensor__hysteresis.tau_H": 0.3},
        {"torque_sensor__low_pass.T": 0.02},
        {"planetary_gear__presliding.share": 0.5},
        {"planetary_gear__transmission_error.A": 1e-4},
        {"mr_brake_belt__brake_release_lag.x": 0.5},
    ],
    ids=lambda p: next(iter(p), "base").split("__")[-1],
)
def test_every_kind_of_term_answers_as_where_units_step_themselves(parameters: dict[str, Value]) -> None:
    near(load_system("joint"), **parameters)


def test_the_logger_behind_the_joint_sees_the_same() -> None:
    near(load_system("joint_logged"), **{"acquisition__speed_delay.T": 5e-3})


def test_flanks_that_rest_at_zero_force_do_not_call_up_events_without_end() -> None:
    """at constant speed nothing pushes an unloaded output: it touches and lets go by rounding alone"""
    steady = Inputs(np.array([0.0, 0.5]), {"v_command": np.array([0.0, 10.0])})
    with Simulation(load_system("joint_no_load")) as simulation:
        simulation.run(Experiment(steady, 6.0, scheme="monolithic"))
        assert simulation.counters["steps"] < 5000


def test_a_parameter_that_is_set_on_the_way_holds_from_then_on() -> None:
    system = load_system("joint")
    run = Experiment(INPUTS, 1.0, scheme="monolithic", parameter_events=[(0.4, {"motor_bldc.winding.R": 0.3})])
    late, never = (simulate(system, r).signals["i_motor"] for r in (run, replace(run, parameter_events=())))
    adaptive = simulate(system, replace(run, scheme="adaptive")).signals["i_motor"]
    np.testing.assert_allclose(late[:401], never[:401], atol=2e-5)  # the step before ends there
    assert np.max(np.abs(late - never)) > 0.1
    assert np.sqrt(np.mean((late - adaptive) ** 2)) < 2e-4


def test_rows_do_not_depend_on_how_often_they_are_recorded() -> None:
    system = load_system("joint")
    fine, coarse = (
        simulate(system, Experiment(INPUTS, 1.0, scheme="monolithic", output_step=step)).signals["w_motor"]
        for step in (1e-3, 1e-2)
    )
    np.testing.assert_allclose(fine[::10], coarse, atol=1e-3)


def test_a_run_that_exceeds_its_pace_is_given_up() -> None:
    with pytest.raises(UnfitError, match="more steps than its pace allows"):
        simulate(load_system("joint"), Experiment(INPUTS, 1.5, scheme=replace(MONOLITHIC, pace=10.0)))


def test_units_of_others_are_refused_by_name(make_oscillator: object) -> None:
    with pytest.raises(SimulationError, match="inertia"):
        simulate(make_oscillator(), Experiment(NOTHING, 1.0, scheme="monolithic"))  # type: ignore[operator]


def test_the_plain_python_master_says_that_it_has_no_such_scheme() -> None:
    with pytest.raises(UserError, match="monolithic"):
        simulate(load_system("joint"), Experiment(INPUTS, 0.1, scheme="monolithic"), engine="reference")


def test_a_reading_once_per_communication_step_is_left_to_units_that_step_themselves() -> None:
    """the encoder's speed drives the gear in place of the rotor's"""
    joint = load_system("joint_no_load")
    wires = tuple(
        replace(c, source="w_reading") if c.source == "w" and c.sink_component else c for c in joint.connections
    )
    with pytest.raises(UnfitError, match="motor_bldc gives another what does not follow"):
        simulate(replace(joint, connections=wires), Experiment(NOTHING, 0.1, scheme="monolithic"))
