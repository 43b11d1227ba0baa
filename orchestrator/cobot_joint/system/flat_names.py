"""Variables without dots, for importers that take none: `friction.tau_C` is `friction_tau_C`.

Ansys Twin Builder supports no periods in the names of an FMU's interfaces (its help, "Overview of FMU Coupling").
"""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from cobot_joint import xml
from cobot_joint.errors import UserError

NAMING = (  # elements of a modelDescription whose attribute names a variable
    ("ModelVariables/*", "name"),
    (".//Term", "amplitude"),
    (".//Term/Shape", "name"),
    (".//Choice", "name"),
)


def flat(name: str) -> str:
    """The name without dots."""
    return name.replace(".", "_")


def flatten(folder: Path) -> None:
    """An unpacked FMU's names; its library knows variables by number. UserError: two names would become one."""
    file = folder / "modelDescription.xml"
    root = xml.parse(file.read_bytes(), str(file))
    root.set("variableNamingConvention", "flat")
    for path, attribute in NAMING:
        for element in root.iterfind(path):
            if (name := element.get(attribute)) is not None:
                element.set(attribute, flat(name))
    names = [v.get("name") for v in root.iterfind("ModelVariables/*")]
    if twice := sorted({str(name) for name in names if names.count(name) > 1}):
        raise UserError(
            f"--flat-names: {', '.join(twice)} would be the name of two variables of {root.get('modelName')}"
        )
    file.write_bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8"))
