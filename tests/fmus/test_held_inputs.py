"""Inputs that a master holds over a step: angles go on at their speeds, shaft torques answer to their shafts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

Make = Callable[..., Any]

H = 1e-3
GEAR = {"mesh.b": 10.0}  # all gap: the output shaft turns freely, J_o dw_o/dt = -tau_s
J_O = 4e-4


def sensor_set_twice(make: Make) -> Any:
    sensor = make("torque_sensor")
    for _ in range(2):
        sensor.set({"phi_o": 0.02, "w_o": 3.0, "phi_p": 0.01, "w_p": 2.0})
        if sensor.time == 0.0:
            sensor.step(H)
    return sensor


def test_an_angle_goes_on_at_its_own_speed(make: Make) -> None:
    sensor = sensor_set_twice(make)
    sensor.step(H)
    assert sensor["phi_o"] == pytest.approx(0.02 + 3.0 * H, rel=1e-14)
    assert sensor["tau_s"] == pytest.approx(955.0 * (0.01 + 1.0 * H) + 0.2 * 1.0, rel=1e-12)


def test_a_derivative_that_the_master_gives_overrules_the_speed(make: Make) -> None:
    sensor = sensor_set_twice(make)
    sensor.slope("phi_o", 0.0)
    sensor.step(H)
    assert sensor["phi_o"] == 0.02


def test_what_is_set_once_stays_as_it_is(make: Make) -> None:
    sensor = make("torque_sensor")
    sensor.set({"phi_o": 0.02, "w_o": 3.0})
    gear = make("planetary_gear", GEAR, tolerance=1e-9)
    gear.set({"tau_s": 0.1})
    for _ in range(2):
        sensor.step(H)
        gear.step(H)
    assert sensor["phi_o"] == 0.02
    assert gear["w_o"] == pytest.approx(-0.1 / J_O * 2 * H, rel=1e-8)


def held(make: Make, start: Mapping[str, float], tau: float, steps: int = 1) -> Any:
    gear = make("planetary_gear", {**GEAR, **start}, tolerance=1e-9)
    for _ in range(steps):
        gear.set({"tau_s": tau})
        gear.step(H)
    return gear


def answered(phi: float, w: float, a: float, b: float, c: float) -> tuple[float, float]:
    """J e'' + 2 sqrt(C J) e' + C e = -(a + b t), C = 6 c: e = p + q t + (A + B t) exp(-omega t), omega = sqrt(C/J)"""
    C = 6 * c
    omega = np.sqrt(C / J_O)
    q = -b / C
    p = -(a + 2 * omega * J_O * q) / C
    A = -p
    B = -q + omega * A
    end = np.exp(-omega * H)
    return phi + w * H + p + q * H + (A + B * H) * end, w + q + (B - omega * (A + B * H)) * end


def test_a_held_torque_answers_as_a_critically_damped_spring(make: Make) -> None:
    c, tau = 955.0, 0.1
    phi_1, w_1 = -tau / J_O * H**2 / 2, -tau / J_O * H  # what is set for the first time is held as given
    phi_2, w_2 = answered(phi_1, w_1, tau, 0.0, c)  # of a second step no trend is known
    e = phi_2 - phi_1 - w_1 * H  # the neighbour does not know of it yet
    phi_3, w_3 = answered(phi_2, w_2, tau + c * e, c * e / H / (1 + 8 * c * H**2 / J_O), c)
    gear = held(make, {}, tau, steps=3)
    assert gear["phi_o"] == pytest.approx(phi_3, rel=1e-6)
    assert gear["w_o"] == pytest.approx(w_3, rel=1e-6)


def test_without_a_coupling_stiffness_torques_are_held_as_given(make: Make) -> None:
    gear = held(make, {"coupling.c": 0.0}, 0.1, steps=3)
    assert gear["w_o"] == pytest.approx(-0.1 / J_O * 3 * H, rel=1e-9)
    assert gear["tau_s"] == 0.1


def test_steps_that_are_long_for_the_stiffness_hold_torques_as_given(make: Make) -> None:
    h = 2e-3  # sqrt(c/J_o) h = 3.1, above 2
    gear = make("planetary_gear", GEAR, tolerance=1e-9)
    for _ in range(2):
        gear.set({"tau_s": 0.1})
        gear.step(h)
    assert gear["w_o"] == pytest.approx(-0.1 / J_O * 2 * h, rel=1e-9)


def test_given_derivatives_leave_nothing_to_answer(make: Make) -> None:
    gear = make("planetary_gear", GEAR, tolerance=1e-9)
    for _ in range(2):
        gear.set({"tau_s": 0.1})
        gear.slope("tau_s", 20.0)
        gear.step(H)
    assert gear["w_o"] == pytest.approx(-2 * (0.1 * H + 20.0 * H**2 / 2) / J_O, rel=1e-8)


def test_the_trend_of_a_held_torque_goes_on(make: Make) -> None:
    """by 1/(1 + 8 c h^2/J); the motor answers by nothing else"""
    motor = make("motor_bldc", {"motor.level": 1})
    for tau in (0.0, 0.0, 1e-3):
        motor.set({"tau": tau})
        motor.step(1e-4)
    x = 0.24 * 1e-4**2 / 5.38e-6
    assert motor["tau"] == pytest.approx(1e-3 + 1e-3 / (1 + 8 * x), rel=1e-12)


