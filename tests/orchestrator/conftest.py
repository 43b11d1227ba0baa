"""A gearhead that somebody else built: what it declares, and what its ports are called, is chosen per test."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import fmpy
import pytest

SOURCE = Path(__file__).parent / "cosim" / "units" / "foreign_gear.c"
UNITS = {
    "rad": 'rad="1"',
    "rad/s": 'rad="1" s="-1"',
    "rpm": 'rad="1" s="-1" factor="0.10471975511965977"',
    "N.m": 'kg="1" m="2" s="-2"',
    "kg.m2": 'kg="1" m="2"',
}
# name, causality, unit; in the order of the value references
PORTS = [
    ("phi_o", "output", "rad"),
    ("w_o", "output", "rad/s"),
    ("tau", "output", "N.m"),
    ("tau_g", "output", "N.m"),
    ("J_coupled", "output", "kg.m2"),
    ("phi", "input", "rad"),
    ("w", "input", "rad/s"),
    ("tau_s", "input", "N.m"),
    ("N", "parameter", None),
]

MakeGear = Callable[..., Path]


@pytest.fixture(scope="session")
def foreign_gear_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = os.environ.get("CC") or next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), None)
    if compiler is None:
        pytest.skip("no C compiler for the foreign gearhead")
    library = tmp_path_factory.mktemp("foreign") / f"foreign_gear{fmpy.sharedLibraryExtension}"
    headers = Path(fmpy.__file__).parent / "c-code"
    flags = ["-std=c11", "-O2", "-shared", "-I", str(headers), *([] if sys.platform == "win32" else ["-fPIC"])]
    subprocess.run([*compiler.split(), *flags, str(SOURCE), "-o", str(library), "-lm"], check=True)
    return library


@pytest.fixture(scope="session")
def foreign_gear(foreign_gear_library: Path, tmp_path_factory: pytest.TempPathFactory) -> MakeGear:
    """foreign_gear("name", names={"tau": "tau_m"}, units={"w": "rpm"}, without=["tau_g"], canGetAndSetFMUstate=True)"""

    def make(
        name: str = "foreign_gear",
        names: Mapping[str, str] = MappingProxyType({}),
        units: Mapping[str, str | None] = MappingProxyType({}),
        without: tuple[str, ...] = (),
        library: str = "foreign_gear",
        **can: bool,
    ) -> Path:
        path = tmp_path_factory.mktemp("gear") / f"{name}.fmu"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", _description(names, units, without, library, can))
            archive.write(foreign_gear_library, f"binaries/{fmpy.platform}/{foreign_gear_library.name}")
        return path

    return make


def _description(
    names: Mapping[str, str],
    units: Mapping[str, str | None],
    without: tuple[str, ...],
    library: str,
    can: Mapping[str, bool],
) -> str:
    flags = {"canHandleVariableCommunicationStepSize": True, **can}
    variables, outputs = [], []
    for reference, (port, causality, unit) in enumerate(PORTS):
        if port in without:
            continue
        variability = "tunable" if causality == "parameter" else "continuous"
        start = {"input": ' start="0"', "parameter": f' start="{338 / 3!r}"', "output": ""}[causality]
        unit = units.get(port, unit)
        variables.append(
            f'<ScalarVariable name="{names.get(port, port)}" valueReference="{reference}" causality="{causality}"'
            f' variability="{variability}"><Real{start}{f" unit={unit!r}" if unit else ""}/></ScalarVariable>'
        )
        if causality == "output":
            outputs.append(f'<Unknown index="{len(variables)}"/>')
    defined = "".join(f'<Unit name="{name}"><BaseUnit {base}/></Unit>' for name, base in UNITS.items())
    capabilities = " ".join(f'{flag}="{str(value).lower()}"' for flag, value in flags.items())
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="foreign_gear" guid="foreign_gear">
<CoSimulation modelIdentifier="{library}" {capabilities}/><UnitDefinitions>{defined}</UnitDefinitions>
<ModelVariables>{"".join(variables)}</ModelVariables><ModelStructure><Outputs>{"".join(outputs)}</Outputs>
<InitialUnknowns>{"".join(outputs)}</InitialUnknowns></ModelStructure></fmiModelDescription>"""
