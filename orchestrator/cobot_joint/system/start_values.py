"""Values that travel inside an FMU: in its XML, and in a resource that the units read, as importers may set neither."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from cobot_joint import xml
from cobot_joint.system.model import Value
from cobot_joint.system.parameters import checked
from cobot_joint.units import TOOL, Unit

START_VALUES = "resources/start_values.txt"  # what units with our glue read at instantiation


@dataclass(frozen=True)
class PortText:
    """What a variable of the correction unit is in one system: it has the unit of measure of this unit's variable."""

    unit: Unit
    variable: str
    description: str


def carries_values(unit: Unit) -> bool:
    """Does the unit read start values from its resources? Those with our glue do, by the names in their libraries."""
    root = _description(unit.directory, unit)
    ours = root.find(f"VendorAnnotations/Tool[@name='{TOOL}']") is not None
    return ours and root.get("variableNamingConvention") != "flat"


def set_start_values(
    folder: Path,
    unit: Unit,
    values: Mapping[str, Value],
    onsets: Mapping[str, float] | None = None,
    ports: Mapping[str, PortText] | None = None,
) -> None:
    """Other start values for an unpacked copy of the unit, under a GUID that belongs to both; the library stays.

    onsets: of these values, which hold only from a time on, s. ports: variable -> (unit, description) where the general
    unit has none of its own. What an earlier call set and this one does not stays. UserError: a value that the unit
    does not take.
    """
    root = _description(folder, unit)
    lines, late = _lines(folder / START_VALUES), onsets or {}
    for name, given in values.items():
        value = checked(unit, name, given, f"{unit.path.name}: {name}")
        text = repr(float(value)) if unit.variables[name].type == "Real" else str(int(value))
        lines[name] = f"{name} = {text} from {late[name]!r}" if name in late else f"{name} = {text}"
        if name not in late:
            _typed(root, name).set("start", text)
    for name, port in (ports or {}).items():
        _describe_port(root, name, port)
    content = root.get("guid", "") + etree.tostring(root).decode() + str(list(lines.values()))
    guid = f"{{{uuid.uuid5(uuid.NAMESPACE_OID, content)}}}"
    root.set("guid", guid)
    (folder / "modelDescription.xml").write_bytes(
        etree.tostring(root, pretty_print=True, xml_declaration=True, encoding="UTF-8")
    )
    (folder / START_VALUES).parent.mkdir(exist_ok=True)
    (folder / START_VALUES).write_text("\n".join([f"guid = {guid}", *lines.values(), ""]), encoding="utf-8")


def _lines(file: Path) -> dict[str, str]:
    """Variable -> its line in the file, if there is one, but for the GUID."""
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    lines = {line.partition(" = ")[0]: line for line in text.splitlines()}
    lines.pop("guid", None)
    return lines


def _description(folder: Path, unit: Unit) -> etree._Element:
    return xml.parse((folder / "modelDescription.xml").read_bytes(), f"{unit.path}: modelDescription.xml")


def _typed(root: etree._Element, name: str) -> etree._Element:
    """<Real>, <Integer>, ... of a variable"""
    for variable in root.iterfind("ModelVariables/ScalarVariable"):
        if variable.get("name") == name:
            return next(child for child in variable if etree.QName(child).localname != "Annotations")
    raise KeyError(name)


def _describe_port(root: etree._Element, name: str, text: PortText) -> None:
    typed = _typed(root, name)
    typed.getparent().set("description", text.description)
    typed.attrib.pop("unit", None)
    measure = text.unit.unit_of(text.variable)
    if not measure:
        return
    typed.set("unit", measure)
    definitions = root.find("UnitDefinitions")
    if not any(unit.get("name") == measure for unit in definitions):
        definitions.append(
            _description(text.unit.directory, text.unit).find(f"UnitDefinitions/Unit[@name='{measure}']")
        )
