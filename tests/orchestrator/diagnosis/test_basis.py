"""A kept result is believed only while all that it depends on is what it was: each of it edited, each noticed."""

from __future__ import annotations

import re
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from cobot_joint import paths
from cobot_joint.diagnosis import basis
from cobot_joint.diagnosis.archive import fingerprint
from cobot_joint.diagnosis.basis import of_campaign, of_response, sources
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.frequency.response import load_response
from cobot_joint.system import DefaultExperiment, load_system, write_ssd
from cobot_joint.units import find_fmu

CAMPAIGN = """title = "t"
system = "bench.ssd"
terms = ["motor_bldc.cogging"]
[channels]
"v [V]" = "v_command"
"w [rad/s]" = "w_motor"
[tolerances]
"motor_bldc.winding.R" = "20 %"
[logged.w_motor]
unit = "rad/s"
causality = "output"
noise = 0.3
colour = 0.1
step = 0.01
[[recording]]
file = "run.parquet"
initial = { "motor_bldc.w" = 1.0 }
[[recording]]
file = "later.parquet"
role = "holdout"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A campaign over a system file of its own, with an FMU and a recording beside it."""
    coupling = DefaultExperiment(0.0, 1.0, "jacobi", 0.0005)
    write_ssd(replace(load_system("joint_no_load"), default_experiment=coupling), tmp_path / "bench.ssd")
    text = (tmp_path / "bench.ssd").read_text()
    assert 'step="0.0005"' in text
    wire = re.search(r"<ssd:Connection [^>]*endElement=\"planetary_gear\"[^>]*/>", text)
    assert wire
    scaled = '<ssc:LinearTransformation factor="1.0" offset="0.0"/></ssd:Connection>'
    text = text.replace(wire[0], wire[0].replace("/>", ' suppressUnitConversion="true">' + scaled))
    text, own = re.subn(r'source="[^"]*motor_bldc.fmu"', 'source="motor_bldc.fmu"', text)
    assert own == 1
    (tmp_path / "bench.ssd").write_text(text)
    shutil.copy(find_fmu("motor_bldc.fmu"), tmp_path / "motor_bldc.fmu")
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    for k, name in enumerate(("run", "later")):
        t = np.arange(50) * 1e-3
        columns = {"time [s]": t, "v [V]": np.sin(t + k), "w [rad/s]": np.cos(t)}
        pa.parquet.write_table(pa.table(columns), tmp_path / f"{name}.parquet")
    return tmp_path


def key(folder: Path) -> str:
    """What the stages of the campaign are kept under."""
    basis.program.cache_clear()
    campaign = load_campaign(folder)
    return fingerprint(of_campaign(campaign, campaign.systems()))


def edit(file: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / file).read_text()
        assert old in text
        (folder / file).write_text(text.replace(old, new, 1))

    return change


def another_fmu(folder: Path) -> None:
    """The same name, one entry more."""
    with zipfile.ZipFile(folder / "motor_bldc.fmu", "a") as archive:
        archive.writestr("resources/changed.txt", "changed")


def another_recording(folder: Path) -> None:
    table = pa.parquet.read_table(folder / "run.parquet")
    w = table["w [rad/s]"].to_numpy().copy()
    w[17] += 1e-12
    pa.parquet.write_table(table.set_column(2, "w [rad/s]", pa.array(w)), folder / "run.parquet")


