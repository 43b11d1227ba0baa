"""Every unit as an FMI 3.0 FMU: it validates, does what the FMI 2.0 one does, and opens its events and steps."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Model, FMU3Slave
from fmpy.validation import validate_fmu

from cobot_joint.units import Unit, find_fmu

UNITS = sorted(table.parent.name for table in (Path(__file__).parents[2] / "fmus").glob("*/model.def"))
TAKES = {"Float64": "Float64", "Int32": "Int32", "Enumeration": "Int64", "Boolean": "Boolean"}

HEADERS = Path(fmpy.__file__).parent / "c-code"
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only", "-DFMI3_OVERRIDE_FUNCTION_PREFIX"]

Load = Callable[[str], Unit]


def fmi3(name: str) -> Path:
    return find_fmu(f"{name}.fmu").parent / "fmi3" / f"{name}.fmu"


class Slave:
    """An instance of a unit; names of variables in place of references."""

    KIND: Any = FMU3Slave

    def __init__(self, name: str, folder: Path, **setup: Any) -> None:
        self.description = fmpy.read_model_description(str(fmi3(name)))
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.log: list[str] = []
        self.fmu = self.KIND(
            guid=self.description.instantiationToken, modelIdentifier=name, instanceName=name,
            unzipDirectory=fmpy.extract(str(fmi3(name)), unzipdir=str(folder / name)),
        )  # fmt: skip
        self.fmu.instantiate(loggingOn=True, logMessage=lambda *said: self.log.append(said[-1].decode()), **setup)

    def initialise(self, start: Mapping[str, float] | None = None) -> Slave:
        self.fmu.enterInitializationMode()
        self.set(start or {})
        self.fmu.exitInitializationMode()
        return self

    def vr(self, name: str) -> list[int]:
        return [self.variables[name].valueReference]

    def set(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            getattr(self.fmu, f"set{TAKES[self.variables[name].type]}")(self.vr(name), [value])

    def __getitem__(self, name: str) -> float:
        return float(getattr(self.fmu, f"get{TAKES[self.variables[name].type]}")(self.vr(name))[0])

    def outputs(self) -> list[float]:
        return [self[v.name] for v in self.variables.values() if v.causality == "output" and v.type != "Clock"]

    def ticks(self, clock: str) -> bool:
        return bool(self.fmu.getClock(self.vr(clock))[0])

    def tick(self, clock: str) -> None:
        self.fmu.setClock(self.vr(clock), [True])


class Model(Slave):
    """The same for model exchange."""

    KIND = FMU3Model


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Callable[..., Slave]]:
    made = []

    def instantiate(name: str, kind: type[Slave] = Slave, **setup: Any) -> Slave:
        made.append(kind(name, tmp_path / str(len(made)), **setup))
        return made[-1]

    yield instantiate
    for slave in made:
        slave.fmu.freeInstance()


def waves(path: Path, end: float) -> np.ndarray:
    """Every real input as a sine of 0.3 of its nominal value."""
    inputs = [v for v in fmpy.read_model_description(str(path)).modelVariables if v.causality == "input"]
    reals = [v for v in inputs if v.type in ("Real", "Float64") and not v.name.startswith("J_")]
    signals = np.zeros(1001, dtype=[("time", float), *((v.name, float) for v in reals)])
    signals["time"] = np.linspace(0.0, end, len(signals))
    for k, v in enumerate(reals):
        signals[v.name] = 0.3 * float(v.nominal) * np.sin((20 + k) * signals["time"])
    return signals


def simulated(path: Path, **how: Any) -> np.ndarray:
    return fmpy.simulate_fmu(str(path), stop_time=0.2, output_interval=1e-3, input=waves(path, 0.2), **how)


def test_validation_has_no_finding(name: str) -> None:
    assert validate_fmu(str(fmi3(name))) == []


def test_fmpy_simulates_it_to_the_bit_like_the_fmi_2_unit(name: str) -> None:
    two, three = simulated(find_fmu(f"{name}.fmu")), simulated(fmi3(name))
    assert two.dtype.names == three.dtype.names
    for signal in two.dtype.names:
        np.testing.assert_array_equal(two[signal], three[signal], err_msg=signal)


def test_it_has_the_variables_of_the_fmi_2_unit_time_event_indicators_and_clocks(load: Load, name: str) -> None:
    unit = load(name)
    two = unit.variables
    three = {v.name: v for v in fmpy.read_model_description(str(fmi3(name))).modelVariables}
    clocks = [key for key, v in three.items() if v.type == "Clock"]
    indicators = list(three)[1 + len(two) : len(three) - len(clocks)]
    assert list(three)[: 1 + len(two)] == ["time", *two]
    assert clocks == (["commutation", "encoder_clock"] if name == "motor_bldc" else [])
    assert all(indicator.startswith("z_") for indicator in indicators)
    exchanged = unit.description.modelExchange is not None
    assert len(indicators) == (unit.description.numberOfEventIndicators if exchanged else 0)
    for key, v in two.items():
        assert (v.causality, v.variability, v.unit) == (three[key].causality, three[key].variability, three[key].unit)
        if v.start is not None:
            assert float(v.start) == float(three[key].start) if v.type == "Real" else v.start == three[key].start


def test_a_state_that_went_through_bytes_goes_on_to_the_bit(make: Callable[..., Slave], name: str) -> None:
    slave, other = make(name).initialise(), make(name).initialise()
    inputs = [v for v in slave.variables.values() if v.causality == "input" and v.type == "Float64"]
    slave.set({v.name: 0.3 * float(v.nominal) for v in inputs if not v.name.startswith("J_")})
    slave.fmu.doStep(0.0, 0.01)
    state = slave.fmu.getFMUState()
    other.fmu.setFMUState(other.fmu.deserializeFMUState(slave.fmu.serializeFMUState(state)))
    for s in (slave, other):
        s.fmu.doStep(0.01, 0.01)
    assert slave["time"] == other["time"] == 0.02
    assert slave.outputs() == other.outputs()
    slave.fmu.setFMUState(state)
    slave.fmu.doStep(0.01, 0.01)
    assert slave.outputs() == other.outputs()


def test_a_step_ends_at_an_event_in_event_mode_and_goes_on_as_without(make: Callable[..., Slave]) -> None:
    """a gear's output that turns through the gap until the teeth touch"""
    gap = {"backlash.b_x": 0.01, "w_o": 1.0}
    plain = make("planetary_gear").initialise(gap)
    stepped = make("planetary_gear", eventModeUsed=True, earlyReturnAllowed=True).initialise(gap)
    stepped.fmu.updateDiscreteStates()
    stepped.fmu.enterStepMode()
    plain.fmu.doStep(0.0, 0.2)
    times, t = [], 0.0
    while t < 0.2:
        event, _, early, last = stepped.fmu.doStep(t, 0.2 - t)
        assert early == (last < 0.2)
        t = last
        if event:
            times.append(t)
            stepped.fmu.enterEventMode()
            assert stepped.fmu.updateDiscreteStates()[3]  # states, or what stands for them, have changed
            stepped.fmu.enterStepMode()
    assert all(np.diff(times) >= 0)
    assert 0 < times[0] < 0.2
    assert stepped.outputs() == pytest.approx(plain.outputs(), rel=1e-6, abs=1e-9)


