"""A machine of one's own, from its parts and data sheets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.diagnosis.drafts.chain import Chain, chain, kept_in_words, with_data_sheet, write_readable
from cobot_joint.errors import UserError
from cobot_joint.system import load_system
from cobot_joint.system.model import Inputs
from cobot_joint.system.wiring import unconnected


def made(folder: Path, names: str, **sheet: str) -> Chain:
    whole = with_data_sheet(chain(names.split(",")), {k.replace("__", "."): v for k, v in sheet.items()})
    write_readable(whole.system, [(n, p.words) for n, p in whole.parts.items()], folder / "system.ssd")
    return whole


@pytest.mark.parametrize(
    ("names", "inputs", "outputs"),
    [
        ("motor", ["v_command"], ["i_motor", "w_motor"]),
        ("motor,gear,sensor,load", ["v_command"], ["i_motor", "w_motor", "tau_sensor", "w_load"]),
        ("motor,harmonic,sensor,load", ["v_command"], ["i_motor", "w_motor", "tau_sensor", "w_load"]),
        ("motor,cycloidal,elastic,link", ["v_command"], ["i_motor", "w_motor", "tau_sensor", "phi_link", "w_link"]),
        ("motor,gear,sensor,brake", ["v_command", "i_brake"], ["i_motor", "w_motor", "tau_sensor"]),
        ("loop,motor,load", ["phi_command"], ["v_command", "i_motor", "w_motor", "w_load"]),
        ("loop,motor,screw", ["s_command"], ["v_command", "i_motor", "w_motor", "s"]),
        ("motor,screw", ["v_command"], ["i_motor", "w_motor", "s"]),
        ("motion,sensor,load", ["w"], ["tau_sensor", "w_load"]),
        ("motion,gear,load", ["w"], ["w_load", "tau_drive"]),
        ("friction", ["w"], ["tau"]),
        ("load", ["tau"], ["w_load"]),
        ("pendulum", ["tau"], ["phi_load"]),
        ("link", ["tau"], ["phi_link", "w_link"]),
    ],
)
def test_a_chain_is_a_system_that_runs(tmp_path: Path, names: str, inputs: list[str], outputs: list[str]) -> None:
    made(tmp_path, names)
    system = load_system(tmp_path / "system.ssd")
    assert (list(system.inputs), list(system.outputs)) == (inputs, outputs)
    assert not unconnected(system)
    t = np.linspace(0, 0.2, 201)
    with Simulation(system) as simulation:
        signals = simulation.run(Experiment(Inputs(t, {inputs[0]: np.sin(6 * t)}), 0.2, record=outputs)).signals
    assert all(np.isfinite(x).all() for x in signals.values())
    assert any(map(np.any, signals.values())) or names == "friction"  # whose data sheet is empty


def test_what_of_a_data_sheet_was_not_given_is_said_with_the_bench_s_value_and_a_ratio_may_be_against_one() -> None:
    """A conveyor's gear had the bench's stiffness without a word, three times its own."""
    given = {"gear.ratio": "25:1", "gear.c": "900 N.m/rad", "motor.R": "0.9 Ohm"}
    made = with_data_sheet(chain(["motor", "gear", "load"]), given)
    assert made.system.component("gear").parameters["ratio.N"] == 25.0
    motor, gear = kept_in_words(made, given)[:2]
    assert motor.startswith("motor: not given, the bench's values are kept: winding.L = 8.43e-05 H, ")
    assert "mesh.b = 0.0174533 rad" in gear
    assert "mesh.eta = 0.75, " in gear
    assert not any(name in motor + gear for name in ("mesh.c =", "ratio.N", "winding.R"))


def test_values_come_from_a_data_sheet_by_its_names_and_in_its_units(tmp_path: Path) -> None:
    made(
        tmp_path,
        "motor,gear,load",
        motor__terminal_resistance="610 mOhm",
        motor__k_M="38.5 mNm/A",
        motor__J="121 gcm2",
        gear__N="100",
        load__body__J="12 kg.cm2",
    )
    system = load_system(tmp_path / "system.ssd")
    motor, gear, load = (system.component(name).parameters for name in ("motor", "gear", "load"))
    assert motor["winding.R"] == pytest.approx(0.61)
    assert motor["winding.k"] == pytest.approx(0.0385)
    assert motor["rotor.J"] == pytest.approx(1.21e-5)
    assert gear["ratio.N"] == 100
    assert load["body.J"] == pytest.approx(1.2e-3)


def test_a_steady_motor_obeys_its_data_sheet(tmp_path: Path) -> None:
    """v = R i + k w at rest of the current: i from the friction, w from the rest of the voltage."""
    sheet = {"motor__R": "0.61 Ohm", "motor__k": "38.5 mNm/A", "motor__d": "0 N.m.s/rad", "motor__tau_C": "2.1 mNm"}
    made(tmp_path, "motor", **sheet, motor__J="1.21e-5 kg.m2")
    t = np.linspace(0, 2, 2001)
    with Simulation(load_system(tmp_path / "system.ssd")) as simulation:
        record = ["i_motor", "w_motor"]
        inputs = Inputs(t, {"v_command": np.full(2001, 6.0)})
        run = simulation.run(Experiment(inputs, 2.0, record=record)).signals
    i = 2.1e-3 / 0.0385
    assert run["i_motor"][-1] == pytest.approx(i, rel=1e-3)
    assert run["w_motor"][-1] == pytest.approx((6 - 0.61 * i) / 0.0385, rel=1e-3)


@pytest.mark.parametrize(("names", "lead"), [("loop,motor,screw", 5e-3), ("loop,motor,gear,screw", 5e-3 / 4)])
def test_a_loop_of_an_axis_takes_its_carriage_where_it_is_asked_to(tmp_path: Path, names: str, lead: float) -> None:
    """Its goal was an angle of the motor, and a servo drive logs millimetres."""
    sheet = {"screw__pitch": "5 mm/rev", "loop__k_p": "40 1/s", "loop__k_v": "0.1", "loop__k_iv": "1"}
    made(tmp_path, names, **sheet, **({"gear__N": "4", "gear__eta": "1"} if "gear" in names else {}))
    system = load_system(tmp_path / "system.ssd")
    assert system.component("loop").parameters["gains.lead"] == pytest.approx(lead / (2 * np.pi))
    t = np.linspace(0, 2, 2001)
    with Simulation(system) as simulation:
        goal = Inputs(t, {"s_command": np.minimum(t, 1.0) * 2e-3})
        s = simulation.run(Experiment(goal, 2.0, record=["s"])).signals["s"]
    assert s[-1] == pytest.approx(2e-3, rel=0.02)


def test_a_servo_loop_with_an_integrator_holds_its_goal_against_friction(tmp_path: Path) -> None:
    gains = {"loop__k_p": "20 1/s", "loop__k_v": "0.1 V.s/rad", "loop__k_iv": "2 V/rad", "loop__u_max": "24 V"}
    made(tmp_path, "loop,motor", **gains, motor__tau_C="5 mN.m")
    t = np.linspace(0, 3, 3001)
    with Simulation(load_system(tmp_path / "system.ssd")) as simulation:
        inputs = Inputs(t, {"phi_command": np.full(3001, 2.0)})
        run = simulation.run(Experiment(inputs, 3.0, record=["motor.phi", "v_command"])).signals
    assert run["motor.phi"][-1] == pytest.approx(2.0, abs=2e-3)
    assert run["v_command"][0] == pytest.approx(0.1 * 20 * 2.0)


def test_a_pendulum_swings_as_its_mass_and_arm_say(tmp_path: Path) -> None:
    """w_0^2 = m g r/(J + m r^2), let go at a small angle: at half a period it has reached the other side."""
    sheet = {"pendulum__m": "0.6 kg", "pendulum__r": "0.2 m", "pendulum__J": "0.0103 kg.m2"}
    made(tmp_path, "pendulum", **sheet)
    system = load_system(tmp_path / "system.ssd")
    half = np.pi * np.sqrt((0.0103 + 0.6 * 0.2**2) / (0.6 * 9.80665 * 0.2))
    t = np.linspace(0, half, 101)
    with Simulation(system) as simulation:
        experiment = Experiment(Inputs(t, {"tau": 0 * t}), half, parameters={"pendulum.phi": 0.01}, record=["phi_load"])
        run = simulation.run(experiment).signals
    assert run["phi_load"][-1] == pytest.approx(-0.01, rel=1e-3)


def test_the_file_says_what_every_value_is_and_in_which_unit(tmp_path: Path) -> None:
    made(tmp_path, "motor")
    text = (tmp_path / "system.ssd").read_text()
    assert "<!-- brushless or DC motor with its drive -->" in text
    assert "[Ohm] -->" in text
    assert "[N.m/A] -->" in text


@pytest.mark.parametrize(
    ("names", "sheet", "told"),
    [
        ("motor,frob", {}, "--chain 'frob': there is no such part, allowed are loop, motor, motion"),
        ("loop,gear", {}, "a loop commands a motor, put one behind it"),
        ("gear,motor", {}, "motor is driven by nothing, it stands first"),
        ("load,gear", {}, "load has nothing behind it that could drive a gear"),
        ("motor,motor", {}, "each part may stand there once"),
        ("motor", {"gear.N": "100"}, "--set gear.N: there is no such part, the chain has motor"),
        ("motor", {"motor.k_M": "3 V"}, "unit 'V' is given, one that converts to 'N.m/A' is needed"),
        ("motor", {"motor.weight": "3"}, "there is no such parameter; its data sheet has drive.i_peak"),
        ("load", {"load.gravity": "9.81"}, "any other of the unit is allowed too, as gravity.g"),
        ("motor", {"motor.R": "much"}, "--set: motor.winding.R"),
    ],
)
def test_a_wrong_chain_is_refused_in_one_line(names: str, sheet: dict[str, str], told: str) -> None:
    with pytest.raises(UserError) as error:
        with_data_sheet(chain(names.split(",")), sheet)
    assert told in str(error.value)
    assert "\n" not in str(error.value)
