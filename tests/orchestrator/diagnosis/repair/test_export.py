"""A repaired unit carries its values into any importer; a repaired system behaves as the diagnosis simulated it."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.correction import formula_parameters
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.diagnosis.repair.export import Correction, export_unit, repaired_system, write_repair
from cobot_joint.errors import UserError
from cobot_joint.system.model import System
from cobot_joint.system.read import load_system
from cobot_joint.units import find_fmu, load_unit

VALUES = {"winding.R": 0.3, "friction.tau_C": 2e-3, "cogging.A": 1.5e-3, "drive.mode": 1}
T = np.arange(1001) * 1e-3


def motor(path: Path, start_values: dict | None = None) -> np.ndarray:
    """Speed of a motor alone at 3 V, in FMPy."""
    out = fmpy.simulate_fmu(
        str(path),
        input=np.rec.fromarrays([T[:1], np.array([3.0])], names=["time", "set_value"]),
        start_values=start_values or {},
        output=["w", "i"],
        stop_time=1.0,
        output_interval=1e-3,
    )
    return np.asarray(out["w"])


def test_a_repaired_fmu_has_its_values_in_fmpy_without_start_values(tmp_path: Path) -> None:
    original = find_fmu("motor_bldc.fmu")
    repaired = export_unit(load_unit(original), VALUES, tmp_path / "motor_bldc.fmu")
    assert np.array_equal(motor(repaired), motor(original, VALUES))
    assert np.max(np.abs(motor(repaired) - motor(original))) > 1.0


def test_a_repaired_fmu_says_its_values_and_has_a_guid_of_its_own(tmp_path: Path) -> None:
    original = load_unit(find_fmu("motor_bldc.fmu"))
    repaired = load_unit(export_unit(original, VALUES, tmp_path / "motor_bldc.fmu"))
    assert repaired.description.guid != original.description.guid
    assert {name: float(repaired.variables[name].start) for name in VALUES} == VALUES
    assert validate_fmu(str(repaired.path)) == []
    again = load_unit(export_unit(original, VALUES | {"winding.R": 0.31}, tmp_path / "other.fmu"))
    assert again.description.guid not in (original.description.guid, repaired.description.guid)


def test_the_same_values_make_the_same_bytes(tmp_path: Path) -> None:
    unit = load_unit(find_fmu("motor_bldc.fmu"))
    first, second = (export_unit(unit, VALUES, tmp_path / name).read_bytes() for name in ("a.fmu", "b.fmu"))
    assert first == second


def test_values_and_guid_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    path = export_unit(load_unit(find_fmu("motor_bldc.fmu")), VALUES, tmp_path / "motor_bldc.fmu")
    mixed = tmp_path / "mixed.fmu"
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(mixed, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            target.writestr(
                name, content.replace(b"guid = {", b"guid = {0") if name.endswith("values.txt") else content
            )
    with pytest.raises(Exception, match="Failed to instantiate"):
        motor(mixed)


def test_an_effect_that_sets_in_later_does_so_in_the_fmu(tmp_path: Path) -> None:
    original = find_fmu("motor_bldc.fmu")
    repaired = export_unit(load_unit(original), {"winding.R": 0.3}, tmp_path / "late.fmu", onsets={"winding.R": 0.5})
    w, nominal = motor(repaired), motor(original)
    assert np.array_equal(w[:501], nominal[:501])
    assert np.max(np.abs(w[501:] - nominal[501:])) > 0.3


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"winding.R": -1.0}, "-1 Ohm is given"),
        ({"winding.X": 1.0}, "no variable of motor_bldc.fmu"),
        ({"w_reading": 1.0}, "not a parameter"),
    ],
)
def test_a_value_that_the_unit_does_not_take_is_refused(tmp_path: Path, values: dict, told: str) -> None:
    with pytest.raises(UserError, match=told):
        export_unit(load_unit(find_fmu("motor_bldc.fmu")), values, tmp_path / "motor_bldc.fmu")
    assert not (tmp_path / "motor_bldc.fmu").exists()


def test_a_foreign_fmu_cannot_carry_values(tmp_path: Path, axis: Path) -> None:
    with pytest.raises(UserError, match=r"axis\.fmu: cannot carry start values"):
        export_unit(load_unit(axis.parent / "axis.fmu"), {"friction.d": 2.0}, tmp_path / "out.fmu")


def test_a_foreign_fmu_keeps_its_values_in_the_system(tmp_path: Path, axis: Path) -> None:
    repaired = repaired_system(load_system(axis), {"axis.friction.d": 2.0}, tmp_path / "fmus")
    assert repaired.component("axis").parameters == {"friction.d": 2.0}
    written = write_repair({"default": load_system(axis)}, {"axis.friction.d": 2.0}, tmp_path / "out")
    assert load_system(written["default"]).component("axis").parameters == {"friction.d": 2.0}


SYSTEM_VALUES = {
    "motor_bldc.winding.R": 0.22,
    "planetary_gear.mesh.eta": 0.72,
    "mr_brake_belt.brake.tau_off": 0.1,
    "motor_bldc.cogging.A": 1e-3,
}


def run() -> Recording:
    """Inputs of a short run; what is recorded is compared elsewhere."""
    t = np.arange(1501) * 1e-3
    inputs = {"v_command": np.interp(t, [0.1, 0.3, 1.0, 1.2], [0, 6, 6, -4]), "i_brake": np.full(len(t), 0.2)}
    outputs = {name: np.zeros(len(t)) for name in ("i_motor", "w_motor", "tau_sensor")}
    return Recording(
        "run", "train", "loaded", t, inputs, outputs, {"i_motor": "A", "w_motor": "rad/s", "tau_sensor": "N.m"}
    )


def simulated(system: System, values: dict | None = None, onsets: dict | None = None) -> dict[str, np.ndarray]:
    with Simulator({"loaded": system}, values, onsets) as simulator:
        return dict(simulator(run()))


def test_the_repaired_ssp_is_the_system_with_the_values(tmp_path: Path) -> None:
    systems = {"loaded": load_system("joint_logged"), "no_load": load_system("joint_no_load_logged")}
    onsets = {"motor_bldc.cogging.A": 0.6}
    written = write_repair(systems, SYSTEM_VALUES, tmp_path, onsets=onsets)
    assert written == {"loaded": tmp_path / "repaired.ssp", "no_load": tmp_path / "repaired_no_load.ssp"}
    assert {p.name for p in (tmp_path / "fmus").iterdir()} == {f"{c.name}.fmu" for c in systems["loaded"].components}
    repaired, expected = simulated(load_system(written["loaded"])), simulated(systems["loaded"], SYSTEM_VALUES, onsets)
    nominal = simulated(systems["loaded"])
    for name in expected:
        effect = np.max(np.abs(repaired[name] - nominal[name]))
        # the onset falls on a communication point of either master's choice
        assert np.max(np.abs(repaired[name] - expected[name])) < 2e-3 * effect


def test_a_correction_on_an_additive_port_acts_as_the_term_would(tmp_path: Path) -> None:
    """Viscous friction of the brake shaft, once as its parameter and once as a formula at the port."""
    system = load_system("joint_logged")
    parameters, signals = formula_parameters([(-2e-3, "mr_brake_belt.w_b")])
    correction = Correction("brake_correction", "mr_brake_belt.tau_b_add", tuple(signals), parameters)
    written = write_repair({"loaded": system}, {}, tmp_path, corrections=(correction,))
    assert (tmp_path / "fmus/brake_correction.fmu").is_file()
    corrected = simulated(load_system(written["loaded"]))
    d_off = float(system.component("mr_brake_belt").unit.variables["brake.d_off"].start)
    by_term, nominal = simulated(system, {"mr_brake_belt.brake.d_off": d_off + 2e-3}), simulated(system)
    for name in by_term:
        effect = np.max(np.abs(by_term[name] - nominal[name]))
        assert np.max(np.abs(corrected[name] - by_term[name])) < 0.02 * effect


def test_a_correction_may_depend_on_what_its_component_is_fed_with(tmp_path: Path) -> None:
    """The gearhead's w is the motor's; without a sensor its tau_s is nobody's and stays zero."""
    parameters, signals = formula_parameters([(-1e-5, "planetary_gear.w"), (1.0, "planetary_gear.tau_s")])
    correction = Correction("gear_correction", "planetary_gear.tau_add", tuple(signals), parameters)
    for name in ("joint_logged", "joint_no_load_logged"):
        repaired = repaired_system(load_system(name), {}, tmp_path / name, corrections=(correction,))
        wires = {
            (w.source_component, w.source, w.sink)
            for w in repaired.connections
            if w.sink_component == "gear_correction"
        }
        fed = {("torque_sensor", "tau_s", "u2")} if name == "joint_logged" else set()
        assert wires == {("motor_bldc", "w", "u1")} | fed