def test_edges_of_the_bridges_pulses_are_events_of_the_master_too(make: Callable[..., Slave]) -> None:
    """a period of 0.1 ms and a duty of a quarter, in steps of 0.13 ms that go on as without events"""
    T, h = 1e-4, 1.3e-4
    start = {"motor.level": 5, "pwm.T": T, "set_value": 6.0, "drive.i_peak": 0.0}
    plain = make("motor_bldc").initialise(start)
    stepped = make("motor_bldc", eventModeUsed=True, earlyReturnAllowed=True).initialise(start)
    stepped.fmu.updateDiscreteStates()
    stepped.fmu.enterStepMode()
    times: list[float] = []
    for k in range(4):
        plain.fmu.doStep(k * h, h)
        t, end = k * h, (k + 1) * h
        while t < end:
            event, _, early, last = stepped.fmu.doStep(t, end - t)
            assert event == early
            t = last if early else end
            if event:
                times.append(last)
                stepped.fmu.enterEventMode()
                stepped.fmu.updateDiscreteStates()
                stepped.fmu.enterStepMode()
        assert stepped["i"] == pytest.approx(plain["i"], abs=1e-5)
        assert stepped["v"] == plain["v"]
    expected = sorted([n * T for n in range(1, 6)] + [(n + x) * T for n in range(5) for x in (0.375, 0.625)])
    assert times == pytest.approx([x for x in expected if x < 4 * h], rel=1e-12)


