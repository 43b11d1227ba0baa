"""Units for the benchmarks alone: one that costs nothing, and one that plays the bench's inputs in other masters."""

import platform
import sys
import uuid
import zipfile
from pathlib import Path

import fmpy
import numpy as np
from numpy.typing import NDArray

from benchmarks.monolith import FLAGS, INPUTS, SAMPLE, compile_library

SOURCES = Path(__file__).parent


def _write(name: str, folder: Path, inputs: list[str], outputs: list[str], resources: dict[str, bytes]) -> Path:
    headers = Path(fmpy.__file__).parent / "c-code"
    library = compile_library(SOURCES / f"{name}.c", [*FLAGS, f"-I{headers}"], [SOURCES / "minimal.h"])
    rows = [
        f'<ScalarVariable name="{u}" valueReference="{n}" causality="input"><Real start="0"/></ScalarVariable>'
        for n, u in enumerate(inputs)
    ]
    rows += [f'<ScalarVariable name="{y}" valueReference="{n}" causality="output"><Real/></ScalarVariable>'
             for n, y in enumerate(outputs, len(inputs))]  # fmt: skip
    unknowns = "".join(f'<Unknown index="{n + 1}"/>' for n in range(len(inputs), len(rows)))
    description = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{uuid.uuid5(uuid.NAMESPACE_URL, name)}"
 generationTool="cobot-joint benchmarks" variableNamingConvention="structured">
 <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"/>
 <ModelVariables>{"".join(rows)}</ModelVariables>
 <ModelStructure><Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure>
</fmiModelDescription>"""
    binaries = {"linux": "linux64", "darwin": "darwin64"}.get(sys.platform)
    if binaries is None or platform.architecture()[0] != "64bit":
        raise RuntimeError(f"platform {sys.platform!r}: the benchmarks' units are built for 64-bit Linux and macOS")
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(library, f"binaries/{binaries}/{name}{'.so' if binaries == 'linux64' else '.dylib'}")
        for file, content in resources.items():
            archive.writestr(f"resources/{file}", content)
    return path


def trivial(folder: Path) -> Path:
    """`trivial.fmu`: input `u`, output `y = 1 + u/2`."""
    return _write("trivial", folder, ["u"], ["y"], {})


def signals(folder: Path, inputs: NDArray[np.float64], step: float) -> Path:
    """`signals.fmu`: outputs v_command, i_brake, tau_hold; `inputs` (rows, 3) at 1 kHz, for a master's `step` [s]."""
    table = np.concatenate([[len(inputs), SAMPLE, step / 2], np.ravel(inputs)]).astype(np.float64)
    return _write("signals", folder, [], INPUTS, {"signals.bin": table.tobytes()})
