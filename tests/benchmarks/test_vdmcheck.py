"""VDMCheck2, a formal model of FMI 2.0's text, finds nothing in the units' XML: INTO-CPS Association, version 1.1.3.

COBOT_JOINT_JARS names the folder with its jars (benchmarks/README.md); without them it is skipped.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest

from cobot_joint.system import load_system, with_parameters, write_fmus
from cobot_joint.system.flat_names import flatten
from cobot_joint.units import find_fmu

JARS = Path(os.environ.get("COBOT_JOINT_JARS", ""))
CLASSES = [JARS / f"{name}.jar" for name in ("vdmj", "annotations", "xsd2vdm", "fmuReader")]
RULES = [JARS / "rule-model.jar", JARS / "vdmcheck2.jar"]  # the model and its documents; the XML schemas
UNITS = sorted(table.parent.name for table in (Path(__file__).parents[2] / "fmus").glob("*/model.def"))


@pytest.fixture(scope="module")
def rules(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that holds the unpacked rules. Skips where VDMCheck2 is not there."""
    if shutil.which("java") is None:
        pytest.skip("VDMCheck2 is not here: no Java")
    if missing := [jar.name for jar in (*CLASSES, *RULES) if not jar.is_file()]:
        pytest.skip(f"VDMCheck2 is not here: COBOT_JOINT_JARS={JARS} has no {', '.join(missing)}")
    folder = tmp_path_factory.mktemp("vdmcheck")
    for jar in RULES:
        with zipfile.ZipFile(jar) as archive:
            archive.extractall(folder)
    return folder


def findings(fmu: Path, rules: Path) -> list[str]:
    """What VDMCheck2 prints, word by word; `true` alone: nothing is wrong."""
    documents = sorted((rules / "fmi2-rule-model/Rules").glob("*.adoc"))
    call = ["java", "-Dvdmj.parser.merge_comments=true", "-Dfmureader.noschema=true"]
    call += ["-Dfmureader.xsd=fmi2schema/fmi2.xsd", "-cp", os.pathsep.join(map(str, CLASSES)), "com.fujitsu.vdmj.VDMJ"]
    call += ["-vdmsl", "-q", "-annotations", "-e"]
    call += ["isValidFMIConfigurations(modelDescription, buildDescription, terminalsAndIcons)"]
    call += ["fmi2-rule-model", *map(str, documents), str(fmu)]
    done = subprocess.run(call, cwd=rules, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout.split()


@pytest.mark.parametrize("name", UNITS)
def test_vdmcheck_finds_nothing_in_a_unit(rules: Path, name: str) -> None:
    assert findings(find_fmu(f"{name}.fmu"), rules) == ["true"]


def test_vdmcheck_finds_nothing_in_an_export_with_flat_names_and_a_parameter(rules: Path, tmp_path: Path) -> None:
    system = with_parameters(load_system("joint"), {"motor_bldc.winding.R": 0.25})
    motor = write_fmus(system, tmp_path, [flatten]).component("motor_bldc")
    assert findings(motor.unit.path, rules) == ["true"]


def test_vdmcheck_finds_a_type_that_has_a_variables_name(rules: Path, tmp_path: Path) -> None:
    """FMI 2.0.4, 2.2.3: what four of our units once did"""
    types = '<TypeDefinitions><SimpleType name="tau_s"><Real/></SimpleType></TypeDefinitions><LogCategories>'
    with zipfile.ZipFile(find_fmu("torque_sensor.fmu")) as unit, zipfile.ZipFile(tmp_path / "x.fmu", "w") as wrong:
        text = unit.read("modelDescription.xml").decode()
        assert text.count("<LogCategories>") == 1
        wrong.writestr("modelDescription.xml", text.replace("<LogCategories>", types))
    assert "false" in findings(tmp_path / "x.fmu", rules)
