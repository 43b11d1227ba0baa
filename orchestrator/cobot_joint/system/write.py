"""SSP 1.0 out: a System as .ssd, its parameters as .ssv, or all of it with the FMUs as one .ssp."""

from __future__ import annotations

import re
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, count
from pathlib import Path

from fmpy.model_description import BaseUnit
from lxml import etree

from cobot_joint import xml
from cobot_joint.errors import UserError
from cobot_joint.files import write_atomically
from cobot_joint.pack import pack
from cobot_joint.system.annotations import PREFIXES, annotate_experiment, annotate_system
from cobot_joint.system.flat_names import flat
from cobot_joint.system.geometry import connector_point, element_box, system_box
from cobot_joint.system.model import Component, Connection, Connector, System, Value
from cobot_joint.system.read import NS
from cobot_joint.system.start_values import carries_values, set_start_values
from cobot_joint.system.wiring import EXPONENTS, Wiring, check, conversion, port_type
from cobot_joint.units import Unit, load_unit


def write_ssd(system: System, path: Path) -> Path:
    """The description alone; component sources as the system has them."""
    text = describe(system, {c.name: c.source for c in system.components})
    write_atomically(path, lambda file: file.write_bytes(text))
    return path


def write_ssv(component: Component, path: Path) -> Path:
    """The parameters that a system sets on a component, as a parameter set."""
    root = _parameter_set(component)
    text = _text(root, "SystemStructureParameterValues", path)
    write_atomically(path, lambda file: file.write_bytes(text))
    return path


def write_ssp(system: System, path: Path) -> Path:
    """Description and FMUs in one archive that any SSP importer takes. Same system, same bytes."""
    names = fmu_names(system)
    files = {names[c.name]: c.unit.path for c in system.components}
    sources = {name: f"resources/{file}" for name, file in names.items()}
    description = describe(system, sources)

    def write(file: Path) -> None:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(zipfile.ZipInfo("SystemStructure.ssd"), description)
            for name, fmu in files.items():
                archive.writestr(zipfile.ZipInfo(f"resources/{name}"), fmu.read_bytes())

    write_atomically(path, write)
    return path


def write_fmus(system: System, folder: Path, changes: Sequence[Callable[[Path], None]] = ()) -> System:
    """The system's FMUs in a folder, and the system with these. `changes`: what is done to each, unpacked.

    Parameters are start values of their FMUs too, where these can carry them: FMPy and fmucontainer take none from an
    SSP. UserError: an FMU is not what a change needs.
    """
    return with_fmus(system, folder, write_fmus_alone(system, folder, changes))


def with_fmus(system: System, folder: Path, names: Mapping[str, str]) -> System:
    """The system with FMUs that `write_fmus_alone` wrote there."""
    components = []
    for c in system.components:
        unit = load_unit(folder / names[c.name])
        parameters = {n if n in unit.variables else flat(n): value for n, value in c.parameters.items()}
        components.append(replace(c, source=names[c.name], unit=unit, parameters=parameters))
    return replace(system, components=tuple(components))


def write_fmus_alone(system: System, folder: Path, changes: Sequence[Callable[[Path], None]] = ()) -> dict[str, str]:
    """As `write_fmus`, and what was written is not read again: component -> its FMU's file name."""
    names = fmu_names(system)
    for name, c in {names[c.name]: c for c in system.components}.items():
        own = [partial(set_start_values, unit=c.unit, values=c.parameters)]
        write_fmu(c.unit, folder / name, [*own, *changes] if c.parameters and carries_values(c.unit) else changes)
    return names


def write_fmu(unit: Unit, file: Path, changes: Sequence[Callable[[Path], None]] = ()) -> Path:
    """One FMU, as `write_fmus` writes them."""
    write_atomically(file, partial(_write_changed, unit, changes))
    return file


def _write_changed(unit: Unit, changes: Sequence[Callable[[Path], None]], file: Path) -> None:
    if not changes:
        shutil.copyfile(unit.path, file)
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary, "fmu")
        shutil.copytree(unit.directory, folder)
        for change in changes:
            change(folder)
        pack(folder, file)


