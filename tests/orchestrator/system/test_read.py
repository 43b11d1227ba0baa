"""Systems from files: FMUs, parameters, and what a file must not do."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from cobot_joint.errors import UserError
from cobot_joint.system import System, load_system
from cobot_joint.units import load_unit

Make = Callable[..., Path]
Pair = Callable[..., System]
Wire = Callable[..., str]


def binding(parameters: str, attributes: str = "", mapping: str = "", units: str = "") -> str:
    units = f"<ssv:Units>{units}</ssv:Units>" if units else ""
    return f"""<ssd:ParameterBindings><ssd:ParameterBinding {attributes}><ssd:ParameterValues>
<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>{parameters}</ssv:Parameters>{units}</ssv:ParameterSet>
</ssd:ParameterValues>{mapping}</ssd:ParameterBinding></ssd:ParameterBindings>"""


def real(name: str, value: float, unit: str = "") -> str:
    return f'<ssv:Parameter name="{name}"><ssv:Real value="{value}" {unit}/></ssv:Parameter>'


def test_components_keep_the_files_order(make_fmu: Make, make_system: Make) -> None:
    rows = [("y", "output", "Real", "")]
    for name in "cab":
        make_fmu(name, rows)
    system = load_system(make_system("".join(f'<ssd:Component name="{n}" source="{n}.fmu"/>' for n in "cab")))
    assert [c.name for c in system.components] == ["c", "a", "b"]


def test_parameters_inside_the_file_are_read(pair: Pair) -> None:
    mode = '<ssv:Parameter name="mode"><ssv:Enumeration value="on"/></ssv:Parameter>'
    system = pair("", motor=binding(real("R", 3) + mode))
    assert system.component("motor").parameters == {"R": 3, "mode": 2}


def test_parameter_with_a_unit_of_its_own_is_converted(pair: Pair) -> None:
    hertz = '<ssc:Unit name="turns"><ssc:BaseUnit rad="1" s="-1" factor="6.283185307179586"/></ssc:Unit>'
    system = pair("", motor=binding(real("R", 0.1, 'unit="turns"'), units=hertz))
    assert system.component("motor").parameters["R"] == pytest.approx(6)  # 0.1 turns per second in rpm


def test_parameters_from_a_file_beside_the_system_are_read(pair: Pair, tmp_path: Path) -> None:
    (tmp_path / "values.ssv").write_text(
        '<ssv:ParameterSet version="1.0" name="p" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">'
        f"<ssv:Parameters>{real('R', 4)}</ssv:Parameters></ssv:ParameterSet>"
    )
    bindings = '<ssd:ParameterBindings><ssd:ParameterBinding source="values.ssv"/></ssd:ParameterBindings>'
    assert pair("", motor=bindings).component("motor").parameters == {"R": 4}


def test_mapping_renames_and_transforms(pair: Pair, line: str) -> None:
    mapping = (
        '<ssd:ParameterMapping><ssm:ParameterMapping version="1.0">'
        f'<ssm:MappingEntry source="resistance" target="R">{line}</ssm:MappingEntry>'
        "</ssm:ParameterMapping></ssd:ParameterMapping>"
    )
    system = pair("", motor=binding(real("resistance", 1.5) + real("unused", 1), mapping=mapping))
    assert system.component("motor").parameters == {"R": 8}


def test_what_is_no_number_cannot_be_transformed(pair: Pair, line: str) -> None:
    mapping = (
        '<ssd:ParameterMapping><ssm:ParameterMapping version="1.0">'
        f'<ssm:MappingEntry source="on" target="R">{line}</ssm:MappingEntry>'
        "</ssm:ParameterMapping></ssd:ParameterMapping>"
    )
    given = '<ssv:Parameter name="on"><ssv:Enumeration value="open"/></ssv:Parameter>'
    with pytest.raises(UserError, match=r"on: 'open' is given, a number is needed to be transformed"):
        pair("", motor=binding(given, mapping=mapping))


def test_parameter_outside_its_bounds_is_refused_with_the_place(pair: Pair) -> None:
    with pytest.raises(UserError, match=r"system\.ssd: component 'motor': motor\.R: 99 rpm is given, 0 to 10 rpm"):
        pair("", motor=binding(real("R", 99)))


def test_missing_fmu_is_refused_with_where_it_was_looked_for(make_system: Make, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=rf"nowhere\.fmu: there is no such FMU, looked for in {tmp_path}"):
        load_system(make_system('<ssd:Component name="a" source="nowhere.fmu"/>'))


def test_unknown_system_is_refused_with_the_shipped_ones() -> None:
    with pytest.raises(UserError, match=r"system 'joynt': there is none, allowed are .*joint_compliant, joint_logged"):
        load_system("joynt")


def test_file_that_is_not_valid_is_refused_with_the_line(make_system: Make) -> None:
    with pytest.raises(UserError, match=r"system\.ssd: line \d+: .*source"):
        load_system(make_system('<ssd:Component name="a"/>'))


def test_declared_connector_that_the_fmu_contradicts_is_refused(pair: Pair) -> None:
    declared = '<ssd:Connectors><ssd:Connector name="w" kind="input"/></ssd:Connectors>'
    with pytest.raises(UserError, match=r"connector motor\.w: input is given, but the FMU says otherwise"):
        pair("", motor=declared)


@pytest.mark.parametrize("kind", ["SYSTEM", ""])
def test_document_type_is_refused_and_no_entity_is_read(make_system: Make, tmp_path: Path, kind: str) -> None:
    (tmp_path / "secret").write_text("secret.fmu")
    entity = f'{kind} "{(tmp_path / "secret").as_uri()}"' if kind else '"secret.fmu"'
    ssd = make_system('<ssd:Component name="a" source="&e;"/>', top=f"<!DOCTYPE x [<!ENTITY e {entity}>]>")
    with pytest.raises(UserError, match=r"DOCTYPE|Attribute references external entity") as refused:
        load_system(ssd)
    assert "secret.fmu" not in str(refused.value)


@pytest.mark.parametrize("source", ["http://example.org/a.fmu", "../a.fmu", "/tmp/a.fmu"])
def test_archive_reaches_nothing_outside_of_itself(make_system: Make, tmp_path: Path, source: str) -> None:
    ssd = make_system(f'<ssd:Component name="a" source="{source}"/>')
    with zipfile.ZipFile(tmp_path / "system.ssp", "w") as archive:
        archive.write(ssd, "SystemStructure.ssd")
    with pytest.raises(UserError, match="a path relative to the description is allowed"):
        load_system(tmp_path / "system.ssp")


def test_a_connector_that_is_listed_twice_is_refused(pair: Pair, wire: Wire) -> None:
    """The second one's kind and unit would go unseen."""
    twice = 2 * '<ssd:Connector name="w" kind="output"><ssc:Real unit="rad/s"/></ssd:Connector>'
    with pytest.raises(UserError, match=r"system\.ssd: connector w is listed twice, once is allowed"):
        pair(wire("motor.w", "w"), connectors=twice)
    with pytest.raises(UserError, match="component 'motor': connector w is listed twice, once is allowed"):
        pair("", motor=f"<ssd:Connectors>{twice}</ssd:Connectors>")


