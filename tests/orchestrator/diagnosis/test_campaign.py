"""A campaign file says what it wants, or is told in one line what it may say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from orchestrator.diagnosis.campaign import CampaignError, load_campaign, system_connectors

SSD = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
  xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="axis" version="1.0">
  <ssd:System name="axis">
    <ssd:Connectors><ssd:Connector name="u" kind="input"><ssc:Real unit="V"/></ssd:Connector></ssd:Connectors>
    <ssd:Elements><ssd:Component name="axis" source="axis.fmu"><ssd:Connectors>
      <ssd:Connector name="s" kind="output"><ssc:Real unit="m"/></ssd:Connector>
      <ssd:Connector name="F" kind="input"><ssc:Real unit="N"/></ssd:Connector>
      <ssd:Connector name="mass" kind="parameter"><ssc:Real unit="kg"/></ssd:Connector>
    </ssd:Connectors></ssd:Component></ssd:Elements>
  </ssd:System>
</ssd:SystemStructureDescription>
"""


def write(folder: Path, toml: str) -> Path:
    t = np.arange(100) * 1e-3
    rows = "\n".join(f"{a},{3 * a},{1000 * a + 5}" for a in t)
    (folder / "run.csv").write_text(f"t,vir,qm\n{rows}\n")
    (folder / "axis.ssd").write_text(SSD)
    (folder / "campaign.toml").write_text(toml)
    return folder / "campaign.toml"


AXIS = """system = "axis.ssd"
[channels]
"vir [V]" = "u"
"qm [mm]" = "axis.s"
[tolerances]
"axis.friction.d" = "20 %"
"axis.friction.tau_C" = [0.0, 2.0]
[[recording]]
file = "run.csv"
initial = { "axis.s" = "first sample" }
"""


def test_a_campaign_over_another_system_maps_columns_to_its_connectors(tmp_path: Path) -> None:
    campaign = load_campaign(write(tmp_path, AXIS))
    (r,) = campaign.recordings
    assert set(r.inputs) == {"u"} and set(r.outputs) == {"axis.s"} and r.role == "train"
    assert r.outputs["axis.s"][1] == pytest.approx(6e-3) and r.initial == {"axis.s": pytest.approx(5e-3)}
    assert campaign.tolerances["axis.friction.d"].bounds(-2.0) == pytest.approx((-2.4, -1.6))
    assert campaign.tolerances["axis.friction.tau_C"].bounds(1.0) == (0.0, 2.0)


def test_connectors_are_those_of_the_system_and_of_its_components(tmp_path: Path) -> None:
    write(tmp_path, AXIS)
    found = system_connectors(tmp_path / "axis.ssd")
    assert {(c.name, c.causality, c.unit) for c in found.values()} == {
        ("u", "input", "V"),
        ("axis.s", "output", "m"),
        ("axis.F", "input", "N"),
    }


@pytest.mark.parametrize(
    "change, told",
    [
        (
            ("[[recording]]", "[[recordings]]"),
            "recordings: no such key, allowed are title, system, setups, channels, tolerances, logged, recording",
        ),
        (('file = "run.csv"', 'file = "gone.csv"'), "gone.csv: there is no such file"),
        (
            ('file = "run.csv"', 'file = "run.csv"\nrole = "test"'),
            "recording.0.role: 'test' is given; Input should be 'train' or 'holdout'",
        ),
        (('file = "run.csv"', 'file = "run.csv"\nsetup = "hot"'), "setup 'hot' is given, default is allowed"),
        (('"20 %"', '"20"'), "tolerances.axis.friction.d: '20' is given, \"20 %\" or [lower, upper] is allowed"),
        (('"axis.s"\n', '"axis.x"\n'), "'axis.x': axis.ssd has no such connector, it has u, axis.s, axis.F"),
        (('"axis.ssd"', '"exo.ssd"'), "system 'exo.ssd': there is no"),
        (('"axis.ssd"', '"exo"'), "system 'exo' is given, joint or an .ssp or .ssd file is allowed"),
        (("[[recording]]", "[[recording"), "not a TOML file"),
        (("qm [mm]", "qm [A]"), "unit 'A' is given, one that converts to 'm' is needed"),
    ],
)
def test_a_wrong_campaign_is_refused_in_one_line(tmp_path: Path, change: tuple[str, str], told: str) -> None:
    with pytest.raises(CampaignError) as error:
        load_campaign(write(tmp_path, AXIS.replace(*change)))
    assert told in str(error.value) and "\n" not in str(error.value)


def test_a_campaign_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="there is no such campaign file"):
        load_campaign(tmp_path / "campaign.toml")


def test_an_open_campaign_reads_without_a_word(shared: Path) -> None:
    campaign = load_campaign(shared / "recordings/open/case01")
    assert [(r.name, r.setup, r.role, len(r.time)) for r in campaign.recordings] == [
        ("noload", "no_load", "train", 16001),
        ("load", "loaded", "train", 16001),
        ("reversals", "loaded", "train", 16001),
        ("holdout", "loaded", "holdout", 16001),
    ]
    assert not any(r.notes for r in campaign.recordings)
    assert set(campaign.train[0].inputs) == {"v_command"} and set(campaign.train[0].outputs) == {"i_motor", "w_motor"}