def test_a_correction_of_a_wired_port_passes_what_was_wired(tmp_path: Path) -> None:
    """Of a foreign unit there is no additive port: the correction sits in the wire."""
    system = load_system("joint_logged")
    parameters, signals = formula_parameters([(0.05, "motor_bldc.w")])
    correction = Correction("sensor_wire", "acquisition.w_motor", tuple(signals), parameters)
    corrected, plain = simulated(repaired_system(system, {}, tmp_path, corrections=(correction,))), simulated(system)
    assert np.allclose(corrected["i_motor"], plain["i_motor"], atol=4e-4)
    late = np.abs(plain["w_motor"]) > 50
    assert np.allclose(corrected["w_motor"][late] / plain["w_motor"][late], 1.05, atol=2e-3)


def two_motors(folder: Path, left: str = "left", right: str = "right", R: float | None = None) -> System:
    """Two motors of one unit on one voltage."""
    system = load_system("joint")
    motor = system.component("motor_bldc")
    components = (replace(motor, name=left), replace(motor, name=right, parameters={"winding.R": R} if R else {}))
    (supply,) = (w for w in system.connections if w.source_component is None and w.sink_component == "motor_bldc")
    (reading,) = (w for w in system.connections if w.sink == "w_motor")
    wires = [replace(supply, sink_component=c.name) for c in components]
    wires += [replace(reading, source_component=c.name, source="w", sink=f"w_{k}") for k, c in enumerate(components)]
    outputs = {f"w_{k}": replace(system.outputs["w_motor"], name=f"w_{k}") for k in range(2)}
    inputs = {name: c for name, c in system.inputs.items() if name == "v_command"}
    return replace(system, components=components, connections=tuple(wires), inputs=inputs, outputs=outputs)