def test_a_connector_that_is_wired_twice_is_refused(pair: Pair, wire: Wire) -> None:
    with pytest.raises(UserError, match="two sources feed one sink, only one may"):
        pair(wire("motor.w", "meter.w") + wire("motor.w", "meter.w"))


def test_archive_without_a_system_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "empty.ssp", "w") as archive:
        archive.writestr("readme", "")
    with pytest.raises(UserError, match=r"empty\.ssp: not a system: it holds no SystemStructure\.ssd"):
        load_system(tmp_path / "empty.ssp")
    (tmp_path / "no.ssp").write_text("no archive")
    with pytest.raises(UserError, match=r"no\.ssp: not a \.ssp file"):
        load_system(tmp_path / "no.ssp")


def test_model_exchange_alone_is_refused(make_fmu: Make, make_system: Make) -> None:
    make_fmu("a", [("y", "output", "Real", "")], interface='<ModelExchange modelIdentifier="a"/>')
    with pytest.raises(UserError, match=r"a\.fmu: .*FMI 2\.0 co-simulation is needed"):
        load_system(make_system('<ssd:Component name="a" source="a.fmu"/>'))


SHIPPED = [f"joint{load}{seen}" for load in ("", "_no_load") for seen in ("", "_logged", "_recorded")]


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_system_loads_with_the_benchs_connectors(name: str) -> None:
    system = load_system(name)
    outputs = ["i_motor", "w_motor", "phi_motor", "tau_gear"]
    if "no_load" not in name:
        outputs += ["tau_sensor", "w_pulley", "phi_pulley", "w_brake", "tau_belt"]
    if name.endswith("recorded"):
        outputs += ["y_a", "y_b", "y_c", "v_set"]
    assert list(system.outputs) == outputs
    assert list(system.inputs) == (["v_command"] if "no_load" in name else ["v_command", "i_brake", "tau_hold"])
    assert ("acquisition" in [c.name for c in system.components]) == name.endswith(("logged", "recorded"))
    assert all(c.factor == 1 and c.offset == 0 for c in system.connections)


@pytest.mark.parametrize("identifier", ["../../evil", "/tmp/evil", "a b", ""])
def test_a_model_identifier_that_leaves_its_folder_is_refused(make_fmu: Make, identifier: str) -> None:
    interface = f'<CoSimulation modelIdentifier="{identifier}"/>'
    path = make_fmu("a", [("y", "output", "Real", "")], interface=interface)
    with pytest.raises(UserError, match=r"modelIdentifier .* is given, a name as in C is allowed|modelDescription"):
        load_unit(path)


def test_a_source_with_a_zero_byte_is_refused(make_system: Make) -> None:
    with pytest.raises(UserError, match=r"source 'a%00b\.fmu' is given, a name without control characters is allowed"):
        load_system(make_system('<ssd:Component name="a" source="a%00b.fmu"/>'))
