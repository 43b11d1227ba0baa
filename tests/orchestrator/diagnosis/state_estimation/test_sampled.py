"""Runs from given states keep to what units let a state start at."""

from __future__ import annotations

from time import thread_time

import numpy as np
import pytest

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.state_estimation.linearisation import Lineariser
from cobot_joint.diagnosis.state_estimation.native.restart import LostError
from cobot_joint.diagnosis.state_estimation.sampled import SampledSystem
from tests.orchestrator.diagnosis.state_estimation.rig import COGGING, SIGMA, bench, clock, inputs


def anywhere(sampled: SampledSystem) -> np.ndarray:
    """A run is never given up."""
    return np.full(len(sampled.states), np.inf)


def test_a_state_that_an_integrator_takes_past_its_bound_can_be_linearised_at() -> None:
    """The drive's heat count: used up within a step, it ends a little below 0, where the unit refuses to start."""
    time = clock(2.0)
    limits = {"motor_bldc.drive.i_cont": 1.5, "motor_bldc.drive.i_peak": 3.0}
    volts = np.interp(time, [0.1, 0.2, 0.6, 0.65], [0, 20, 20, 0])
    with SampledSystem(bench()[0], list(SIGMA), limits) as sampled:
        piece = sampled.run(sampled.start({}), time, {**inputs(time), "v_command": volts})
        heat = [s.name for s in sampled.states].index("motor_bldc.q_t")
        assert piece.signals["motor_bldc.q_t"].min() < 0
        assert piece.x[:, heat].min() == 0
        assert np.isfinite(Lineariser(sampled, [])(piece).A).all()


def test_a_run_along_a_recording_is_that_run_on_its_own() -> None:
    """From a sample in its middle, with a signal at a port, and a value that holds from within it on."""
    time, port = clock(1.0), "motor_bldc.tau_add"
    given = inputs(time)
    with SampledSystem(bench()[0], list(SIGMA), COGGING, {"motor_bldc.cogging.A": 0.425}) as sampled:
        whole = sampled.run(sampled.start({}), time, given)
        with sampled.along(time, given, anywhere(sampled), [port]) as runs:
            assert runs.quick is not None
            for rows in (slice(0, 51), slice(400, 451), slice(450, 501), slice(700, 1001)):
                for added in (None, {port: 1e-3 * np.exp(-time[rows] / 0.05)}):
                    found = runs.run(whole.x[rows.start], rows, added)
                    driven = {name: u[rows] for name, u in given.items()} | (added or {port: np.zeros(len(time[rows]))})
                    expected = sampled.run(whole.x[rows.start], time[rows], driven)
                    size = np.abs(expected.table).max(axis=0)
                    np.testing.assert_allclose(found.table / (size + 1e-12), expected.table / (size + 1e-12), atol=1e-9)


def test_a_run_from_a_sample_on_goes_on_as_the_whole_one_does_where_an_input_holds_its_samples() -> None:
    time = clock(1.0)
    held = {**inputs(time), "v_command": np.repeat(np.random.default_rng(1).uniform(-6, 6, 21), 50)[: len(time)]}
    with SampledSystem(bench()[0], list(SIGMA)) as sampled:
        whole = sampled.run(sampled.start({}), time, held, ["v_command"])
        lines = sampled.run(sampled.start({}), time, held)
        assert np.abs(whole.y - lines.y).max() > 0.1  # A: what lines would make of it
        with sampled.along(time, held, anywhere(sampled), held=["v_command"]) as runs:
            assert runs.quick is not None
            for rows in (slice(0, 51), slice(400, 451), slice(725, 1001)):
                found, size = runs.run(whole.x[rows.start], rows).y, np.abs(whole.y).max(axis=0)
                np.testing.assert_allclose(found / size, whole.y[rows] / size, atol=1e-3)


def test_what_enters_where_a_recorded_torque_does_comes_on_top_of_it() -> None:
    """An axis with its torque at `load.tau_add` ended with an IndexError."""
    time, port = clock(0.5), "motor_bldc.tau_add"
    given, more = {**inputs(time), port: 2e-3 * np.sin(9 * time)}, np.full(len(time), 1e-3)
    with SampledSystem(bench()[0], list(SIGMA)) as sampled:
        x, every = sampled.start({}), slice(0, len(time))
        both = sampled.run(x, time, {**given, port: given[port] + more}).y
        as_recorded = sampled.run(x, time, given).y
        assert np.abs(both - as_recorded).max() > 1e-3
        with sampled.along(time, given, anywhere(sampled), [port]) as runs:
            np.testing.assert_allclose(runs.run(x, every, {port: more}).y, both, atol=1e-6)
            np.testing.assert_allclose(runs.run(x, every).y, as_recorded, atol=1e-6)


def test_a_unit_that_fails_along_a_recording_says_so() -> None:
    time = clock(0.2)
    with (
        SampledSystem(bench()[0], list(SIGMA)) as sampled,
        sampled.along(time, inputs(time), anywhere(sampled)) as runs,
    ):
        x = sampled.start({})
        assert np.isfinite(runs.run(x, slice(0, 51)).table).all()
        with pytest.raises(SimulationError, match="motor_bldc"):
            runs.run(np.where([s.name == "motor_bldc.w" for s in sampled.states], np.nan, x), slice(0, 51))


@pytest.mark.parametrize("isolated", [False, True])
def test_a_run_from_an_estimate_that_is_lost_is_given_up(isolated: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A gear that stiffens, set 18 rad outside of its gap, flies apart: each such piece took twenty seconds, and a
    recording has hundreds (field/open/case08)."""
    if isolated:
        monkeypatch.setenv("COBOT_JOINT_ISOLATE", "all")
    time = clock(0.1)
    with SampledSystem(bench()[0], list(SIGMA), {"planetary_gear.stiffness_hardening.h": 275.0}) as sampled:
        reached = np.maximum(np.abs(sampled.run(sampled.start({}), time, inputs(time)).x).max(axis=0), sampled.nominal)
        names, begun = [s.name for s in sampled.states], thread_time()
        x = np.where([name == "planetary_gear.phi_o" for name in names], 18.0, sampled.start({}))
        rows = slice(0, 2 if isolated else 51)  # of a unit on its own the run is judged when it has come to its end
        with sampled.along(time, inputs(time), reached) as runs, pytest.raises(LostError):
            runs.run(x, rows)
        assert thread_time() - begun < 5


def test_a_system_with_a_unit_in_its_own_process_is_followed_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only slower: such a unit steps itself, and is begun by the runs of the co-simulation."""
    time, rows, sigma = clock(1.0), slice(400, 451), np.array(list(SIGMA.values()))
    with (
        SampledSystem(bench()[0], list(SIGMA)) as sampled,
        sampled.along(time, inputs(time), anywhere(sampled)) as runs,
    ):
        x = sampled.run(sampled.start({}), time, inputs(time)).x[rows.start]
        quick = runs.run(x, rows)
    monkeypatch.setenv("COBOT_JOINT_ISOLATE", "all")
    with (
        SampledSystem(bench()[0], list(SIGMA)) as sampled,
        sampled.along(time, inputs(time), anywhere(sampled)) as runs,
    ):
        assert runs.quick is None
        assert sampled.scheme is None
        off = np.abs(runs.run(x, rows).y - quick.y)
        assert (np.ptp(quick.y, axis=0) > sigma).all()
        assert (off < 0.1 * sigma).all()
