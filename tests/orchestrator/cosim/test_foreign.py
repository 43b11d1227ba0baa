"""A gearhead that somebody else built, in the joint: neither rollback nor derivatives, our ports, no annotation."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from cobot_joint.api import run
from cobot_joint.cosim import Experiment, SimulationError, simulate
from cobot_joint.cosim.foreign.step_choice import choose_step, relative_changes, richardson
from cobot_joint.results.result import Result
from cobot_joint.scenario.model import TimeScenario, load_scenario
from cobot_joint.system import Inputs, System, load_system, with_units

MakeGear = Callable[..., Path]
STOP = 3.0


def loaded() -> Experiment:
    scenario = load_scenario("load_mr_brake")
    assert isinstance(scenario, TimeScenario)
    return replace(scenario.experiment(load_system("joint")), stop_time=STOP)


def joint(gear: Path) -> System:
    return with_units(load_system("joint"), {"planetary_gear": gear})


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def furthest(result: Result, exact: Result) -> float:
    """Of what the joint records, over its rms."""
    return max(rms(result[name] - exact[name]) / rms(exact[name]) for name in ("i_motor", "w_motor", "tau_gear"))


@pytest.fixture(scope="module")
def exact(foreign_gear: MakeGear) -> Result:
    return simulate(joint(foreign_gear()), replace(loaded(), scheme="gauss_seidel_extrapolated", step=1e-3 / 64))


@pytest.mark.parametrize("can", [{}, {"canGetAndSetFMUstate": True}, {"canHandleVariableCommunicationStepSize": False}])
def test_the_default_coupling_of_a_foreign_gear_converges(
    foreign_gear: MakeGear, exact: Result, can: dict[str, bool]
) -> None:
    """held inputs that are fed through lag: the mesh read -0.38 for +0.41 N.m, the current 0.06 for 0.31 A"""
    result = simulate(joint(foreign_gear(**can)), loaded())
    assert furthest(result, exact) < (0.01 if can != {"canHandleVariableCommunicationStepSize": False} else 0.2)


@pytest.mark.parametrize("can", [{}, {"canInterpolateInputs": True}])
@pytest.mark.parametrize("step", [5e-4, 2.5e-4, 1.25e-4])
def test_the_estimated_error_of_a_step_is_its_error(foreign_gear: MakeGear, can: dict[str, bool], step: float) -> None:
    """twice what halving changes, as for first order, is 0.9 to 1.7 times the error here"""
    drive = Inputs(np.array([0.0, 0.1]), {"v_command": np.array([0.0, 12.0])})
    start = Experiment(drive, 0.3, scheme="gauss_seidel_extrapolated")
    system = joint(foreign_gear(**can))
    coarse, fine, finest, exact = (simulate(system, replace(start, step=step / k)) for k in (1, 2, 4, 32))
    nominal = dict.fromkeys(exact.signals, 0.0)
    changes, again = relative_changes(coarse, fine, nominal), relative_changes(fine, finest, nominal)
    error = max(relative_changes(coarse, exact, nominal).values())
    assert 0.99 * error < richardson(changes, again)[0] < 1.35 * error


class Errs(dict[str, np.ndarray]):
    """A run whose signal is off by `error` times its size."""

    def __init__(self, error: float) -> None:
        super().__init__(y=np.ones(10) + error)

    @property
    def signals(self) -> Errs:
        return self


@pytest.mark.parametrize("order", [0.6, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("at_longest", [1e-3, 9e-3, 0.02, 0.1])
def test_the_longest_step_that_errs_by_a_hundredth_is_chosen(order: float, at_longest: float) -> None:
    def error(step: float) -> float:
        return at_longest * (step / 1e-3) ** order

    step = choose_step(lambda h: cast("Result", Errs(error(h))), 1e-3, {"y": 1.0})
    assert error(step) <= 0.01 * 1.05
    assert step == 1e-3 or error(2 * step) > 0.01 * 0.7  # its size changes with its error, and order 3 is taken for 2


def test_what_does_not_converge_is_said(foreign_gear: MakeGear, caplog: pytest.LogCaptureFixture) -> None:
    """a unit of fixed steps lags by half of them, whatever the master does"""
    with caplog.at_level(logging.WARNING, "cobot_joint"):
        result = simulate(joint(foreign_gear(canHandleVariableCommunicationStepSize=False)), loaded())
    assert result.step < 8e-6
    assert "halving the step" in caplog.text
    assert "canHandleVariableCommunicationStepSize" in caplog.text


def test_a_step_that_is_short_already_is_not_halved(foreign_gear: MakeGear, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "cobot_joint"):
        result = simulate(joint(foreign_gear()), replace(loaded(), stop_time=0.01, output_step=1e-5))
    assert result.step == pytest.approx(1e-5)
    assert caplog.text == ""


def test_a_unit_that_fails_at_every_step_says_why(make_gain: Callable[..., System]) -> None:
    with pytest.raises(SimulationError, match=r"gain: fmi2DoStep returned error at t = 0\.5"):
        simulate(make_gain({"rolls_back": False}, fail_at=0.5), Experiment(Inputs(np.array([0.0])), 1.0))


def test_where_only_the_shortest_step_runs_its_error_is_said_to_be_unknown(caplog: pytest.LogCaptureFixture) -> None:
    shortest = 1e-3 / 128

    def runs(step: float) -> Result:
        if step > 1.1 * shortest:
            raise SimulationError("diverged")
        return Result(np.array([0.0, 1.0]), {"tau": np.array([1.0, 1.0])}, {}, "jacobi", step)

    with caplog.at_level(logging.WARNING, "cobot_joint"):
        assert choose_step(runs, 1e-3, {"tau": 1.0}) == shortest
    assert "cannot be told" in caplog.text
    assert "nan" not in caplog.text


def test_a_given_step_is_taken_as_it_is(foreign_gear: MakeGear) -> None:
    assert simulate(joint(foreign_gear()), replace(loaded(), stop_time=0.1, step=1e-4)).step == 1e-4


@pytest.mark.parametrize("units", [{}, {"w": "rpm"}, dict.fromkeys(("phi", "w", "tau", "phi_o", "w_o", "tau_s"))])
def test_work_at_ports_without_flanges_is_measured(foreign_gear: MakeGear, units: dict[str, str | None]) -> None:
    """by units of measure at either end of a wire"""
    result = simulate(joint(foreign_gear(units=units)), loaded())
    ours = simulate(load_system("joint"), loaded())
    names = {
        "motor_bldc.shaft -> planetary_gear.tau": "motor_bldc.shaft -> planetary_gear.input",
        "planetary_gear.tau_s -> torque_sensor.driving": "planetary_gear.output -> torque_sensor.driving",
    }
    assert set(names) < set(result.energy)
    for name, our_name in names.items():
        assert abs(result.energy_residual(name)) < 1e-3
        if "w" not in units or units["w"] is None:  # its equations take rad/s, whatever it says
            assert result.energy[name][0] == pytest.approx(ours.energy[our_name][0], rel=0.25)  # it has less friction


@pytest.mark.parametrize("flipped", ["tau=-tau", "tau_s=-tau_s"])
def test_work_is_counted_in_one_sign_where_a_unit_has_the_other(foreign_gear: MakeGear, flipped: str) -> None:
    system = with_units(load_system("joint"), {"planetary_gear": f"{foreign_gear()}:{flipped}"})
    drive = Inputs(np.array([0.0, 0.1]), {"v_command": np.array([0.0, 12.0])})
    result = simulate(system, Experiment(drive, 0.3, scheme="gauss_seidel_extrapolated", step=1e-4))
    for name, (_, _, absolute) in result.energy.items():
        assert absolute > 0
        assert abs(result.energy_residual(name)) < 1e-2, name


def test_energy_that_gets_lost_is_said_aloud(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "cobot_joint"):
        run("joint", replace(loaded(), scheme="gauss_seidel", step=5e-4))  # what feeds back is told to stand still
        lost = caplog.text
        caplog.clear()
        run("joint", loaded())
    assert "planetary_gear.output -> torque_sensor.driving: " in lost
    assert "J were given and " in lost
    assert caplog.text == ""


@pytest.mark.parametrize("can", [{}, {"canHandleVariableCommunicationStepSize": False}])
def test_native_and_reference_agree_on_stairs_and_measured_work(foreign_gear: MakeGear, can: dict[str, bool]) -> None:
    experiment = replace(loaded(), stop_time=0.2, scheme="gauss_seidel_extrapolated", step=5e-4)
    native, plain = (simulate(joint(foreign_gear(**can)), experiment, engine=e) for e in ("native", "reference"))
    for name, samples in native.signals.items():
        assert samples.tobytes() == plain.signals[name].tobytes(), name
    assert native.energy == plain.energy
