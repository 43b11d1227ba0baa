"""Small units with closed-form answers, compiled here; what they declare of themselves is chosen per test."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import fmpy
import pytest

from cobot_joint.system import Component, Connection, Connector, System
from cobot_joint.units import load_unit

UNITS = Path(__file__).parent / "units"

# unit -> (name, value reference, type, causality, start)
VARIABLES = {
    "inertia": [
        ("phi", 0, "Real", "output", None),
        ("w", 1, "Real", "output", None),
        ("W", 2, "Real", "output", None),
        ("W_abs", 3, "Real", "output", None),
        ("tau", 4, "Real", "input", "0"),
        ("tau_drive", 5, "Real", "input", "0"),
        ("rotor.J", 6, "Real", "parameter", "1"),
        ("rotor.phi_0", 7, "Real", "parameter", "1"),
    ],
    "spring_damper": [
        ("W", 0, "Real", "output", None),
        ("W_abs", 1, "Real", "output", None),
        ("phi", 2, "Real", "input", "0"),
        ("w", 3, "Real", "input", "0"),
        ("tau", 4, "Real", "output", None),
        ("spring.c", 5, "Real", "parameter", "1"),
        ("spring.d", 6, "Real", "parameter", "0.1"),
    ],
    "axis": [
        ("phi", 0, "Real", "output", None),
        ("w", 1, "Real", "output", None),
        ("u", 2, "Real", "input", "0"),
        ("J", 3, "Real", "parameter", "1e-2"),
        ("friction.d", 4, "Real", "parameter", "2e-2"),
        ("friction.tau_C", 5, "Real", "parameter", "0.02"),
        ("windage.c", 6, "Real", "parameter", "0"),
        ("asymmetry.tau_A", 7, "Real", "parameter", "0"),
        ("d_most", 8, "Real", "parameter", "1"),
    ],
    "crash": [("u", 0, "Real", "input", "0"), ("y", 1, "Real", "output", None)],
    "gain": [
        ("u", 0, "Real", "input", "0"),
        ("y", 1, "Real", "output", None),
        ("k", 2, "Real", "parameter", "2"),
        ("fail_at", 3, "Real", "parameter", "1e9"),
        ("fail_as", 4, "Real", "parameter", "3"),
        ("longest", 5, "Real", "parameter", "1e9"),
        ("n_in", 0, "Integer", "input", "0"),
        ("n_out", 1, "Integer", "output", None),
        ("b_in", 0, "Boolean", "input", "false"),
        ("b_out", 1, "Boolean", "output", None),
    ],
}
FOLLOWS = {
    "crash": {"y": "1"},
    "gain": {"y": "1", "n_out": "7", "b_out": "9"},
    "spring_damper": {"tau": "3 4"},
}  # outputs by index of inputs
ANNOTATIONS = {
    "inertia": '<Flange name="shaft" phi="phi" w="w" tau="tau" W="W" W_abs="W_abs" role="gives"/>',
    "axis": '<Terms><Term name="windage" amplitude="windage.c"/>'
    '<Term name="asymmetry" amplitude="asymmetry.tau_A"/></Terms>',
    "spring_damper": '<Flange name="shaft" phi="phi" w="w" tau="tau" W="W" W_abs="W_abs" role="takes"/>',
}


@dataclass(frozen=True)
class Declares:
    """What a unit says it can; the binaries can do all of it."""

    interpolates: bool = True
    cubic: bool = True  # one of ours: follows cubics
    slopes: bool = True
    rolls_back: bool = True


MakeSystem = Callable[..., System]


@pytest.fixture(scope="session")
def make_component(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Component]:
    """make_component(name, unit, {declared: bool}, **parameters), a parameter's dot written as two underscores"""
    compiler = os.environ.get("CC") or next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), None)
    if compiler is None:
        pytest.skip("no C compiler for the test units")
    directory = tmp_path_factory.mktemp("units")
    libraries: dict[str, Path] = {}
    fmus: dict[tuple[str, Declares], Path] = {}

    def make(
        name: str, unit: str, declared: Mapping[str, bool] = MappingProxyType({}), **parameters: float
    ) -> Component:
        declares = Declares(**declared)
        if unit not in libraries:
            libraries[unit] = _compile(compiler, unit, directory)
        if (unit, declares) not in fmus:
            fmus[unit, declares] = _pack(libraries[unit], unit, declares, directory / f"{unit}_{len(fmus)}.fmu")
        fmu = fmus[unit, declares]
        named = {key.replace("__", "."): value for key, value in parameters.items()}
        return Component(name, fmu.name, load_unit(fmu), named)

    return make