def test_within_a_step_a_master_reads_sets_and_ends_it(make: Callable[..., Slave]) -> None:
    seen: list[tuple[float, float]] = []

    def look(_environment: Any, t: float, *said: Any) -> None:
        *allowed, end, end_time = said  # set, get, the integrator's step is finished, the step may end
        seen.append((t, slave["w"] if all(allowed) else np.nan))
        slave.set({"set_value": 6.0 if t < 5e-3 else 0.0})
        if t > 8e-3:
            end[0], end_time[0] = True, t

    slave = make("motor_bldc", earlyReturnAllowed=True, intermediateUpdate=look).initialise()
    event, terminate, early, last = slave.fmu.doStep(0.0, 0.02)
    assert (event, terminate, early) == (False, False, True)
    times, speeds = zip(*seen, strict=True)
    assert all(np.diff(times) > 0)
    assert 8e-3 < times[-1] == last == slave["time"] < 0.02
    assert speeds[0] < speeds[-1]
    assert slave["set_value"] == 0.0
    slave.fmu.doStep(last, 0.02 - last)  # from where it is
    with pytest.raises(FMICallException):
        slave.fmu.doStep(0.5, 0.01)
    assert "fmi3DoStep: currentCommunicationPoint 0.5" in slave.log[-1]


def test_a_call_that_is_refused_within_a_step_refuses_the_step(make: Callable[..., Slave]) -> None:
    def reset(_environment: Any, _t: float, *_said: Any) -> None:
        with pytest.raises(FMICallException):
            slave.fmu.reset()

    slave = make("motor_bldc", intermediateUpdate=reset).initialise()
    with pytest.raises(FMICallException):
        slave.fmu.doStep(0.0, 0.01)
    assert slave.log == ["fmi3Reset: not allowed while the unit is within a step"]


def test_a_directional_derivative_takes_a_seed_per_known_and_gives_a_sensitivity_per_unknown(
    make: Callable[..., Slave],
) -> None:
    slave = make("motor_bldc").initialise()
    known, unknown = slave.vr("set_value"), slave.vr("der(w)")
    assert len(slave.fmu.getDirectionalDerivative(unknown, known, [1.0], 1)) == 1
    for seed, sensitivities in (([], 1), ([1.0], 0)):
        with pytest.raises(FMICallException):
            slave.fmu.getDirectionalDerivative(unknown, known, seed, sensitivities)
        assert slave.log[-1].startswith("fmi3GetDirectionalDerivative: ")
        slave.fmu.reset()
        slave.initialise()


def test_choices_are_enumerations(make: Callable[..., Slave]) -> None:
    slave = make("motor_bldc")
    level = slave.variables["motor.level"]
    assert level.type == "Enumeration"
    assert next(item.name for item in level.declaredType.items) == "averaged"
    slave.initialise({"motor.level": 2})
    assert slave["motor.level"] == 2
    with pytest.raises(FMICallException):
        slave.fmu.getInt32(slave.vr("motor.level"))


@pytest.mark.parametrize("wrong", ["time", "w", "i"])
def test_what_the_unit_calculates_cannot_be_set(make: Callable[..., Slave], wrong: str) -> None:
    slave = make("motor_bldc").initialise()
    with pytest.raises(FMICallException):
        slave.fmu.setFloat64(slave.vr(wrong), [1.0])
    assert slave.log[-1].startswith("fmi3SetFloat64: ")


def test_a_unit_without_events_refuses_event_mode(make: Callable[..., Slave]) -> None:
    with pytest.raises(Exception, match="instantiate"):
        make("torque_sensor", eventModeUsed=True)


def test_an_outputs_derivative_is_its_slope(make: Callable[..., Slave]) -> None:
    slave = make("motor_bldc").initialise({"set_value": 6.0})
    slave.fmu.doStep(0.0, 0.01)
    before, slope = slave["w"], float(slave.fmu.getOutputDerivatives(slave.vr("w"), [1])[0])
    slave.fmu.doStep(0.01, 1e-6)
    assert slope == pytest.approx((slave["w"] - before) / 1e-6, rel=1e-3)
    assert slope == pytest.approx(slave["der(w)"], rel=1e-3)