def fmu_names(system: System) -> dict[str, str]:
    """Component -> its FMU's file name in one folder: its own, and the component's too where another has taken that.

    Other parameters make another FMU.
    """
    wanted = [((c.unit.directory, *sorted(c.parameters.items())), c.unit.path.stem, c.name) for c in system.components]
    return dict(zip((c.name for c in system.components), file_names(wanted), strict=True))


def file_names(wanted: Iterable[tuple[Hashable, str, str]], suffix: str = ".fmu") -> list[str]:
    """Names for (what a file holds, how to call it, what tells it from others called so): equal content, one name.

    Also on file systems that do not tell A from a; what may not stand in a file's name becomes _.
    """
    holds: dict[str, Hashable] = {}
    found = []
    for content, name, other in wanted:
        stem, further = (re.sub(r"[^\w.-]", "_", text).lstrip(".") or "_" for text in (name, other))
        stems = chain([stem, f"{stem}_{further}"], (f"{stem}_{further}_{k}" for k in count(2)))
        found.append(next(s for s in stems if holds.setdefault(s.casefold(), content) == content) + suffix)
    return found


def describe(system: System, sources: Mapping[str, str]) -> bytes:
    """The SystemStructureDescription, held against SSP's schema."""
    check(system)
    units = _units(system)
    root = etree.Element(
        _tag("ssd", "SystemStructureDescription"), nsmap=NS | PREFIXES, version="1.0", name=system.name
    )
    element = etree.SubElement(root, _tag("ssd", "System"), name=system.name)
    connectors = [*system.inputs.values(), *system.outputs.values()]
    _connectors(element, connectors)
    elements = etree.SubElement(element, _tag("ssd", "Elements"))
    ports = [_ports(component, system) for component in system.components]
    for place, component in enumerate(system.components):
        node = etree.SubElement(elements, _tag("ssd", "Component"), name=component.name, source=sources[component.name])
        _connectors(node, ports[place])
        etree.SubElement(node, _tag("ssd", "ElementGeometry"), element_box(place, ports[place]))
        if component.parameters:
            bindings = etree.SubElement(node, _tag("ssd", "ParameterBindings"))
            binding = etree.SubElement(bindings, _tag("ssd", "ParameterBinding"))
            etree.SubElement(binding, _tag("ssd", "ParameterValues")).append(_parameter_set(component))
    wiring = Wiring(system.components, connectors, units, system.name)
    if system.connections:
        wires = etree.SubElement(element, _tag("ssd", "Connections"))
        for connection in system.connections:
            _connection(wires, connection, wiring)
    etree.SubElement(element, _tag("ssd", "SystemGeometry"), system_box(ports))
    annotate_system(element, system.default_experiment)
    if units:
        _write_units(etree.SubElement(root, _tag("ssd", "Units")), units)
    experiment = system.default_experiment
    node = etree.SubElement(
        root, _tag("ssd", "DefaultExperiment"),
        startTime=_number(experiment.start_time), stopTime=_number(experiment.stop_time),
    )  # fmt: skip
    annotate_experiment(node, experiment)
    return _text(root, "SystemStructureDescription", Path(f"{system.name}.ssd"))


def without_own_wires(system: System) -> System:
    """For importers that stumble over wires at a system's connectors: what these drive is set by its own name there."""
    inner = tuple(c for c in system.connections if c.source_component and c.sink_component)
    return replace(system, connections=inner, inputs={}, outputs={})


def _connectors(parent: etree._Element, connectors: list[Connector]) -> None:
    if not connectors:
        return
    group = etree.SubElement(parent, _tag("ssd", "Connectors"))
    for c in connectors:
        node = etree.SubElement(group, _tag("ssd", "Connector"), name=c.name, kind=c.causality)
        if c.description:
            node.set("description", c.description)
        typed = etree.SubElement(node, _tag("ssc", c.type))
        if c.type == "Real" and c.unit:
            typed.set("unit", c.unit)
        etree.SubElement(node, _tag("ssd", "ConnectorGeometry"), connector_point(c, connectors))


