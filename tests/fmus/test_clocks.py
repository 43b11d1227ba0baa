"""Clocks of FMI 3.0: the motor's commutation ticks by itself, its encoder is read where the master's clock ticks."""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from tests.fmus.test_fmi3 import Model, Slave, fmi3, make  # noqa: F401, a fixture

Make = Callable[..., Slave]
PHASES = {"motor.level": 2, "w": 300.0, "set_value": 6.0}  # three-phase, turning
EVENTS = {"eventModeUsed": True, "earlyReturnAllowed": True}


def interval() -> float:
    """Of the encoder's clock, as modelDescription.xml says; s."""
    with zipfile.ZipFile(fmi3("motor_bldc")) as archive:
        clock = ET.fromstring(archive.read("modelDescription.xml")).find(".//Clock[@name='encoder_clock']")
    assert clock is not None
    return float(clock.attrib["intervalDecimal"])


def started(make: Make, start: dict[str, float]) -> Slave:  # noqa: F811
    motor = make("motor_bldc", **EVENTS).initialise(start)
    motor.fmu.updateDiscreteStates()
    motor.fmu.enterStepMode()
    return motor


def test_commutation_ticks_where_the_hall_code_changes_and_nowhere_else(make: Make) -> None:  # noqa: F811
    motor, t, ticks, changes, others = started(make, PHASES), 0.0, [], [], 0
    while t < 0.02:
        event, _, _, t = motor.fmu.doStep(t, 0.02 - t)
        if not event:
            continue
        motor.fmu.enterEventMode()
        ticked, hall = motor.ticks("commutation"), motor["hall"]
        motor.fmu.updateDiscreteStates()
        assert not motor.ticks("commutation")
        others += not ticked
        ticks += [t] if ticked else []
        changes += [t] if motor["hall"] != hall else []
        motor.fmu.enterStepMode()
    assert len(ticks) >= 5
    assert ticks == changes
    assert others > 0  # freewheeling ends


def test_a_clocked_encoder_reads_the_speed_over_its_own_period_whatever_the_steps(make: Make) -> None:  # noqa: F811
    """as a unit that is stepped at that period reads it; quarters of it would see a quarter of the counts"""
    start = {"set_value": 6.0, "w": 100.0}
    plain, clocked, unclocked = (
        make("motor_bldc").initialise(start),
        started(make, start),
        make("motor_bldc").initialise(start),
    )
    T = interval()
    assert T == 1e-3
    for n in range(30):
        plain.fmu.doStep(n * T, T)
        clocked.fmu.enterEventMode()
        clocked.tick("encoder_clock")
        clocked.fmu.updateDiscreteStates()
        clocked.fmu.enterStepMode()
        read = clocked["w_reading"]
        for k in range(4):
            clocked.fmu.doStep((n + k / 4) * T, T / 4)
            unclocked.fmu.doStep((n + k / 4) * T, T / 4)
            assert clocked["w_reading"] == read
    clocked.fmu.enterEventMode()
    clocked.tick("encoder_clock")
    clocked.fmu.updateDiscreteStates()
    assert clocked["w_reading"] == pytest.approx(plain["w_reading"], abs=1e-9)
    assert abs(unclocked["w_reading"] - plain["w_reading"]) > 1e-3


def test_in_model_exchange_the_clock_takes_the_place_of_the_time_events(make: Make) -> None:  # noqa: F811
    motor = make("motor_bldc", Model).initialise()
    assert motor.fmu.updateDiscreteStates()[4]
    motor.tick("encoder_clock")
    defined, _ = motor.fmu.updateDiscreteStates()[4:]
    assert not defined


def test_in_model_exchange_commutation_ticks_behind_the_sectors_edge(make: Make) -> None:  # noqa: F811
    motor = make("motor_bldc", Model).initialise(PHASES)
    motor.fmu.updateDiscreteStates()
    assert not motor.ticks("commutation")
    motor.fmu.enterContinuousTimeMode()
    names = [v.derivative.name for v in motor.variables.values() if v.derivative is not None]
    states = np.array([motor[n] for n in names])
    states[names.index("phi")] += np.pi / 3
    motor.fmu.setContinuousStates(np.ctypeslib.as_ctypes(states), len(states))
    motor.fmu.enterEventMode()
    assert motor.ticks("commutation")
    motor.fmu.updateDiscreteStates()
    assert not motor.ticks("commutation")


def test_whether_the_encoder_is_clocked_is_part_of_the_state(make: Make) -> None:  # noqa: F811
    motor, other = make("motor_bldc", Model).initialise(), make("motor_bldc", Model).initialise()
    motor.tick("encoder_clock")
    motor.fmu.updateDiscreteStates()
    other.fmu.setFMUState(other.fmu.deserializeFMUState(motor.fmu.serializeFMUState(motor.fmu.getFMUState())))
    assert not other.fmu.updateDiscreteStates()[4]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda m: m.tick("commutation"), "is no clock that a master sets"),
        (lambda m: m.tick("w"), "is no clock that a master sets"),
        (lambda m: m.ticks("w"), "is no clock"),
        (lambda m: (m.tick("encoder_clock"), m.fmu.setClock(m.vr("encoder_clock"), [False])), "cannot be taken back"),
        (lambda m: (m.fmu.enterStepMode(), m.ticks("commutation")), "not allowed while the unit is initialized"),
    ],
)
def test_what_no_clock_does_is_refused(make: Make, wrong: Callable[[Slave], object], said: str) -> None:  # noqa: F811
    motor = make("motor_bldc", **EVENTS).initialise()
    with pytest.raises(FMICallException):
        wrong(motor)
    assert said in " ".join(motor.log)


def test_a_clock_that_is_not_ticking_may_be_set_inactive(make: Make) -> None:  # noqa: F811
    motor = make("motor_bldc", **EVENTS).initialise()
    motor.fmu.setClock(motor.vr("encoder_clock"), [False])
    assert not motor.ticks("encoder_clock")
    motor.tick("encoder_clock")
    assert motor.ticks("encoder_clock")