def exchanged(path: Path) -> np.ndarray:
    """Integrated by FMPy's CVode, what is not driven, which FMPy does not apply to derivatives."""
    reals = [v for v in fmpy.read_model_description(str(path)).modelVariables if v.type in ("Real", "Float64")]
    start = {v.name: 0.3 * float(v.nominal) for v in reals if v.causality == "input" and not v.name.startswith("J_")}
    return fmpy.simulate_fmu(
        str(path), fmi_type="ModelExchange", stop_time=0.05, output_interval=1e-3, start_values=start,
        output=[v.name for v in reals if v.causality == "output"], relative_tolerance=1e-8, record_events=False,
    )  # fmt: skip


def test_fmpy_integrates_it_to_the_bit_like_the_fmi_2_unit(load: Load, name: str) -> None:
    if load(name).description.modelExchange is None:
        assert name == "acquisition"
        pytest.skip("the logger takes its samples at communication points")
    two, three = exchanged(find_fmu(f"{name}.fmu")), exchanged(fmi3(name))
    for signal in two.dtype.names:
        np.testing.assert_array_equal(two[signal], three[signal], err_msg=signal)


def vector(read: Callable[[Any, int], None], n: int) -> list[float]:
    values = (ctypes.c_double * n)()
    read(values, n)
    return list(values)


def test_event_indicators_are_variables(make: Callable[..., Slave]) -> None:
    gear = make("planetary_gear", Model).initialise({"backlash.b_x": 0.01})
    names = [v for v in gear.variables if v.startswith("z_")]
    assert vector(gear.fmu.getEventIndicators, len(names)) == [gear[v] for v in names]
    assert gear["z_touch_front"] < 0.0
    with pytest.raises(FMICallException):
        gear.set({"z_touch_front": 1.0})


def test_what_the_drive_samples_is_a_time_event(make: Callable[..., Slave]) -> None:
    motor = make("motor_bldc", Model).initialise()
    defined, time = motor.fmu.updateDiscreteStates()[4:]
    assert defined
    assert time == pytest.approx(1e-3)


@pytest.mark.parametrize("call", ["enterStepMode", "doStep", "getOutputDerivatives"])
def test_calls_of_co_simulation_are_errors_in_model_exchange(make: Callable[..., Slave], call: str) -> None:
    motor = make("motor_bldc", Model).initialise()
    reference, zero, one = ctypes.c_uint32(0), ctypes.c_double(0.0), ctypes.c_size_t(1)
    arguments = {
        "enterStepMode": (),
        "doStep": (zero, ctypes.c_double(1e-3), False, *(ctypes.byref(ctypes.c_double()) for _ in range(4))),
        "getOutputDerivatives": (
            ctypes.byref(reference),
            one,
            ctypes.byref(ctypes.c_int32(1)),
            ctypes.byref(zero),
            one,
        ),
    }[call]
    function = motor.fmu.dll[f"fmi3{call[0].upper()}{call[1:]}"]
    assert function(ctypes.c_void_p(motor.fmu.component), *arguments) == 3
    assert motor.log[-1].startswith(f"fmi3{call[0].upper()}{call[1:]}: ")


def test_calls_of_model_exchange_are_errors_in_co_simulation(make: Callable[..., Slave]) -> None:
    gear = make("planetary_gear", eventModeUsed=True).initialise()
    for call, arguments in {"SetTime": (ctypes.c_double(0.0),), "EnterContinuousTimeMode": ()}.items():
        assert gear.fmu.dll[f"fmi3{call}"](ctypes.c_void_p(gear.fmu.component), *arguments) == 3
        assert gear.log[-1] == f"fmi3{call}: only for model exchange"
        gear.fmu.reset()
        gear.initialise()


def test_a_state_of_one_kind_of_instance_is_refused_by_the_other(make: Callable[..., Slave]) -> None:
    stepped, integrated = make("planetary_gear").initialise(), make("planetary_gear", Model).initialise()
    for one, other in ((stepped, integrated), (integrated, stepped)):
        state = one.fmu.getFMUState()
        one.fmu.setFMUState(state)
        with pytest.raises(FMICallException):
            other.fmu.setFMUState(state)
        one.fmu.freeFMUState(state)
        other.fmu.reset()
        other.initialise()


def test_its_sources_compile_without_those_of_fmi_2(compiler: str, tmp_path: Path, name: str) -> None:
    sources = Path(fmpy.extract(str(fmi3(name)), unzipdir=str(tmp_path))) / "sources"
    assert not (sources / "fmi2").exists()
    call = [compiler, *STRICT, "-I", str(sources), "-I", str(HEADERS), str(sources / "all.c")]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