def _ports(component: Component, system: System) -> list[Connector]:
    """Outputs, and wired inputs only: some importers set every input that a description lists to 0, wired or not."""
    unit = component.unit
    wired = {c.sink for c in system.connections if c.sink_component == component.name}
    return [
        Connector(v.name, v.causality, kind, unit.unit_of(v.name), v.description or "")
        for v in unit.variables.values()
        if (v.causality == "output" or (v.causality == "input" and v.name in wired)) and (kind := port_type(v.type))
    ]


def _connection(parent: etree._Element, c: Connection, wiring: Wiring) -> None:
    node = etree.SubElement(parent, _tag("ssd", "Connection"))
    for side, component, name in (("start", c.source_component, c.source), ("end", c.sink_component, c.sink)):
        if component is not None:
            node.set(f"{side}Element", component)
        node.set(f"{side}Connector", name)
    try:
        source = wiring.endpoint(c.source_component, c.source)
        by_units = conversion(source, wiring.endpoint(c.sink_component, c.sink), wiring.where)
    except UserError:  # a wire that was made with its units left alone
        by_units = None
    if by_units != (c.factor, c.offset):
        node.set("suppressUnitConversion", "true")
        etree.SubElement(
            node, _tag("ssc", "LinearTransformation"), factor=_number(c.factor), offset=_number(c.offset)
        )  # fmt: skip


def _parameter_set(component: Component) -> etree._Element:
    root = etree.Element(_tag("ssv", "ParameterSet"), nsmap=NS, version="1.0", name=component.name)
    group = etree.SubElement(root, _tag("ssv", "Parameters"))
    used: dict[str, BaseUnit] = {}
    for name, value in component.parameters.items():
        parameter = etree.SubElement(group, _tag("ssv", "Parameter"), name=name)
        _parameter(parameter, component, name, value, used)
    if used:
        _write_units(etree.SubElement(root, _tag("ssv", "Units")), used)
    return root


def _parameter(
    parent: etree._Element, component: Component, name: str, value: Value, used: dict[str, BaseUnit]
) -> None:
    variable, unit = component.unit.variables[name], component.unit.unit_of(name)
    if variable.type == "Enumeration":
        item = next(item for item, n in component.unit.choices_of(name).items() if n == value)
        etree.SubElement(parent, _tag("ssv", "Enumeration"), value=item)
        return
    text = _number(value) if variable.type == "Real" else str(value).lower()
    typed = etree.SubElement(parent, _tag("ssv", variable.type), value=text)
    if variable.type == "Real" and unit and unit in component.unit.units:
        typed.set("unit", unit)
        used[unit] = component.unit.units[unit]


def _units(system: System) -> dict[str, BaseUnit]:
    """Units that the system and its components name, as the components define them."""
    units: dict[str, BaseUnit] = {}
    for component in system.components:
        for name, base in component.unit.units.items():
            units.setdefault(name, base)
    named = {c.unit for c in [*system.inputs.values(), *system.outputs.values()]}
    named |= {p.unit for component in system.components for p in _ports(component, system)}
    return {name: units[name] for name in sorted(n for n in named if n) if name in units}


def _write_units(parent: etree._Element, units: Mapping[str, BaseUnit]) -> None:
    for name, base in units.items():
        node = etree.SubElement(etree.SubElement(parent, _tag("ssc", "Unit"), name=name), _tag("ssc", "BaseUnit"))
        for exponent in EXPONENTS:
            if power := getattr(base, exponent):
                node.set(exponent, str(power))
        if base.factor != 1.0:
            node.set("factor", _number(base.factor))
        if base.offset != 0.0:
            node.set("offset", _number(base.offset))


def _text(root: etree._Element, schema: str, path: Path) -> bytes:
    etree.cleanup_namespaces(root)
    text = etree.tostring(root, pretty_print=True, xml_declaration=True, encoding="UTF-8")
    xml.parse(text, str(path), schema)
    return text


def _tag(prefix: str, name: str) -> str:
    return f"{{{NS[prefix]}}}{name}"


def _number(value: Value) -> str:
    return repr(float(value))