EDITS = {
    "wire factor": edit("bench.ssd", 'factor="1.0"', 'factor="1.01"'),
    "wire offset": edit("bench.ssd", 'offset="0.0"', 'offset="0.5"'),
    "coupling step": edit("bench.ssd", 'step="0.0005"', 'step="0.001"'),
    "coupling scheme": edit("bench.ssd", 'scheme="jacobi"', 'scheme="gauss_seidel"'),
    "bytes of an FMU": another_fmu,
    "a sample": another_recording,
    "noise": edit("campaign.toml", "noise = 0.3", "noise = 0.2"),
    "colour": edit("campaign.toml", "colour = 0.1", "colour = 0.2"),
    "converter": edit("campaign.toml", "step = 0.01", "step = 0.02"),
    "terms": edit("campaign.toml", '["motor_bldc.cogging"]', "[]"),
    "tolerance": edit("campaign.toml", "20 %", "25 %"),
    "nominal value": edit("campaign.toml", "[channels]", '[parameters]\n"motor_bldc.winding.R" = 0.3\n[channels]'),
    "start value": edit("campaign.toml", "1.0 }", "1.5 }"),
    "role": edit("campaign.toml", 'role = "holdout"', 'role = "train"'),
    "a scale that was looked at": edit("campaign.toml", '= "w_motor"', '= { to = "w_motor", scale = 1 }'),
    "window": edit("campaign.toml", 'file = "run.parquet"', 'file = "run.parquet"\nend = 0.04'),
}


@pytest.mark.parametrize("change", EDITS.values(), ids=EDITS.keys())
def test_what_is_edited_makes_another_key(folder: Path, change: Callable[[Path], None]) -> None:
    before = key(folder)
    assert key(folder) == before
    change(folder)
    assert key(folder) != before


def test_a_parameter_of_the_system_makes_another_key(folder: Path) -> None:
    before = key(folder)
    binding = (
        '<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="p"'
    )
    binding += ' xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"><ssv:Parameters><ssv:Parameter'
    binding += ' name="winding.R"><ssv:Real value="0.3"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>'
    binding += "</ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"
    text = (folder / "bench.ssd").read_text()
    at = text.index("</ssd:Component>", text.index('name="motor_bldc"'))
    (folder / "bench.ssd").write_text(text[:at] + binding + text[at:])
    assert key(folder) != before


def test_held_out_recordings_and_the_folder_s_name_are_no_part_of_the_key(folder: Path, tmp_path: Path) -> None:
    before = key(folder)
    shutil.copytree(folder, tmp_path / "moved")
    shutil.copy(folder / "run.parquet", tmp_path / "moved" / "later.parquet")
    assert key(tmp_path / "moved") == before


def test_another_version_and_changed_sources_make_another_key(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = key(folder)
    monkeypatch.setattr(basis, "__version__", "0.1.1")
    assert (other := key(folder)) != before
    monkeypatch.setattr(basis, "sources", lambda package: "changed")
    assert key(folder) not in (before, other)


def test_every_source_of_the_diagnosis_counts(tmp_path: Path) -> None:
    shutil.copytree(paths.PACKAGE, tmp_path / "package", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    seen = {sources(tmp_path / "package")}
    files = sorted((tmp_path / "package/diagnosis").rglob("*.py"))
    assert len(files) > 40
    for file in files:
        file.write_text(file.read_text() + "\n")
        seen.add(sources(tmp_path / "package"))
    assert len(seen) == len(files) + 1


RESPONSE = """system = "joint_no_load"
[frequency_response]
input = "v_command"
amplitude = 0.3
output = "w_motor"
[tolerances]
"motor_bldc.winding.R" = "20 %"
[[alternative]]
name = "one"
[[recording]]
file = "table.csv"
"""


@pytest.mark.parametrize(
    ("old", "new"),
    [("0.3", "0.4"), ("20 %", "25 %"), ('"one"', '"one"\nterm = "a.b"'), ("joint_no_load", "joint"),
     ('"w_motor"', '"w_motor"\nsettle = 1.0'), ('"w_motor"', '"w_motor"\nparameters = { "motor_bldc.winding.R" = 1 }')],
)  # fmt: skip
def test_what_is_edited_of_a_frequency_response_makes_another_key(tmp_path: Path, old: str, new: str) -> None:
    (tmp_path / "table.csv").write_text("omega,amplitude\n" + "".join(f"{w},{1 / w}\n" for w in range(1, 20)))
    keys = []
    for text in (RESPONSE, RESPONSE, RESPONSE.replace(old, new)):
        (tmp_path / "campaign.toml").write_text(text)
        keys.append(fingerprint(of_response(load_response(tmp_path))))
    assert keys[0] == keys[1] != keys[2]
