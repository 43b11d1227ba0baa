"""Systems to files, read back by us and by FMPy."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssd, read_ssv

from cobot_joint.cosim import Experiment, simulate
from cobot_joint.errors import UserError
from cobot_joint.system import Inputs, System, load_system, with_parameters, write_ssd, write_ssp, write_ssv
from cobot_joint.system.write import file_names
from cobot_joint.units import load_unit

Pair = Callable[..., System]
Wire = Callable[..., str]


@pytest.fixture
def system(pair: Pair, wire: Wire, line: str) -> System:
    """Wires with and without conversion, a connector of its own, parameters of every type."""
    wires = wire("motor.w", "meter.w") + wire("motor.T", "meter.T", line) + wire("meter.y", "speed")
    connectors = '<ssd:Connector name="speed" kind="output"><ssc:Real unit="rad/s"/></ssd:Connector>'
    units = '<ssc:Unit name="rad/s"><ssc:BaseUnit rad="1" s="-1"/></ssc:Unit>'
    made = pair(wires, connectors=connectors, units=units)
    return with_parameters(made, {"motor.R": 0.1, "motor.mode": "on", "motor.count": 4, "motor.enabled": "false"})


def same(a: System, b: System) -> None:
    assert a.connections == b.connections
    assert a.outputs == b.outputs
    assert [(c.name, c.parameters) for c in a.components] == [(c.name, c.parameters) for c in b.components]


def test_system_survives_writing_and_reading(system: System, tmp_path: Path) -> None:
    same(load_system(write_ssd(system, tmp_path / "again.ssd")), system)


def test_wire_that_ignores_units_survives(pair: Pair, wire: Wire, tmp_path: Path) -> None:
    system = pair(wire("motor.w", "meter.tau", suppressUnitConversion="true"))
    same(load_system(write_ssd(system, tmp_path / "again.ssd")), system)


def test_archive_holds_the_fmus_and_opens_elsewhere(system: System, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    path = write_ssp(system, tmp_path / "elsewhere" / "all.ssp")
    for name in ("motor.fmu", "meter.fmu"):
        (tmp_path / name).unlink()
    same(load_system(path), system)
    with zipfile.ZipFile(path) as archive:
        assert set(archive.namelist()) == {"SystemStructure.ssd", "resources/motor.fmu", "resources/meter.fmu"}


def test_same_system_gives_the_same_bytes(system: System, tmp_path: Path) -> None:
    first, second = (write_ssp(system, tmp_path / name).read_bytes() for name in ("a.ssp", "b.ssp"))
    assert first == second


def test_fmpy_reads_the_archive_as_we_meant_it(tmp_path: Path) -> None:
    system = with_parameters(load_system("joint"), {"motor_bldc.winding.R": 0.22})
    ssd = read_ssd(str(write_ssp(system, tmp_path / "joint.ssp")), validate=True)
    assert [c.name for c in ssd.system.elements] == [c.name for c in system.components]
    assert {c.source for c in ssd.system.elements} == {f"resources/{c.name}.fmu" for c in system.components}
    read = {(c.startElement, c.startConnector, c.endElement, c.endConnector) for c in ssd.system.connections}
    assert read == {(c.source_component, c.source, c.sink_component, c.sink) for c in system.connections}
    values = ssd.system.elements[0].parameterBindings[0].parameterValues[0].parameters
    assert [(p.name, p.value, p.unit) for p in values] == [("winding.R", "0.22", "Ohm")]


def test_inputs_that_nothing_drives_are_not_listed(tmp_path: Path) -> None:
    # FMPy sets every listed input to 0 before each step: enable, too
    ssd = read_ssd(str(write_ssp(load_system("joint"), tmp_path / "joint.ssp")))
    inputs = {c.name for c in ssd.system.elements[0].connectors if c.kind == "input"}
    assert inputs == {"set_value", "tau", "J_coupled"}


def test_fmpy_runs_the_archive_to_the_same_end(tmp_path: Path) -> None:
    def v(t: float) -> float:
        return min(6.0, 20 * t)

    path, system, end = write_ssp(load_system("joint"), tmp_path / "joint.ssp"), load_system("joint"), 0.3
    inputs = {"v_command": v, "i_brake": lambda t: 0.0, "tau_hold": lambda t: 0.0}
    theirs = simulate_ssp(str(path), stop_time=end, step_size=1e-4, input=inputs)
    time = np.linspace(0, end, 301)
    ours = simulate(system, Experiment(Inputs(time, {"v_command": np.array([v(t) for t in time])}), end)).signals
    # its loop holds all inputs over a step and passes nothing on at the start: first order, 0.6 % at 0.1 ms
    assert theirs["w_motor"][-1] == pytest.approx(ours["w_motor"][-1], rel=0.01)
    assert theirs["tau_sensor"][-1] == pytest.approx(ours["tau_sensor"][-1], rel=0.01)


def test_fmpy_reads_the_parameter_set(system: System, tmp_path: Path) -> None:
    path = write_ssv(system.component("motor"), tmp_path / "motor.ssv")
    values = {p.name: (p.type, p.value) for p in read_ssv(str(path)).parameters}
    assert values == {
        "R": ("Real", "0.1"),
        "mode": ("Enumeration", "on"),
        "count": ("Integer", "4"),
        "enabled": ("Boolean", "false"),
    }


def test_two_different_fmus_of_one_name_are_both_in_the_archive(system: System, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "motor.fmu").write_bytes((tmp_path / "meter.fmu").read_bytes())
    motor, meter = system.components
    alike = replace(system, components=(motor, replace(meter, unit=load_unit(tmp_path / "other" / "motor.fmu"))))
    written = load_system(write_ssp(alike, tmp_path / "x.ssp"))
    same(written, system)
    assert [c.unit.name for c in written.components] == ["motor", "meter"]


def test_an_archive_without_one_of_its_fmus_is_refused(tmp_path: Path) -> None:
    """The shipped unit of that name is another one: it may not have the exported values."""
    whole = write_ssp(load_system("joint"), tmp_path / "joint.ssp")
    with zipfile.ZipFile(whole) as source, zipfile.ZipFile(tmp_path / "less.ssp", "w") as target:
        for name in source.namelist():
            if "motor_bldc" not in name:
                target.writestr(name, source.read(name))
    with pytest.raises(UserError, match=r"'resources/motor_bldc\.fmu' is given, the archive holds no such FMU"):
        load_system(tmp_path / "less.ssp")


def test_file_names_are_one_for_each_content_on_every_file_system() -> None:
    wanted = [
        (1, "motor", "a"),
        (2, "motor", "b"),
        (1, "motor", "c"),
        (3, "Motor", "b"),
        (4, "../x/y", "d"),
        (5, "..", ""),
    ]
    assert file_names(wanted) == [
        "motor.fmu", "motor_b.fmu", "motor.fmu", "Motor_b_2.fmu", "_x_y.fmu", "_.fmu"
    ]  # fmt: skip


def test_system_that_does_not_check_is_not_written(system: System, tmp_path: Path) -> None:
    doubled = replace(system, connections=(*system.connections, system.connections[0]))
    with pytest.raises(UserError, match="two sources feed one sink"):
        write_ssd(doubled, tmp_path / "x.ssd")
    assert not (tmp_path / "x.ssd").exists()