@pytest.mark.parametrize("names", [("left", "right"), ("Motor", "motor"), ("../a b", "..")])
def test_two_of_a_unit_are_repaired_each_with_its_own_values(tmp_path: Path, names: tuple[str, str]) -> None:
    system = two_motors(tmp_path, *names)
    values = {f"{names[0]}.winding.R": 0.3, f"{names[1]}.winding.R": 0.1}
    written = write_repair({"default": system}, values, tmp_path / "out")
    repaired = load_system(written["default"])
    assert [float(c.unit.variables["winding.R"].start) for c in repaired.components] == [0.3, 0.1]
    files = [path for path in tmp_path.rglob("*.fmu") if path.parent == tmp_path / "out" / "fmus"]
    assert len(files) == len(list(tmp_path.rglob("*.fmu"))) == 2
    recording = replace(run(), setup="default", outputs={"w_0": np.zeros(len(run().time)), "w_1": np.zeros(1501)})
    recording.inputs.pop("i_brake")
    with Simulator({"default": repaired}) as ours, Simulator({"default": system}, values) as theirs:
        given, expected = ours(recording), theirs(recording)
    for name in ("w_0", "w_1"):
        assert np.allclose(given[name], expected[name], rtol=1e-12, atol=1e-12)
    assert np.max(np.abs(given["w_0"] - given["w_1"])) > 1.0


def test_set_ups_that_differ_in_a_parameter_leave_both_units(tmp_path: Path) -> None:
    systems = {"cold": two_motors(tmp_path, R=0.2), "hot": two_motors(tmp_path, R=0.25)}
    written = write_repair(systems, {"left.winding.R": 0.21}, tmp_path)
    for setup, R in (("cold", 0.2), ("hot", 0.25)):
        unit = load_system(written[setup]).component("right").unit
        assert float(unit.variables["winding.R"].start) == R
    assert {p.name for p in (tmp_path / "fmus").iterdir()} == {"left.fmu", "right.fmu", "right_hot.fmu"}


def test_a_second_repair_s_correction_stands_beside_the_first_one_s(tmp_path: Path) -> None:
    parameters, signals = formula_parameters([(-1e-4, "mr_brake_belt.w_b")])
    correction = Correction("brake_correction", "mr_brake_belt.tau_b_add", tuple(signals), parameters)
    system = load_system("joint_logged")
    for number in (1, 2):
        written = write_repair({"loaded": system}, {}, tmp_path / str(number), corrections=(correction,))
        system = load_system(written["loaded"])
    assert {"brake_correction", "brake_correction_2"} <= {c.name for c in system.components}
    d_off = float(system.component("mr_brake_belt").unit.variables["brake.d_off"].start)
    plain = load_system("joint_logged")
    corrected, expected = simulated(system), simulated(plain, {"mr_brake_belt.brake.d_off": d_off + 2e-4})
    effect = np.max(np.abs(expected["w_motor"] - simulated(plain)["w_motor"]))
    assert np.max(np.abs(corrected["w_motor"] - expected["w_motor"])) < 0.05 * effect
