"""Runs: what is set, passed on, recorded, repeated, changed on the way, streamed; and what is said when it fails."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np
import pytest

from cobot_joint.cosim import Experiment, Feedback, Simulation, SimulationError, simulate
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.simulator import run_beside
from cobot_joint.errors import UserError
from cobot_joint.system import Connection, Inputs, System

MakeSystem = Callable[..., System]
FIXED = "gauss_seidel_extrapolated"
NOTHING = Inputs(np.array([0.0]))  # inputs keep their start values
RAMP = Inputs(np.array([0.0, 1.0]), {"u": np.array([0.0, 1.0])})


def test_inputs_are_linear_between_samples_and_held_outside(make_gain: MakeSystem) -> None:
    inputs = Inputs(np.array([0.2, 0.35, 0.4]), {"u": np.array([1.0, 4.0, 0.0])})
    result = simulate(make_gain(), Experiment(inputs, 1.0, step=0.05, output_step=0.05))
    expected = 2 * np.interp(result.time, inputs.time, inputs.values["u"])
    np.testing.assert_allclose(result.signals["y"], 10 * expected + 1, atol=1e-12)  # factor and offset of the wire


def test_integers_and_booleans_pass_through_wires(make_gain: MakeSystem) -> None:
    t = np.array([0.0, 0.1, 0.2])
    inputs = Inputs(t, {"n": np.array([3.0, 3.0, 7.0]), "b": np.array([1.0, 1.0, 0.0])})
    result = simulate(make_gain(), Experiment(inputs, 0.3, scheme=FIXED, step=0.1, output_step=0.1))
    assert result.signals["n_out"].tolist() == [4, 4, 4, 8]
    assert result.signals["b_out"].tolist() == [0, 0, 0, 1]


@pytest.mark.parametrize("engine", ["native", "reference"])
def test_discrete_signals_are_held_over_a_step(make_gain: MakeSystem, engine: str) -> None:
    inputs = Inputs(np.array([0.0, 1.0]), {"n": np.array([0.0, 10.0])})
    result = simulate(make_gain(), Experiment(inputs, 0.4, scheme=FIXED, step=0.1, output_step=0.1), engine=engine)
    assert result.signals["n_out"].tolist() == [1, 1, 2, 3, 4]


def test_any_variable_of_a_component_can_be_recorded(make_oscillator: MakeSystem) -> None:
    result = simulate(make_oscillator(), Experiment(NOTHING, 0.5, record=["inertia.W_abs", "phi", "spring.spring.c"]))
    assert list(result.signals) == ["inertia.W_abs", "phi", "spring.spring.c"]
    assert np.all(np.diff(result.signals["inertia.W_abs"]) >= 0)
    assert np.all(result.signals["spring.spring.c"] == 1)


def test_a_second_run_is_as_the_first(make_oscillator: MakeSystem) -> None:
    with Simulation(make_oscillator()) as simulation:
        first = simulation.run(Experiment(NOTHING, 2.0))
        simulation.run(
            Experiment(NOTHING, 1.0, parameters={"spring.spring.c": 5}, scheme="jacobi", step=0.01, output_step=0.01)
        )
        again = simulation.run(Experiment(NOTHING, 2.0))
    for name, samples in first.signals.items():
        assert samples.tobytes() == again.signals[name].tobytes()


def test_parameters_of_a_run_come_after_those_of_the_system(make_gain: MakeSystem) -> None:
    system = make_gain(k=3.0)
    own = simulate(system, Experiment(RAMP, 1.0, output_step=0.5))
    given = simulate(system, Experiment(RAMP, 1.0, output_step=0.5, parameters={"gain.k": 4.0}))
    assert own.signals["y"][-1] == pytest.approx(31)
    assert given.signals["y"][-1] == pytest.approx(41)


@pytest.mark.parametrize("engine", ["native", "reference"])
def test_a_parameter_can_change_while_time_runs(make_gain: MakeSystem, engine: str) -> None:
    constant = Inputs(np.array([0.0]), {"u": np.array([1.0])})
    events = [(0.7, {"gain.k": 7.0}), (0.25, {"gain.k": 5.0})]
    result = simulate(
        make_gain(),
        Experiment(constant, 1.0, scheme=FIXED, step=0.1, output_step=0.1, parameter_events=events),
        engine=engine,
    )
    # 0.25 s takes effect from 0.3 s on and shows at the next point
    assert ((result.signals["y"] - 1) / 10).tolist() == [2, 2, 2, 2, 5, 5, 5, 5, 7, 7, 7]


@pytest.mark.parametrize("engine", ["native", "reference"])
def test_a_parameter_can_go_by_what_a_variable_is_then(make_gain: MakeSystem, engine: str) -> None:
    constant = Inputs(np.array([0.0]), {"u": np.array([1.0])})
    events = [(t, {"gain.k": Feedback("gain.y", lambda y: y + 1)}) for t in (0.25, 0.7)]
    how = Experiment(constant, 1.0, scheme=FIXED, step=0.1, output_step=0.1, parameter_events=events)
    result = simulate(make_gain(), how, engine=engine)
    assert ((result.signals["y"] - 1) / 10).tolist() == pytest.approx([2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4])


def test_what_a_variable_decides_has_to_be_allowed_as_well(make_gain: MakeSystem) -> None:
    constant = Inputs(np.array([0.0]), {"u": np.array([1.0])})
    for parameter, variable in (("gain.no_such", "gain.y"), ("gain.k", "gain.no_such"), ("gain.k", "no_such.y")):
        how = Experiment(constant, 1.0, parameter_events=[(0.3, {parameter: Feedback(variable, float)})])
        with pytest.raises(UserError, match="no_such"):
            simulate(make_gain(), how)


def test_a_stream_is_the_run_in_pieces(make_oscillator: MakeSystem) -> None:
    drive = Inputs(np.linspace(0, 3, 31), {"tau_drive": np.sin(np.linspace(0, 9, 31))})
    reached = []
    with Simulation(make_oscillator()) as simulation:
        whole = simulation.run(Experiment(drive, 3.0, output_step=0.01))
        pieces = list(
            simulation.stream(
                Experiment(drive, 3.0, output_step=0.01),
                rows_per_chunk=77,
                progress=lambda t, stop: reached.append((t, stop)),
            )
        )
    assert [len(piece.time) for piece in pieces] == [77, 77, 77, 70]
    assert np.concatenate([piece.time for piece in pieces]).tobytes() == whole.time.tobytes()
    for name, samples in whole.signals.items():
        assert np.concatenate([piece.signals[name] for piece in pieces]).tobytes() == samples.tobytes()
    assert pieces[-1].energy == whole.energy
    assert reached[-1] == (3.0, 3.0)


@pytest.mark.parametrize("engine", ["native", "reference"])
def test_a_failed_step_names_unit_call_and_time_and_what_the_unit_logged(make_gain: MakeSystem, engine: str) -> None:
    with pytest.raises(SimulationError) as caught:
        simulate(make_gain(fail_at=0.5), Experiment(RAMP, 1.0, scheme=FIXED, step=0.1, output_step=0.1), engine=engine)
    assert str(caught.value) == "gain: fmi2DoStep returned error at t = 0.5 s, step 0.1 s: no more after 0.5 s"


def test_a_discarded_step_is_an_error_that_says_so(make_gain: MakeSystem) -> None:
    with pytest.raises(SimulationError, match=r"fmi2DoStep returned discard at t = 0\.5 s"):
        simulate(make_gain(fail_at=0.5, fail_as=2), Experiment(RAMP, 1.0, scheme=FIXED, step=0.1, output_step=0.1))


@pytest.mark.parametrize("engine", ["native", "reference"])
@pytest.mark.parametrize("scheme", [FIXED, "adaptive"])
def test_results_end_where_a_unit_asks_to_stop(
    make_gain: MakeSystem, engine: str, scheme: str, caplog: pytest.LogCaptureFixture
) -> None:
    system, experiment = make_gain(fail_at=0.5, fail_as=4), Experiment(RAMP, 1.0, scheme=scheme, output_step=0.1)
    whole = simulate(make_gain(), experiment, engine=engine)
    with caplog.at_level(logging.WARNING, "cobot_joint"), Simulation(system, engine) as simulation:
        result = simulation.run(experiment)
        pieces = list(simulation.stream(experiment, rows_per_chunk=2))
    assert "gain asks to stop at t = 0.5 s: the results end there" in caplog.text
    np.testing.assert_allclose(result.time, [0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    np.testing.assert_array_equal(result["y"], whole["y"][:6])
    np.testing.assert_array_equal(np.concatenate([piece["y"] for piece in pieces]), result["y"])


def test_beside_a_recording_a_run_that_ends_early_is_a_failure(make_gain: MakeSystem) -> None:
    time = np.arange(0.0, 1.05, 0.1)
    recording = Recording("run", "train", "default", time, {"u": time}, {"y": time}, {})
    with (
        Simulation(make_gain(fail_at=0.5, fail_as=4)) as simulation,
        pytest.raises(SimulationError, match=r"amplifier ends at 0\.5 s of 1 s"),
    ):
        run_beside(simulation, recording, {}, record=["y"])


@pytest.mark.parametrize("engine", ["native", "reference"])
def test_an_adaptive_scheme_takes_a_discarded_step_again_shorter(make_gain: MakeSystem, engine: str) -> None:
    with Simulation(make_gain(longest=0.03), engine) as simulation:
        result = simulation.run(Experiment(RAMP, 1.0, scheme="adaptive", step=0.1, output_step=0.1))
        assert simulation.counters["rejected"] > 0
        assert simulation.counters["steps"] >= 1.0 / 0.03
    np.testing.assert_allclose(result.signals["y"], 20 * result.time + 1, atol=1e-9)


def test_without_a_scheme_steps_adapt_where_all_units_can_go_back(make_gain: MakeSystem) -> None:
    assert simulate(make_gain(), Experiment(RAMP, 1.0)).scheme == "adaptive"
    assert simulate(make_gain({"rolls_back": False}), Experiment(RAMP, 1.0)).scheme == FIXED


def test_warnings_are_counted_and_do_not_stop_a_run(make_gain: MakeSystem) -> None:
    with Simulation(make_gain(fail_at=0.5, fail_as=1)) as simulation:
        result = simulation.run(Experiment(RAMP, 1.0, scheme=FIXED, step=0.1, output_step=0.1))
        assert simulation.counters["warnings"] == 5
    assert result.signals["y"][-1] == pytest.approx(21)


def test_after_a_failed_run_the_next_one_is_sound(make_gain: MakeSystem) -> None:
    with Simulation(make_gain()) as simulation:
        sound = simulation.run(Experiment(RAMP, 1.0))
        with pytest.raises(SimulationError):
            simulation.run(Experiment(RAMP, 1.0, parameters={"gain.fail_at": 0.5}))
        again = simulation.run(Experiment(RAMP, 1.0))
    assert sound.signals["y"].tobytes() == again.signals["y"].tobytes()


def test_an_algebraic_loop_without_a_fixed_point_is_refused_at_the_start(make_gain: MakeSystem) -> None:
    amplifier = make_gain()
    connections = [c for c in amplifier.connections if c.sink != "u"]
    connections.append(Connection("gain", "y", "gain", "u", 1.0, 1.0))  # y = 2 (y + 1) grows from sweep to sweep
    loop = System("loop", amplifier.components, tuple(connections), {}, amplifier.outputs)
    with pytest.raises(
        SimulationError, match=r"initial values do not settle in 50 sweeps over the loop gain.y -> gain.u"
    ):
        simulate(loop, Experiment(NOTHING, 1.0))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"parameters": {"motor.k": 1}}, "no such component of amplifier, it has gain"),
        ({"parameters": {"gain.kk": 1}}, "no variable of gain_"),
        ({"parameters": {"gain.k": np.nan}}, "a finite number is allowed"),
        ({"record": ["z"]}, "'z' is to be recorded, amplifier has y, n_out, b_out, u, n, b"),
        ({"record": ["gain.z"]}, "'gain.z' is to be recorded, gain has u, y"),
        ({"scheme": FIXED, "step": 0.003, "output_step": 0.01}, "the output step 0.01 s has to be a multiple of it"),
        ({"step": -1.0}, "step -1 s is given, it has to be positive"),
    ],
)
def test_a_wrong_call_is_answered_with_what_is_allowed(make_gain: MakeSystem, wrong: dict, message: str) -> None:
    with pytest.raises(UserError, match=message):
        simulate(make_gain(), Experiment(RAMP, 1.0, **wrong))


def test_an_unknown_input_is_answered_with_the_known_ones(make_gain: MakeSystem) -> None:
    inputs = Inputs(np.array([0.0]), {"v": np.array([1.0])})
    with pytest.raises(UserError, match="input 'v' is given, amplifier has u, n, b"):
        simulate(make_gain(), Experiment(inputs, 1.0))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"step": 1e9}, r"step 1e\+09 s is given, the run lasts 1 s"),
        ({"step": 1e-300}, r"in steps of 1e-300 s are given: 1e\+300 points, 1e\+10 are allowed"),
        ({"output_step": 1e-300}, r"1e\+300 points, 1e\+10 are allowed"),
        ({"stop_time": 1e18}, r"1e\+21 points, 1e\+10 are allowed"),
        ({"step": -1.0}, "step -1 s is given, it has to be positive"),
        ({"step": float("inf")}, "step inf s is given, it has to be positive"),
    ],
)
def test_steps_and_times_that_cannot_be_meant_are_refused(
    make_gain: MakeSystem, given: dict[str, float], told: str
) -> None:
    with pytest.raises(UserError, match=told):
        simulate(make_gain(), Experiment(NOTHING, **({"stop_time": 1.0} | given)))
