"""What other simulators read beside the SSP's wires: libcosim's system structure, annotations, geometry."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import pytest
from lxml import etree

from cobot_joint.system import DefaultExperiment, System, load_system, with_parameters, without_own_wires, write_ssd
from cobot_joint.system.osp import NAMESPACE, write_osp
from cobot_joint.system.read import NS

OSP = {"o": NAMESPACE}


def written(system: System, folder: Path) -> etree._Element:
    return etree.parse(write_osp(system, folder / "OspSystemStructure.xml")).getroot()


def test_every_wire_between_components_is_a_connection(tmp_path: Path) -> None:
    system = load_system("joint")
    root = written(system, tmp_path)
    inner = [c for c in system.connections if c.source_component and c.sink_component]
    found = [
        tuple((v.get("simulator"), v.get("name")) for v in wire)
        for wire in root.iterfind("o:Connections/o:VariableConnection", OSP)
    ]
    assert found == [((c.source_component, c.source), (c.sink_component, c.sink)) for c in inner]
    assert [s.get("source") for s in root.iterfind("o:Simulators/o:Simulator", OSP)] == [
        c.source for c in system.components
    ]


def test_parameters_are_initial_values_of_their_type(tmp_path: Path) -> None:
    system = with_parameters(load_system("joint"), {"motor_bldc.winding.R": 0.25, "motor_bldc.motor.level": "simscape"})
    values = written(system, tmp_path).iterfind("o:Simulators/o:Simulator/o:InitialValues/o:InitialValue", OSP)
    assert {v.get("variable"): (etree.QName(v[0]).localname, v[0].get("value")) for v in values} == {
        "winding.R": ("Real", "0.25"),
        "motor.level": ("Integer", "2"),
    }


def test_a_wire_that_scales_goes_through_a_function(tmp_path: Path) -> None:
    system = load_system("joint")
    first = next(c for c in system.connections if c.source_component and c.sink_component)
    scaled = tuple(replace(c, factor=2.0, offset=1.0) if c is first else c for c in system.connections)
    root = written(replace(system, connections=scaled), tmp_path)
    (function,) = root.iterfind("o:Functions/o:LinearTransformation", OSP)
    assert (function.get("factor"), function.get("offset")) == ("2.0", "1.0")
    ends = [
        (end.get("simulator") or end.get("function"), end.get("name"))
        for wire in root.iterfind("o:Connections/o:SignalConnection", OSP)
        for end in wire
    ]
    name = function.get("name")
    assert ends == [
        (first.source_component, first.source),
        (name, "in"),
        (name, "out"),
        (first.sink_component, first.sink),
    ]


@pytest.mark.parametrize(("step", "said"), [(None, 1e-3), (2e-4, 2e-4)])
def test_the_step_is_the_systems_own_or_the_units(tmp_path: Path, step: float | None, said: float) -> None:
    system = replace(load_system("joint"), default_experiment=DefaultExperiment(0.0, 20.0, "jacobi", step))
    assert float(str(written(system, tmp_path).findtext("o:BaseStepSize", namespaces=OSP))) == said
    ssd = etree.parse(write_ssd(system, tmp_path / "joint.ssd")).getroot()
    assert [float(e.get("baseStepSize")) for e in ssd.iter("{*}FixedStepAlgorithm")] == [said]
    assert [float(e.get("stepSize")) for e in ssd.iter("{*}FixedStepMaster")] == [said]
    again = load_system(tmp_path / "joint.ssd").default_experiment
    assert (again.scheme, again.step) == ("jacobi", step)


def test_editors_find_every_component_inside_the_systems_area(tmp_path: Path) -> None:
    root = etree.parse(write_ssd(load_system("joint"), tmp_path / "joint.ssd")).getroot()

    def corners(path: str) -> list[list[float]]:
        return [[float(box.get(k)) for k in ("x1", "y1", "x2", "y2")] for box in root.iterfind(path, NS)]

    (area,) = corners("ssd:System/ssd:SystemGeometry")
    boxes = corners("ssd:System/ssd:Elements/ssd:Component/ssd:ElementGeometry")
    assert len(boxes) == 4
    for left, right in itertools.pairwise(boxes):
        assert left[2] < right[0]
    assert all(area[0] < x1 < x2 < area[2] and area[1] < y1 < y2 < area[3] for x1, y1, x2, y2 in boxes)
    assert len(list(root.iter("{*}ConnectorGeometry"))) == len(list(root.iter("{*}Connector")))


def test_without_own_wires_every_wire_has_two_components() -> None:
    system = without_own_wires(load_system("joint"))
    assert all(c.source_component and c.sink_component for c in system.connections)
    assert not system.inputs
    assert not system.outputs
