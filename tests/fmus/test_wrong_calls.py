"""Wrong calls: a message that says why, and nothing changed: values are discarded, an error ends the run."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    fmi2CoSimulation,
    fmi2Discard,
    fmi2Error,
    fmi2LastSuccessfulTime,
    fmi2ModelExchange,
    fmi2Terminated,
)

Make = Callable[..., Any]
Call = Callable[[Any], Any]
NAN, INF = float("nan"), float("inf")


def raw(function: str, *arguments: Any) -> Call:
    """Straight into the library, so that even what FMPy would never send arrives."""
    return lambda slave: call(slave, function, *arguments)


def call(slave: Any, function: str, *arguments: Any) -> None:
    f = slave.fmu.dll[function]
    f.restype = ctypes.c_int
    status = f(ctypes.c_void_p(slave.fmu.component), *arguments)
    assert status == 3, f"{function} returned {status}, not fmi2Error"
    raise FMICallException(function=function, status=status)


UNKNOWN = (ctypes.c_uint * 1)(99999)
ONE = (ctypes.c_double * 1)(1.0)
SIZE = ctypes.c_size_t


def first_parameter(s: Any) -> str:
    return next(n for n, v in s.unit.variables.items() if v.causality == "parameter" and v.type == "Real")


WHILE_STEPPING: dict[str, tuple[Call, str]] = {
    "read of an unknown real": (lambda s: s.fmu.getReal([99999]), "99999"),
    "read of an unknown integer": (lambda s: s.fmu.getInteger([99999]), "99999"),
    "read of the reference 0 as an integer": (lambda s: s.fmu.getInteger([0]), "0"),
    "read of an unknown Boolean": (lambda s: s.fmu.getBoolean([99999]), "99999"),
    "read of a string": (lambda s: s.fmu.getString([0]), "no string"),
    "write of an unknown real": (lambda s: s.fmu.setReal([99999], [1.0]), "99999"),
    "write of an unknown integer": (lambda s: s.fmu.setInteger([99999], [1]), "99999"),
    "write of an unknown Boolean": (lambda s: s.fmu.setBoolean([99999], [True]), "99999"),
    "write of a string": (lambda s: s.fmu.setString([0], ["x"]), "no string"),
    "NaN as an input": (lambda s: s.set({s.inputs()[0]: NAN}), "not finite"),
    "infinity as an input": (lambda s: s.set({s.inputs()[0]: INF}), "not finite"),
    "minus infinity as an input": (lambda s: s.set({s.inputs()[0]: -INF}), "not finite"),
    "write of an output": (lambda s: s.set({s.outputs()[-1]: 1.0}), "cannot be set"),
    "list of reals without references": (raw("fmi2GetReal", None, SIZE(1), ONE), "NULL"),
    "list of reals without values": (raw("fmi2SetReal", UNKNOWN, SIZE(1), None), "NULL"),
    "derivative of order zero": (lambda s: s.fmu.setRealInputDerivatives(s.vr(s.inputs()[0]), [0], [1.0]), "order 0"),
    "derivative of order four": (lambda s: s.fmu.setRealInputDerivatives(s.vr(s.inputs()[0]), [4], [1.0]), "order 4"),
    "derivative that is NaN": (lambda s: s.slope(s.inputs()[0], NAN), "is nan"),
    "derivative of an output as input": (lambda s: s.slope(s.outputs()[0], 1.0), "no input"),
    "derivatives without orders": (raw("fmi2SetRealInputDerivatives", UNKNOWN, SIZE(1), None, ONE), "NULL|99999"),
    "second derivative of an output": (
        lambda s: s.fmu.getRealOutputDerivatives(s.vr(s.outputs()[0]), [2]),
        "order 2",
    ),
    "output derivative of an input": (lambda s: s.rate(s.inputs()[0]), "no output"),
    "step of no length": (lambda s: s.fmu.doStep(s.time, 0.0), "positive"),
    "step backwards": (lambda s: s.fmu.doStep(s.time, -1e-3), "positive"),
    "step of length NaN": (lambda s: s.fmu.doStep(s.time, NAN), "positive"),
    "step of infinite length": (lambda s: s.fmu.doStep(s.time, INF), "positive"),
    "step from somewhere else": (lambda s: s.fmu.doStep(s.time + 0.5, 1e-3), "but the unit is at"),
    "step from minus infinity": (lambda s: s.fmu.doStep(-INF, 1e-3), "but the unit is at"),
    "step from infinity": (lambda s: s.fmu.doStep(INF, 1e-3), "but the unit is at"),
    "step from NaN": (lambda s: s.fmu.doStep(NAN, 1e-3), "but the unit is at"),
    "second set-up": (lambda s: s.fmu.setupExperiment(), "not allowed"),
    "second initialization": (lambda s: s.fmu.enterInitializationMode(), "not allowed"),
    "second end of initialization": (lambda s: s.fmu.exitInitializationMode(), "not allowed"),
    "cancelled step": (lambda s: s.fmu.cancelStep(), "fmi2CancelStep"),
    "status of a step": (lambda s: s.fmu.getStatus(0), "fmi2GetStatus"),
    "integer status": (lambda s: s.fmu.getIntegerStatus(0), "fmi2GetIntegerStatus"),
    "unknown log category": (lambda s: s.fmu.setDebugLogging(True, ["logEverything"]), "logEverything"),
    "directional derivative of an input": (
        lambda s: s.fmu.getDirectionalDerivative(s.vr(s.inputs()[0]), s.vr(s.inputs()[0]), [1.0]),
        "no real output",
    ),
    "directional derivative along an output": (
        lambda s: s.fmu.getDirectionalDerivative(s.vr(s.outputs()[0]), s.vr(s.outputs()[-1]), [1.0]),
        "no real input",
    ),
    "directional derivative by a parameter while stepping": (
        lambda s: s.fmu.getDirectionalDerivative(s.vr(s.outputs()[0]), s.vr(first_parameter(s)), [1.0]),
        "nor a parameter",
    ),
    "directional derivative along NaN": (
        lambda s: s.fmu.getDirectionalDerivative(s.vr(s.outputs()[0]), s.vr(s.inputs()[0]), [NAN]),
        "not finite",
    ),
    "FMU state from nowhere": (raw("fmi2SetFMUstate", None), "NULL"),
    "FMU state of something else": (raw("fmi2SetFMUstate", (ctypes.c_char * 65536)()), "no state of a"),
    "bytes of something else": (lambda s: s.fmu.deSerializeFMUstate(b"x" * 100000), "no state of a"),
    "too few bytes": (lambda s: s.fmu.deSerializeFMUstate(b"x"), "no state of a"),
}


DISCARDED = {
    "NaN as an input",
    "infinity as an input",
    "minus infinity as an input",
    "status of a step",
    "integer status",
}


def steps(slave: Any, n: int = 20) -> np.ndarray:
    rows = []
    for _ in range(n):
        slave.set({slave.inputs()[0]: 0.1 * np.sin(20 * slave.time)})
        slave.step(2e-3)
        rows.append(slave.reals(slave.outputs()))
    return np.array(rows)


@pytest.mark.parametrize("what", WHILE_STEPPING)
def test_wrong_call_is_refused_with_a_message_and_changes_nothing(make: Make, name: str, what: str) -> None:
    """FMI 2.0.4, 2.1.3: values are discarded; after an error an instance goes on from a kept state only"""
    wrong, word = WHILE_STEPPING[what]
    expected = steps(make(name), 10)
    slave = make(name)
    before = steps(slave, 5)
    state, time = slave.fmu.getFMUstate(), slave.time
    slave.log.clear()
    with pytest.raises(FMICallException) as refused:
        wrong(slave)
    assert any(any(part in line for part in word.split("|")) for line in slave.log), slave.log
    assert refused.value.status == (fmi2Discard if what in DISCARDED else fmi2Error)
    if what not in DISCARDED:
        with pytest.raises(FMICallException) as again:
            slave.step(1e-3)
        assert again.value.status == fmi2Error
        slave.fmu.setFMUstate(state)
        slave.time = time
    np.testing.assert_array_equal(np.vstack([before, steps(slave, 5)]), expected)
    slave.fmu.freeFMUstate(state)


def test_list_with_one_wrong_value_sets_none_of_them(make: Make, name: str) -> None:
    slave = make(name)
    inputs = slave.inputs()[:2]
    before = [slave[n] for n in inputs]
    with pytest.raises(FMICallException):
        slave.fmu.setReal(slave.vr(*inputs), [0.123, NAN])
    assert [slave[n] for n in inputs] == before


def bounded_parameters(slave: Any) -> list[tuple[str, float]]:
    found = []
    for name, v in slave.unit.variables.items():
        if v.causality == "parameter" and v.type == "Real":
            low, high = slave.unit.bounds_of(name)
            found += [(name, low - 1 - abs(low)), (name, high + 1 + abs(high))]
    return found


def test_parameters_outside_their_bounds_are_refused_with_both_bounds(make: Make, name: str) -> None:
    slave = make(name)
    for parameter, value in bounded_parameters(slave):
        before = slave[parameter]
        slave.log.clear()
        with pytest.raises(FMICallException):
            slave.set({parameter: value})
        assert parameter in slave.log[0]
        assert "is outside" in slave.log[0]
        assert slave[parameter] == before


@pytest.mark.parametrize("name", ["motor_bldc", "planetary_gear", "mr_brake_belt", "driven_load"])
def test_states_cannot_be_moved_once_the_unit_is_initialised(make: Make, name: str) -> None:
    slave = make(name)
    state = next(n for n, v in slave.unit.variables.items() if v.causality == "output" and v.initial == "exact")
    with pytest.raises(FMICallException):
        slave.set({state: 1.0})
    assert "is a state" in slave.log[0]


def test_choices_are_checked_and_then_fixed(make: Make, instantiate: Make) -> None:
    with pytest.raises(FMICallException):
        instantiate("motor_bldc").set({"motor.level": 6})
    motor = make("motor_bldc")
    with pytest.raises(FMICallException):
        motor.set({"motor.level": 2})
    assert "is fixed" in motor.log[0]


def test_no_step_before_the_initialization(instantiate: Make, name: str) -> None:
    slave = instantiate(name)
    for wrong in (lambda: slave.fmu.doStep(0.0, 1e-3), slave.fmu.exitInitializationMode, slave.fmu.terminate):
        with pytest.raises(FMICallException):
            wrong()
        slave.fmu.reset()
    assert all("not allowed while the unit is instantiated" in line for line in slave.log)
    slave.initialise()
    slave.step(1e-3)


def test_terminated_unit_can_be_read_and_reset_and_nothing_else(make: Make, name: str) -> None:
    slave = make(name)
    slave.step(1e-3)
    slave.fmu.terminate()
    assert np.all(np.isfinite(slave.reals(slave.outputs())))
    for wrong in (lambda: slave.step(1e-3), lambda: slave.set({slave.inputs()[0]: 1.0}), slave.fmu.terminate):
        with pytest.raises(FMICallException):
            wrong()
        assert np.all(np.isfinite(slave.reals(slave.outputs())))
    slave.fmu.reset()
    slave.initialise()
    slave.step(1e-3)


@pytest.mark.parametrize(
    ("setup", "word"),
    [
        ({"startTime": NAN}, "startTime"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"tolerance": 1.0}, "tolerance"),
        ({"startTime": 2.0, "stopTime": 1.0}, "stopTime"),
    ],
)
def test_experiment_is_checked(instantiate: Make, setup: dict[str, float], word: str) -> None:
    slave = instantiate("mr_brake_belt")
    with pytest.raises(FMICallException):
        slave.fmu.setupExperiment(**setup)
    assert word in slave.log[0]


def test_no_step_beyond_the_stop_time(instantiate: Make) -> None:
    slave = instantiate("mr_brake_belt")
    slave.fmu.setupExperiment(stopTime=1.0)
    slave.fmu.enterInitializationMode()
    slave.fmu.exitInitializationMode()
    slave.step(1.0)
    with pytest.raises(FMICallException):
        slave.step(1e-3)
    assert "stop time" in slave.log[0]


def test_instance_is_refused_with_a_message(instantiate: Make, name: str) -> None:
    slave = instantiate(name)
    guid = slave.unit.description.guid.encode()
    resources = slave.unit.directory.as_uri().encode() + b"/resources"
    f = slave.fmu.dll.fmi2Instantiate
    f.restype = ctypes.c_void_p
    callbacks = ctypes.byref(slave.callbacks)
    wrong = {
        "GUID": (b"x", fmi2CoSimulation, b"{no such}", resources, callbacks, 0, 0),
        "no GUID": (b"x", fmi2CoSimulation, None, resources, callbacks, 0, 0),
        "name is empty": (b"", fmi2CoSimulation, guid, resources, callbacks, 0, 0),
    }
    if slave.unit.description.modelExchange is None:
        wrong["only co-simulation is offered: "] = (b"x", fmi2ModelExchange, guid, resources, callbacks, 0, 0)
    for word, arguments in wrong.items():
        slave.log.clear()
        assert f(*arguments) is None
        assert word in slave.log[0]
    assert f(b"x", fmi2CoSimulation, guid, resources, None, 0, 0) is None


@pytest.mark.parametrize(
    "function", ["fmi2GetReal", "fmi2SetReal", "fmi2DoStep", "fmi2Reset", "fmi2Terminate", "fmi2GetFMUstate"]
)
def test_no_instance_is_an_error_and_no_crash(instantiate: Make, function: str) -> None:
    f = instantiate("torque_sensor").fmu.dll[function]
    f.restype = ctypes.c_int
    assert f(None, None, SIZE(0), None) == 3


def test_overflow_in_the_initialization_fails_cleanly(instantiate: Make) -> None:
    slave = instantiate("torque_sensor")
    with pytest.raises(FMICallException):
        slave.initialise({"phi_o": 1e308})
    assert "is not finite" in slave.log[0]
    recovers(slave)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("torque_sensor", {"phi_o": 1e308}),
        ("mr_brake_belt", {"tau_s": 1e308}),
        ("driven_load", {"tau": 1e308}),
        ("motor_bldc", {"tau": 1e308}),
        ("planetary_gear", {"tau_s": 1e308}),
        ("acquisition", {"i_motor": 1e308, "current_offset.i_0": 1.0, "range.k_i": 1e9}),
    ],
)
def test_overflow_in_a_step_fails_cleanly_or_is_harmless(make: Make, name: str, values: dict[str, float]) -> None:
    slave = make(name)
    slave.set(values)
    try:
        slave.step(1e-3)
    except FMICallException:
        assert "fmi2DoStep" in slave.log[0]
        with pytest.raises(FMICallException):
            slave.step(1e-3)
        assert "while the unit is" in slave.log[1]
        recovers(slave)
    else:
        assert np.all(np.isfinite(slave.reals(slave.outputs())))


def recovers(slave: Any) -> None:
    slave.fmu.reset()
    slave.initialise()
    slave.step(1e-3)
    assert np.all(np.isfinite(slave.reals(slave.outputs())))


def test_nothing_is_read_before_the_initialization(instantiate: Make, name: str) -> None:
    slave = instantiate(name)
    with pytest.raises(FMICallException):
        slave.reals(slave.outputs())
    assert "fmi2GetReal: not allowed while the unit is instantiated" in slave.log[0]


def test_failed_unit_cannot_be_terminated(make: Make) -> None:
    slave = make("mr_brake_belt")
    with pytest.raises(FMICallException):
        slave.fmu.doStep(0.5, 1e-3)
    with pytest.raises(FMICallException):
        slave.fmu.terminate()
    recovers(slave)


def test_step_that_cannot_be_finished_is_discarded_and_says_how_far_it_got(make: Make) -> None:
    """FMI 2.0.4, 4.2.2 and 4.2.3: fmi2LastSuccessfulTime, fmi2Terminated; the unit may be read and terminated"""
    slave = make("mr_brake_belt")
    slave.step(1e-3)
    assert not slave.fmu.getBooleanStatus(fmi2Terminated)
    state, w = slave.fmu.getFMUstate(), slave["w_p"]
    slave.set({"tau_s": 1e308})
    with pytest.raises(FMICallException) as refused:
        slave.step(1e-3)
    assert refused.value.status == fmi2Discard
    assert slave.fmu.getRealStatus(fmi2LastSuccessfulTime) == pytest.approx(1e-3, rel=1e-12)
    assert not slave.fmu.getBooleanStatus(fmi2Terminated)  # it does not ask the master to end
    assert slave["w_p"] == w
    slave.fmu.terminate()
    slave.fmu.setFMUstate(state)
    slave.time = 1e-3
    slave.step(1e-3)
    slave.fmu.freeFMUstate(state)


@pytest.mark.parametrize(
    ("name", "fixed"),
    [("motor_bldc", "rotor.J"), ("planetary_gear", "ratio.N"), ("mr_brake_belt", "belt.r"), ("driven_load", "body.m"),
     ("acquisition", "sampling.T_s")],
)  # fmt: skip
def test_geometry_inertia_and_sampling_are_fixed_once_the_unit_is_initialised(
    make: Make, name: str, fixed: str
) -> None:
    slave = make(name, {fixed: 2.0})
    assert slave.unit.variables[fixed].variability == "fixed"
    with pytest.raises(FMICallException):
        slave.set({fixed: 1.0})
    assert f"{fixed} is fixed once the unit is initialized" in slave.log[0]


@pytest.mark.parametrize("categories", [[], ["logEvents"], ["logStatusError"]])
def test_located_events_are_logged_when_their_category_is_on(make: Make, categories: list[str]) -> None:
    """the flanks meet after half of the backlash, 0.5 deg at the output"""
    gear = make("planetary_gear")
    gear.fmu.setDebugLogging(True, categories)
    gear.set({"w": 100.0, "phi": 0.0})
    gear.slope("phi", 100.0)
    gear.step(0.02)
    said = [line for line in gear.log if line.startswith("the gap closes, motor ahead: ")]
    if categories == ["logStatusError"]:
        assert not gear.log
    else:
        meeting = np.radians(0.5) * 338 / 3 / 100.0
        assert float(said[0].split(" at ")[1].split(" s")[0]) >= meeting * (1 - 1e-6)
    gear.log.clear()
    gear.fmu.setDebugLogging(False, ["logEvents"])
    gear.step(0.02)
    assert not gear.log
