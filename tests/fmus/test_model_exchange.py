"""Units as FMI 2.0 model exchange: an integrator that is not ours gets the answers of co-simulation."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model, fmi2Error
from scipy.integrate import solve_ivp

from cobot_joint.units import Unit

Make = Callable[..., Any]
Load = Callable[[str], Unit]
Signal = Callable[[float], float]

TOLERANCE, BEYOND = 1e-8, 1e-9  # of the integrator, relative; s behind a root, where an event is told of
ON, STICK = {"enable": 1.0}, 2


class Exchanged:
    """A unit whose states SciPy integrates, from event to event."""

    def __init__(self, directory: Path) -> None:
        description = read_model_description(directory, validate=False)
        self.variables = {v.name: v for v in description.modelVariables}
        self.fmu = FMU2Model(
            guid=description.guid,
            modelIdentifier=description.modelExchange.modelIdentifier,
            unzipDirectory=str(directory),
            instanceName=description.modelName,
        )
        self.fmu.instantiate()
        self.n, self.events = description.numberOfContinuousStates, description.numberOfEventIndicators
        self.happened = 0

    def vr(self, name: str) -> list[int]:
        return [self.variables[name].valueReference]

    def set(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            kind = self.variables[name].type
            getattr(self.fmu, f"set{kind}")(self.vr(name), [value if kind == "Real" else int(value)])

    def vector(self, read: Callable[[Any, int], None], n: int) -> np.ndarray:
        values = (ctypes.c_double * n)()
        read(values, n)
        return np.array(values)

    def begin(self, start: Mapping[str, float], inputs: Mapping[str, Signal]) -> None:
        self.inputs = inputs
        self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        self.set({**start, **{name: signal(0.0) for name, signal in inputs.items()}})
        self.fmu.exitInitializationMode()
        self.next_event = self.update()
        self.fmu.enterContinuousTimeMode()

    def update(self) -> float:
        """The time of the next time event."""
        again = True
        while again:
            again, _, _, _, defined, time = self.fmu.newDiscreteStates()
        return float(time) if defined else np.inf

    def at(self, t: float, x: np.ndarray) -> None:
        self.fmu.setTime(t)
        self.set({name: signal(t) for name, signal in self.inputs.items()})
        self.fmu.setContinuousStates((ctypes.c_double * self.n)(*x), self.n)

    def slope(self, t: float, x: np.ndarray) -> np.ndarray:
        self.at(t, x)
        return self.vector(self.fmu.getDerivatives, self.n)

    def indicator(self, k: int) -> Callable[[float, np.ndarray], float]:
        def z(t: float, x: np.ndarray) -> float:
            self.at(t, x)
            return float(self.vector(self.fmu.getEventIndicators, self.events)[k])

        z.terminal, z.direction = True, 1  # type: ignore[attr-defined]
        return z

    def run(self, times: Sequence[float], record: Sequence[str]) -> dict[str, np.ndarray]:
        rows: list[list[float]] = [[self[name] for name in record]]
        t, x = 0.0, self.vector(self.fmu.getContinuousStates, self.n)
        nominal = self.vector(self.fmu.getNominalsOfContinuousStates, self.n)
        indicators = [self.indicator(k) for k in range(self.events)]
        for end in times[1:]:
            while t < end:
                until = min(end, self.next_event)
                done = solve_ivp(self.slope, (t, until), x, "RK45", rtol=TOLERANCE, atol=TOLERANCE * nominal,
                                 events=indicators, dense_output=True, max_step=2e-3)  # fmt: skip
                assert done.success, done.message
                met = done.status == 1
                t = float(done.t[-1]) + BEYOND * met
                x = done.sol(t) if met else done.y[:, -1]
                self.at(t, x)
                if met or t >= self.next_event:
                    self.happened += met
                    self.fmu.enterEventMode()
                    self.next_event = self.update()
                    self.fmu.enterContinuousTimeMode()
                    x = self.vector(self.fmu.getContinuousStates, self.n)
            rows.append([self[name] for name in record])
        return dict(zip(record, np.array(rows).T, strict=True))

    def __getitem__(self, name: str) -> float:
        return float(self.fmu.getReal(self.vr(name))[0])


@pytest.fixture
def exchange(load: Load) -> Iterator[Callable[..., Exchanged]]:
    units: list[Exchanged] = []

    def exchange(name: str) -> Exchanged:
        units.append(Exchanged(load(name).directory))
        return units[-1]

    yield exchange
    for unit in units:
        unit.fmu.freeInstance()


@pytest.fixture
def exchangeable(load: Load, name: str) -> str:
    """Each unit that offers model exchange, in turn."""
    if load(name).description.modelExchange is None:
        assert name == "acquisition"
        pytest.skip("the logger takes its samples at communication points")
    return name


def swinging(level: float, size: float, omega: float = 20.0) -> Signal:
    return lambda t: level + size * np.sin(omega * t)


def both(
    make: Make, exchange: Callable[..., Exchanged], name: str, start: dict[str, float], inputs: dict[str, Signal],
    end: float, record: Sequence[str] = (),
) -> tuple[Exchanged, dict[str, Any]]:  # fmt: skip
    """The unit integrated by SciPy, and per output (co-simulated, exchanged)."""
    slave, unit = make(name, {**start, **{n: f(0.0) for n, f in inputs.items()}}, tolerance=1e-8), exchange(name)
    outputs = list(record or slave.outputs())
    stepped = slave.run(end, 1e-4, outputs, inputs)
    unit.begin(start, inputs)
    exchanged = unit.run([float(t) for t in stepped["time"][::10]], outputs)
    return unit, {n: (stepped[n][::10], exchanged[n]) for n in outputs}


def agree(signals: Mapping[str, tuple[np.ndarray, np.ndarray]], within: float) -> None:
    """Work is no error-controlled state of co-simulation: ten times that."""
    for name, (stepped, exchanged) in signals.items():
        allowed = within * (10 if name.startswith("W") else 1) * np.max(np.abs(stepped)) + 1e-12
        assert exchanged == pytest.approx(stepped, abs=allowed), name


def test_a_foreign_integrator_gets_what_co_simulation_gives(
    make: Make, exchange: Callable[..., Exchanged], load: Load, exchangeable: str
) -> None:
    variables = load(exchangeable).variables
    nominal = {n: float(v.nominal) for n, v in variables.items() if v.causality == "input" and v.type == "Real"}
    inputs = {n: swinging(0.3 * x, 0.2 * x) for n, x in nominal.items() if n != "J_coupled"}
    start = ON if "enable" in variables else {}
    _, signals = both(make, exchange, exchangeable, start, inputs, 0.02)
    agree({n: s for n, s in signals.items() if n != "w_reading"}, 1e-4)


def test_commutation_and_freewheeling_are_state_events(make: Make, exchange: Callable[..., Exchanged]) -> None:
    start, inputs = {**ON, "motor.level": 2, "w": 300.0}, {"set_value": lambda t: 5.0}
    unit, signals = both(make, exchange, "motor_bldc", start, inputs, 0.03, ["w", "i_a", "e_a", "W"])
    assert unit.happened >= 12
    agree(signals, 1e-5)


def test_field_oriented_control_is_smooth(make: Make, exchange: Callable[..., Exchanged]) -> None:
    start, inputs = {**ON, "motor.level": 4, "w": 300.0}, {"set_value": swinging(5.0, 2.0, 300.0)}
    unit, signals = both(make, exchange, "motor_bldc", start, inputs, 0.02, ["w", "i", "i_a", "e_a", "W"])
    assert unit.happened == 0
    agree(signals, 1e-4)


def test_edges_of_the_bridges_pulses_are_time_events(make: Make, exchange: Callable[..., Exchanged]) -> None:
    T = 1e-4
    start = {**ON, "motor.level": 5, "pwm.T": T, "w": 300.0, "drive.i_peak": 0.0}
    unit, signals = both(
        make, exchange, "motor_bldc", start, {"set_value": lambda t: 6.0}, 0.01, ["w", "i", "W", "rise"]
    )
    assert unit.happened == 0
    agree(signals, 1e-6)
    again = exchange("motor_bldc")
    again.begin({**start, "set_value": 6.0}, {})
    edges = [again.next_event]
    for _ in range(5):
        again.fmu.setTime(edges[-1])
        again.fmu.enterEventMode()
        edges.append(again.update())
        again.fmu.enterContinuousTimeMode()
    assert edges == pytest.approx([0.375 * T, 0.625 * T, T, 1.375 * T, 1.625 * T, 2 * T], rel=1e-12)


def test_a_gear_that_rattles_in_its_backlash_meets_every_contact(
    make: Make, exchange: Callable[..., Exchanged]
) -> None:
    inputs = {"phi": swinging(0.0, 3.0, 60.0), "w": lambda t: 180.0 * np.cos(60.0 * t)}
    unit, signals = both(make, exchange, "planetary_gear", {}, inputs, 0.05, ["w_o", "tau_g", "tau", "W_in"])
    assert unit.happened >= 8
    agree(signals, 2e-3)  # linear over 0.1 ms, the input is 5e-6 rad off, and impacts are stiff


def test_dry_friction_holds_and_lets_go(make: Make, exchange: Callable[..., Exchanged]) -> None:
    start, inputs = {"friction.law": STICK, "friction.tau_C": 0.01}, {"tau_add": swinging(0.0, 0.02, 100.0)}
    unit, signals = both(make, exchange, "motor_bldc", start, inputs, 0.1, ["phi", "w", "W_abs"])
    assert unit.happened >= 6
    assert np.sum(signals["w"][1] == 0.0) > 10
    agree(signals, 1e-4)


def test_an_event_indicator_is_never_zero_where_an_integrator_begins(exchange: Callable[..., Exchanged]) -> None:
    """FMI 2.0.4, 3.1.1: at an event restart z != 0; a rotor that begins on the border of a sector may turn back"""
    motor = exchange("motor_bldc")
    motor.begin({**ON, "motor.level": 2}, {"set_value": lambda t: -5.0})
    assert np.all(motor.vector(motor.fmu.getEventIndicators, motor.events) != 0.0)


def test_the_drive_reads_its_encoder_every_millisecond(make: Make, exchange: Callable[..., Exchanged]) -> None:
    inputs = {"set_value": lambda t: 2.0}
    motor, unit = make("motor_bldc", {**ON, "set_value": 2.0}, tolerance=1e-8), exchange("motor_bldc")
    stepped = motor.run(0.05, 1e-3, ["w_reading"], inputs)
    unit.begin(ON, inputs)
    exchanged = unit.run([float(t) for t in stepped["time"]], ["w_reading"])
    assert exchanged["w_reading"] == pytest.approx(stepped["w_reading"])
    assert np.all(np.diff(exchanged["w_reading"])[5:] != 0.0)


def test_a_parameter_that_changes_at_a_time_is_a_time_event(repaired: Callable[..., Path]) -> None:
    brake = Exchanged(repaired("brake.tau_off = 0.2 from 0.33"))
    brake.begin({}, {})
    assert brake.next_event == 0.33
    before = brake["brake.tau_off"]
    values = brake.run([0.0, 0.32, 0.34], ["brake.tau_off"])["brake.tau_off"]
    brake.fmu.freeInstance()
    assert values.tolist() == [before, before, 0.2]


def test_fmpys_integrator_takes_a_gear_through_its_impacts(load: Load) -> None:
    """FMPy applies moving inputs to event indicators alone, so they stand still here."""
    gear, outputs = str(load("planetary_gear").path), ["phi_o", "w_o", "tau_g"]
    run = {"stop_time": 0.05, "output_interval": 1e-3, "start_values": {"tau_s": 0.5}, "output": outputs,
           "relative_tolerance": 1e-8, "record_events": False}  # fmt: skip
    stepped = simulate_fmu(gear, fmi_type="CoSimulation", **run)
    exchanged = simulate_fmu(gear, fmi_type="ModelExchange", **run)
    assert np.max(stepped["tau_g"]) > 2 * 0.5  # it hits the flank
    agree({n: (np.array(stepped[n]), np.array(exchanged[n])) for n in outputs}, 1e-4)


def status_of(fmu: Any, function: str, *arguments: Any) -> int:
    f = fmu.dll[function]
    f.restype = ctypes.c_int
    return int(f(ctypes.c_void_p(fmu.component), *arguments))


def test_calls_of_the_other_kind_are_errors(make: Make, exchange: Callable[..., Exchanged]) -> None:
    motor = exchange("motor_bldc")
    motor.begin(ON, {})
    step = ctypes.c_double(0.0), ctypes.c_double(1e-3), 0
    assert status_of(motor.fmu, "fmi2DoStep", *step) == fmi2Error
    assert status_of(make("motor_bldc").fmu, "fmi2EnterEventMode") == fmi2Error


def test_a_parameter_is_set_in_event_mode_alone(exchange: Callable[..., Exchanged]) -> None:
    """FMI 2.0.4, 3.2.1: tunable parameters change at events"""
    gear = exchange("planetary_gear")
    gear.begin({}, {})
    gear.fmu.enterEventMode()
    gear.set({"friction.d": 0.01})
    gear.update()
    gear.fmu.enterContinuousTimeMode()
    assert gear["friction.d"] == 0.01
    with pytest.raises(FMICallException):
        gear.set({"friction.d": 0.02})


def test_a_state_of_one_kind_of_instance_is_refused_by_the_other(
    make: Make, exchange: Callable[..., Exchanged]
) -> None:
    exchanged, stepped = exchange("planetary_gear"), make("planetary_gear")
    exchanged.begin({}, {})
    states = [unit.fmu.getFMUstate() for unit in (exchanged, stepped)]
    for unit, own, other in ((exchanged, *states), (stepped, *reversed(states))):
        unit.fmu.setFMUstate(own)
        with pytest.raises(FMICallException):
            unit.fmu.setFMUstate(other)
    for unit, state in zip((exchanged, stepped), states, strict=True):
        unit.fmu.freeFMUstate(state)
    assert "this state is of an instance for model exchange" in stepped.log[-1]


def test_the_number_of_states_has_to_be_right(exchange: Callable[..., Exchanged]) -> None:
    gear = exchange("planetary_gear")
    gear.begin({}, {})
    room, few = (ctypes.c_double * 99)(), ctypes.c_size_t(gear.n - 1)
    assert status_of(gear.fmu, "fmi2GetContinuousStates", room, few) == fmi2Error
