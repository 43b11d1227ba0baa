"""Our units as FMI 3.0 FMUs: the build makes one of each, and what a system or a repair has set goes with it."""

from __future__ import annotations

import re
import shutil
import zipfile
from pathlib import Path

from lxml import etree

from cobot_joint import xml
from cobot_joint.errors import UserError
from cobot_joint.units import find_fmu

TOKEN = re.compile(r'#define UNIT_GUID "(.*)"')  # in sources/all.c: which table and equations the library is from


def as_fmi3(folder: Path) -> None:
    """An unpacked FMI 2.0 FMU of ours becomes its FMI 3.0 counterpart: same start values, ports, resources, GUID.

    UserError: it is not ours, or not built from the same sources as the counterpart.
    """
    file = folder / "modelDescription.xml"
    two = xml.parse(file.read_bytes(), str(file))
    name = two.get("modelName")
    counterpart = _counterpart(two.find("CoSimulation").get("modelIdentifier"))
    if counterpart is None or _token(folder / "sources/all.c") != _token(zipfile.Path(counterpart, "sources/all.c")):
        raise UserError(f"--for fmi3: {name} is not one of the units that this installation has as FMI 3.0 FMUs")
    for part in folder.iterdir():
        if part.is_dir() and part.name != "resources":
            shutil.rmtree(part)
    with zipfile.ZipFile(counterpart) as archive:
        archive.extractall(folder)
    three = xml.parse(file.read_bytes(), str(file))
    three.set("instantiationToken", two.get("guid"))
    _carry_over(two, three)
    file.write_bytes(etree.tostring(three, xml_declaration=True, encoding="UTF-8"))


def _counterpart(identifier: str) -> Path | None:
    try:
        counterpart = find_fmu(f"{identifier}.fmu").parent / "fmi3" / f"{identifier}.fmu"
    except UserError:
        return None
    return counterpart if counterpart.is_file() else None


def _token(source: Path | zipfile.Path) -> str | None:
    found = TOKEN.search(source.read_text(encoding="utf-8")) if source.is_file() else None
    return found and found[1]


def _carry_over(two: etree._Element, three: etree._Element) -> None:
    """Start values; of reals also what they are and their unit of measure, which a correction has from its system."""
    variables = {v.get("name"): v for v in three.find("ModelVariables")}
    for old in two.iterfind("ModelVariables/ScalarVariable"):
        new, typed = variables[old.get("name")], old[0]
        if typed.get("start") is not None:
            new.set("start", typed.get("start"))
        if typed.tag == "Real":
            new.set("description", old.get("description"))
            new.attrib.pop("unit", None)
            if typed.get("unit"):
                new.set("unit", typed.get("unit"))
    defined = three.find("UnitDefinitions")
    names = {unit.get("name") for unit in defined}
    defined.extend([unit for unit in two.iterfind("UnitDefinitions/Unit") if unit.get("name") not in names])