def test_a_state_keeps_what_a_held_torque_answers_to(make: Make) -> None:
    gear = held(make, {}, 0.1, steps=2)
    state = gear.fmu.getFMUstate()
    ends = []
    for _ in range(2):
        gear.fmu.setFMUstate(state)
        gear.time = 2 * H
        gear.set({"tau_s": 0.2})
        gear.step(H)
        ends.append((gear["phi_o"], gear["w_o"]))
    gear.fmu.freeFMUstate(state)
    assert ends[0] == ends[1]


# ---- the joint in the plainest of masters

CHAIN = ("motor_bldc", "planetary_gear", "torque_sensor", "mr_brake_belt")
WIRES = (
    ("motor_bldc", "phi", "planetary_gear", "phi"),
    ("motor_bldc", "w", "planetary_gear", "w"),
    ("planetary_gear", "tau", "motor_bldc", "tau"),
    ("planetary_gear", "phi_o", "torque_sensor", "phi_o"),
    ("planetary_gear", "w_o", "torque_sensor", "w_o"),
    ("torque_sensor", "tau_s", "planetary_gear", "tau_s"),
    ("torque_sensor", "tau_s", "mr_brake_belt", "tau_s"),
    ("mr_brake_belt", "phi_p", "torque_sensor", "phi_p"),
    ("mr_brake_belt", "w_p", "torque_sensor", "w_p"),
)


def plain_master(
    make: Make, h: float, end: float, inputs: Callable[[float], tuple[float, float, float]], sequential: bool
) -> np.ndarray:
    """i and w of the motor at every millisecond. Inputs held: v_command, i_brake and tau_hold at mid-step."""
    units = {name: make(name, {"J_coupled": 9.3e-7} if name == "motor_bldc" else None) for name in CHAIN}
    into = {name: [w for w in WIRES if w[2] == name] for name in CHAIN}

    def pass_on(name: str, values: Mapping[tuple[str, str], float]) -> None:
        units[name].set({sink: values[source, signal] for source, signal, _, sink in into[name]})

    rows = []
    for k in range(round(end / h)):
        volts, amperes, grip = inputs((k + 0.5) * h)
        units["motor_bldc"].set({"set_value": volts})
        units["mr_brake_belt"].set({"i_b": amperes, "tau_h": grip})
        if sequential:
            for name in CHAIN:
                pass_on(name, {(s, x): units[s][x] for s, x, _, _ in into[name]})
                units[name].step((k + 1) * h - units[name].time)
        else:
            now = {(s, x): units[s][x] for s, x, _, _ in WIRES}
            for name in CHAIN:
                pass_on(name, now)
            for unit in units.values():
                unit.step((k + 1) * h - unit.time)
        if (k + 1) % round(1e-3 / h) == 0:
            rows.append((units["motor_bldc"]["i"], units["motor_bldc"]["w"]))
    return np.array(rows)


def rms(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(np.square(x), axis=0)))


@pytest.mark.long
@pytest.mark.parametrize("sequential", [False, True], ids=["jacobi", "gauss_seidel"])
@pytest.mark.parametrize("h", [2.5e-4, 5e-4, 1e-3])
def test_a_plain_master_agrees_with_our_adaptive_solution(make: Make, h: float, sequential: bool) -> None:
    """through the gap both ways, gripped and released by the brake"""
    from cobot_joint.cosim import Experiment, Simulation
    from cobot_joint.system import Inputs, load_system

    time = np.array([0, 0.3, 1.0, 1.3, 1.6, 2.0, 2.5])
    volts = np.array([0.0, 8.0, 8.0, -8.0, -8.0, 4.0, 0.0])
    amperes = np.array([0.0, 0.0, 0.8, 0.8, 0.2, 0.6, 0.0])
    system = load_system("joint")
    with Simulation(system) as simulation:
        result = simulation.run(Experiment(Inputs(time, {"v_command": volts, "i_brake": amperes}), 2.5))
    ours = np.column_stack([result.signals["i_motor"], result.signals["w_motor"]])[1:]
    plain = plain_master(
        make, h, 2.5, lambda t: (float(np.interp(t, time, volts)), float(np.interp(t, time, amperes)), 0.0), sequential
    )
    i, w = rms(plain - ours)
    assert i <= 0.1 * h / 1e-3
    assert w <= 1.0 * h / 1e-3


@pytest.mark.long
@pytest.mark.parametrize(("h", "i_most", "w_most"), [(2e-4, 1e-3, 0.05), (1e-3, 5e-2, 5.0)])
def test_a_plain_jacobi_master_meets_the_reference(
    make: Make, shared: Path, h: float, i_most: float, w_most: float
) -> None:
    table = pq.read_table(shared / "reference" / "load_mr_brake.parquet").to_pydict()
    column = {name.split(" ")[0]: np.array(values) for name, values in table.items()}

    def inputs(t: float) -> tuple[float, float, float]:
        v, i, tau = (float(np.interp(t, column["time"], column[n])) for n in ("v_command", "i_brake", "tau_hold"))
        return v, i, tau

    plain = plain_master(make, h, 20.0, inputs, sequential=False)
    i, w = rms(plain - np.column_stack([column["i_motor"], column["w_motor"]])[1:])
    assert i <= i_most
    assert w <= w_most
