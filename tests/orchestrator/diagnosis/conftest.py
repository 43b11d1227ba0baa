"""Systems of other people's making, small enough to write here."""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from cobot_joint.cli import main
from tests.orchestrator.diagnosis.made_up import record
from tests.orchestrator.diagnosis.typed import Done

AXIS_XML = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="axis" guid="{axis}">
  <CoSimulation modelIdentifier="axis"/>
  <UnitDefinitions>
    <Unit name="m"><BaseUnit m="1"/></Unit>
    <Unit name="N"><BaseUnit kg="1" m="1" s="-2"/></Unit>
    <Unit name="V"><BaseUnit kg="1" m="2" s="-3" A="-1"/></Unit>
  </UnitDefinitions>
  <ModelVariables>
    <ScalarVariable name="s" valueReference="0" causality="output" initial="exact">
      <Real unit="m" start="0"/></ScalarVariable>
    <ScalarVariable name="F" valueReference="1" causality="input"><Real unit="N" start="0"/></ScalarVariable>
    <ScalarVariable name="u" valueReference="2" causality="input"><Real unit="V" start="0"/></ScalarVariable>
    <ScalarVariable name="friction.d" valueReference="3" causality="parameter" variability="fixed">
      <Real start="1"/></ScalarVariable>
    <ScalarVariable name="friction.tau_C" valueReference="4" causality="parameter" variability="fixed">
      <Real unit="N" start="0" min="0"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="1"/></Outputs></ModelStructure>
</fmiModelDescription>
"""
AXIS_SSD = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
  xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="axis" version="1.0">
  <ssd:System name="axis">
    <ssd:Connectors>
      <ssd:Connector name="u" kind="input"><ssc:Real unit="V"/></ssd:Connector>
    </ssd:Connectors>
    <ssd:Elements><ssd:Component name="axis" source="axis.fmu"/></ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startConnector="u" endElement="axis" endConnector="u"/>
    </ssd:Connections>
  </ssd:System>
</ssd:SystemStructureDescription>
"""


@pytest.fixture
def axis(tmp_path: Path) -> Path:
    """A system of one foreign FMU, of which only the description is needed."""
    with zipfile.ZipFile(tmp_path / "axis.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", AXIS_XML)
    (tmp_path / "axis.ssd").write_text(AXIS_SSD)
    return tmp_path / "axis.ssd"


@pytest.fixture(scope="module")
def campaign_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaign")
    text = 'title = "Concealed cogging"\nsystem = "joint"\n'
    runs = [("noload", "no_load", "train"), ("load", "loaded", "train"), ("later", "loaded", "holdout")]
    for seed, (name, setup, role) in enumerate(runs):
        record(folder, name, setup, seed)
        text += f'[[recording]]\nfile = "{name}.parquet"\nsetup = "{setup}"\nrole = "{role}"\n'
    (folder / "campaign.toml").write_text(text)
    return folder / "campaign.toml"


@pytest.fixture
def cobot_joint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Done]:
    """The command as typed in the test's folder, in this process."""

    def call(*words: str) -> Done:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["cobot-joint", *words])
        with pytest.raises(SystemExit) as left:
            main()
        said = capsys.readouterr()
        return Done(int(left.value.code or 0), said.out, said.err)

    return call
