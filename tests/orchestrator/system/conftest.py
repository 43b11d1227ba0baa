"""Tiny units: a modelDescription and nothing else, zipped as .fmu; and systems over them."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from cobot_joint.system import System, load_system

UNITS = """
<Unit name="rad/s"><BaseUnit rad="1" s="-1"/></Unit>
<Unit name="rpm"><BaseUnit rad="1" s="-1" factor="0.10471975511965977"/></Unit>
<Unit name="K"><BaseUnit K="1"/></Unit>
<Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit>
<Unit name="N.m"><BaseUnit kg="1" m="2" s="-2"/></Unit>
<Unit name="furlong"/>
"""

# name, causality, type, attributes of the type
Row = tuple[str, str, str, str]


def describe(name: str, rows: list[Row], initial: str = "", annotations: str = "", interface: str = "") -> str:
    """A modelDescription.xml. `initial`: the InitialUnknowns."""
    variables = "".join(
        f'<ScalarVariable name="{n}" valueReference="{k}" causality="{causality}"'
        f"{' variability=' + chr(34) + 'fixed' + chr(34) if causality == 'parameter' else ''}"
        f"{' variability=' + chr(34) + 'discrete' + chr(34) if kind != 'Real' and causality != 'parameter' else ''}>"
        f"<{kind} {attributes}/></ScalarVariable>"
        for k, (n, causality, kind, attributes) in enumerate(rows)
    )
    outputs = "".join(f'<Unknown index="{k}"/>' for k, row in enumerate(rows, 1) if row[1] == "output")
    interface = interface or f'<CoSimulation modelIdentifier="{name}"/>'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{name}">{interface}
<UnitDefinitions>{UNITS}</UnitDefinitions>
<TypeDefinitions><SimpleType name="mode"><Enumeration>
<Item name="off" value="1"/><Item name="on" value="2"/></Enumeration>
</SimpleType></TypeDefinitions>
{f"<VendorAnnotations>{annotations}</VendorAnnotations>" if annotations else ""}
<ModelVariables>{variables}</ModelVariables>
<ModelStructure><Outputs>{outputs}</Outputs>{f"<InitialUnknowns>{initial}</InitialUnknowns>" if initial else ""}
</ModelStructure></fmiModelDescription>"""


@pytest.fixture
def make_fmu(tmp_path: Path) -> Callable[..., Path]:
    """make_fmu("motor", rows): tmp_path/motor.fmu"""

    def make(name: str, rows: list[Row], **more: str) -> Path:
        path = tmp_path / f"{name}.fmu"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", describe(name, rows, **more))
        return path

    return make


@pytest.fixture
def make_system(tmp_path: Path) -> Callable[..., Path]:
    """make_system(components, connections): tmp_path/system.ssd; the arguments are the XML inside the elements."""

    def make(components: str, connections: str = "", connectors: str = "", units: str = "", top: str = "") -> Path:
        path = tmp_path / "system.ssd"
        path.write_text(f"""<?xml version="1.0" encoding="UTF-8"?>{top}
<ssd:SystemStructureDescription version="1.0" name="system"
 xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
 xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
 xmlns:ssm="http://ssp-standard.org/SSP1/SystemStructureParameterMapping">
<ssd:System name="system">
{f"<ssd:Connectors>{connectors}</ssd:Connectors>" if connectors else ""}
<ssd:Elements>{components}</ssd:Elements>
{f"<ssd:Connections>{connections}</ssd:Connections>" if connections else ""}
</ssd:System>
{f"<ssd:Units>{units}</ssd:Units>" if units else ""}
</ssd:SystemStructureDescription>""")
        return path

    return make


@pytest.fixture
def pair(make_fmu: Callable[..., Path], make_system: Callable[..., Path]) -> Callable[..., System]:
    """pair(connections): a motor that gives w [rad/s], T [degC], n (Integer); a meter of other units and types."""
    make_fmu(
        "motor",
        [
            ("w", "output", "Real", 'unit="rad/s"'),
            ("T", "output", "Real", 'unit="degC"'),
            ("n", "output", "Integer", ""),
            ("tau", "input", "Real", 'unit="N.m" start="0"'),
            ("R", "parameter", "Real", 'unit="rpm" start="1" min="0" max="10"'),
            ("mode", "parameter", "Enumeration", 'declaredType="mode" start="1"'),
            ("count", "parameter", "Integer", 'start="3" min="1" max="5"'),
            ("enabled", "parameter", "Boolean", 'start="true"'),
            ("free", "output", "Real", ""),
        ],
    )
    make_fmu(
        "meter",
        [
            ("w", "input", "Real", 'unit="rpm" start="0"'),
            ("T", "input", "Real", 'unit="K" start="0"'),
            ("tau", "input", "Real", 'unit="N.m" start="0"'),
            ("d", "input", "Real", 'unit="furlong" start="0"'),
            ("on", "input", "Boolean", 'start="false"'),
            ("free", "input", "Real", 'start="0"'),
            ("y", "output", "Real", 'unit="rpm"'),
        ],
    )

    def make(connections: str, motor: str = "", **more: str) -> System:
        components = (
            f'<ssd:Component name="motor" source="motor.fmu">{motor}</ssd:Component>'
            '<ssd:Component name="meter" source="meter.fmu"/>'
        )
        return load_system(make_system(components, connections, **more))

    return make


def wire(start: str, end: str, inside: str = "", **attributes: str) -> str:
    """`wire("motor.w", "meter.w")`; a name without a dot is the system's own."""
    (a, x), (b, y) = ([None, end_] if "." not in end_ else end_.split(".", 1) for end_ in (start, end))
    elements = (f' startElement="{a}"' if a else "") + (f' endElement="{b}"' if b else "")
    more = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<ssd:Connection{elements} startConnector="{x}" endConnector="{y}"{more}>{inside}</ssd:Connection>'


LINE = '<ssc:LinearTransformation factor="2" offset="5"/>'


@pytest.fixture(name="wire")
def _wire() -> Callable[..., str]:
    return wire


@pytest.fixture(name="line")
def _line() -> str:
    """A transformation: twice, plus 5"""
    return LINE