def _compile(compiler: str, unit: str, directory: Path) -> Path:
    library = directory / (unit + fmpy.sharedLibraryExtension)
    headers = Path(fmpy.__file__).parent / "c-code"
    flags = ["-std=c11", "-O2", "-shared", "-Wall", "-Wextra", "-Werror", "-I", str(headers), "-o", str(library)]
    position = [] if sys.platform == "win32" else ["-fPIC"]
    subprocess.run([*compiler.split(), *flags, *position, str(UNITS / f"{unit}.c"), "-lm"], check=True)
    return library


def _pack(library: Path, unit: str, declares: Declares, fmu: Path) -> Path:
    with zipfile.ZipFile(fmu, "w") as archive:
        archive.writestr("modelDescription.xml", _describe(unit, declares))
        archive.write(library, f"binaries/{fmpy.platform}/{library.name}")
    return fmu


def _describe(unit: str, declares: Declares) -> str:
    variables, outputs = [], []
    for index, (name, vr, kind, causality, start) in enumerate(VARIABLES[unit], 1):
        initial = ' initial="calculated"' if causality == "output" else ""
        variability = {"parameter": "tunable"}.get(causality, "continuous" if kind == "Real" else "discrete")
        begin = f' start="{start}"' if start is not None else ""
        variables.append(
            f'<ScalarVariable name="{name}" valueReference="{vr}" causality="{causality}" variability="{variability}"'
            f"{initial}><{kind}{begin}/></ScalarVariable>"
        )
        if causality == "output":
            followed = FOLLOWS.get(unit, {}).get(name)
            outputs.append(f'<Unknown index="{index}"' + (f' dependencies="{followed}"/>' if followed else "/>"))
    flange = (
        f'<VendorAnnotations><Tool name="cobot-joint">{ANNOTATIONS[unit]}</Tool></VendorAnnotations>'
        if unit in ANNOTATIONS
        else ""
    )
    tool = ' generationTool="cobot-joint"' if declares.cubic else ""
    flags = {
        "canInterpolateInputs": declares.interpolates,
        "canGetAndSetFMUstate": declares.rolls_back,
        "canHandleVariableCommunicationStepSize": True,
    }
    capabilities = " ".join(f'{name}="{str(value).lower()}"' for name, value in flags.items())
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{unit}" guid="{unit}"{tool}>
<CoSimulation modelIdentifier="{unit}" {capabilities} maxOutputDerivativeOrder="{int(declares.slopes)}"/>
{flange}<ModelVariables>{"".join(variables)}</ModelVariables>
<ModelStructure><Outputs>{"".join(outputs)}</Outputs><InitialUnknowns>{"".join(outputs)}</InitialUnknowns></ModelStructure>
</fmiModelDescription>"""


@pytest.fixture(scope="session")
def make_oscillator(make_component: Callable[..., Component]) -> MakeSystem:
    """make_oscillator({declared: bool}): inertia against spring and damper; input tau_drive, outputs phi, w, tau."""

    def make(declared: Mapping[str, bool] = MappingProxyType({}), **parameters: float) -> System:
        wires = [
            Connection("inertia", "phi", "spring", "phi"),
            Connection("inertia", "w", "spring", "w"),
            Connection("spring", "tau", "inertia", "tau"),
            Connection(None, "tau_drive", "inertia", "tau_drive"),
            Connection("inertia", "phi", None, "phi"),
            Connection("inertia", "w", None, "w"),
            Connection("spring", "tau", None, "tau"),
        ]
        return System(
            name="oscillator",
            components=(
                make_component("inertia", "inertia", declared),
                make_component("spring", "spring_damper", declared, **parameters),
            ),
            connections=tuple(wires),
            inputs={"tau_drive": Connector("tau_drive", "input")},
            outputs={name: Connector(name, "output") for name in ("phi", "w", "tau")},
        )

    return make


@pytest.fixture(scope="session")
def make_gain(make_component: Callable[..., Component]) -> MakeSystem:
    """make_gain({declared: bool}, **parameters): one static unit; inputs u, n, b, outputs y, n_out, b_out."""

    def make(declared: Mapping[str, bool] = MappingProxyType({}), **parameters: float) -> System:
        return System(
            name="amplifier",
            components=(make_component("gain", "gain", declared, **parameters),),
            connections=(
                Connection(None, "u", "gain", "u"),
                Connection(None, "n", "gain", "n_in"),
                Connection(None, "b", "gain", "b_in"),
                Connection("gain", "y", None, "y", 10.0, 1.0),
                Connection("gain", "n_out", None, "n_out"),
                Connection("gain", "b_out", None, "b_out"),
            ),
            inputs={name: Connector(name, "input") for name in ("u", "n", "b")},
            outputs={name: Connector(name, "output") for name in ("y", "n_out", "b_out")},
        )

    return make
