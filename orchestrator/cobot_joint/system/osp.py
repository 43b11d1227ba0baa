"""OspSystemStructure.xml: the same system for libcosim, the Open Simulation Platform's simulator.

Wires at the system's own connectors have no place in it: what they drive is set there, by a scenario, by its own name.
"""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from cobot_joint.files import write_atomically
from cobot_joint.system.model import Component, Connection, System, Value

NAMESPACE = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"
STEP = 1e-3  # s; the one that the units declare, in masters that hold inputs


def write_osp(system: System, path: Path) -> Path:
    """Beside the FMUs, which the system names as its components' sources."""
    root = etree.Element("OspSystemStructure", nsmap={None: NAMESPACE}, version="0.1")
    etree.SubElement(root, "StartTime").text = repr(system.default_experiment.start_time)
    etree.SubElement(root, "BaseStepSize").text = repr(system.default_experiment.step or STEP)
    etree.SubElement(root, "Algorithm").text = "fixedStep"
    simulators = etree.SubElement(root, "Simulators")
    for component in system.components:
        node = etree.SubElement(simulators, "Simulator", name=component.name, source=component.source)
        _initial_values(node, component)
    wires = [c for c in system.connections if c.source_component and c.sink_component]
    scaled = {f"scale_{k}": c for k, c in enumerate(wires) if (c.factor, c.offset) != (1.0, 0.0)}
    if scaled:
        functions = etree.SubElement(root, "Functions")
        for name, c in scaled.items():
            etree.SubElement(functions, "LinearTransformation", name=name, factor=repr(c.factor), offset=repr(c.offset))
    connections = etree.SubElement(root, "Connections")
    for c in wires:
        if c not in scaled.values():
            _connection(connections, "VariableConnection", _source(c), _sink(c))
    for name, c in scaled.items():
        _connection(connections, "SignalConnection", _source(c), _signal(name, "in"))
        _connection(connections, "SignalConnection", _signal(name, "out"), _sink(c))
    text = etree.tostring(root, pretty_print=True, xml_declaration=True, encoding="UTF-8")
    write_atomically(path, lambda file: file.write_bytes(text))
    return path


def _initial_values(parent: etree._Element, component: Component) -> None:
    if not component.parameters:
        return
    group = etree.SubElement(parent, "InitialValues")
    for name, value in component.parameters.items():
        kind = component.unit.variables[name].type
        node = etree.SubElement(group, "InitialValue", variable=name)
        etree.SubElement(node, "Integer" if kind == "Enumeration" else kind, value=_text(value))


def _text(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _connection(parent: etree._Element, kind: str, start: etree._Element, end: etree._Element) -> None:
    etree.SubElement(parent, kind).extend([start, end])


def _source(c: Connection) -> etree._Element:
    return etree.Element("Variable", simulator=str(c.source_component), name=c.source)


def _sink(c: Connection) -> etree._Element:
    return etree.Element("Variable", simulator=str(c.sink_component), name=c.sink)


def _signal(function: str, name: str) -> etree._Element:
    return etree.Element("Signal", function=function, name=name)
