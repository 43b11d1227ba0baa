"""A diagnosis over a unit that crashes: where it always does, the line of `run`; where one term does, the others."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cobot_joint import cli
from cobot_joint.cosim import Experiment, SimulationError, simulate
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.engine import diagnose
from cobot_joint.system import Component, Connection, Connector, Inputs, System, write_ssp

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="units in processes of their own need POSIX")
STEP, SAMPLES, NOISE = 2e-3, 3000, 0.05
TIME = STEP * np.arange(SAMPLES)
DRIVEN = {
    "sine": 0.4 * np.sin(2 * np.pi * TIME / 3),
    "steps": np.where(TIME > 3, 0.4, 0.2) - np.where(TIME > 4.5, 0.5, 0),
}

MakeComponent = Callable[..., Component]


def system_of(component: Component) -> System:
    wires = (Connection(None, "u", "axis", "u"), Connection("axis", "w", None, "w"))
    inputs, outputs = {"u": Connector("u", "input", unit="N.m")}, {"w": Connector("w", "output", unit="rad/s")}
    return System("axis", (component,), wires, inputs, outputs)


def campaign(make_component: MakeComponent, folder: Path, **parameters: float) -> Path:
    """Recorded on an axis with windage."""
    healthy = system_of(make_component("axis", "axis", windage__c=1e-3))
    rng = np.random.default_rng(1)
    for name, u in DRIVEN.items():
        w = simulate(healthy, Experiment(Inputs(TIME, {"u": u}), float(TIME[-1]), output_step=STEP))["w"]
        rows = np.column_stack([TIME, u, w + rng.normal(0, NOISE, SAMPLES)])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header="time [s],u [N.m],w [rad/s]", comments="")
    write_ssp(system_of(make_component("axis", "axis", **parameters)), folder / "axis.ssp")
    (folder / "campaign.toml").write_text(
        'system = "axis.ssp"\n[channels]\n"u [N.m]" = "u"\n"w [rad/s]" = "w"\n'
        '[tolerances]\n"axis.friction.d" = "10 %"\n'
        '[[recording]]\nfile = "sine.csv"\n[[recording]]\nfile = "steps.csv"\n'
    )
    return folder


def status(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> object:
    monkeypatch.setattr(sys, "argv", ["cobot-joint", *map(str, arguments)])
    with pytest.raises(SystemExit) as left:
        cli.main()
    return left.value.code


@pytest.mark.long
def test_a_term_that_crashes_its_unit_is_reported_and_the_others_are_found(
    make_component: MakeComponent, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = campaign(make_component, tmp_path)
    assert status(monkeypatch, "diagnose", folder) == 0
    said = capfd.readouterr().out
    found = json.loads((folder / "diagnosis" / "diagnosis.json").read_text())
    assert [f["term"] for f in found["findings"]] == ["axis.windage"]
    (crash,) = found["crashes"]
    assert crash.startswith("axis: fmi2DoStep at t = 0 s crashed (SIGABRT: ")
    assert " runs with it are passed over, the first with " in crash
    assert "axis.asymmetry.tau_A = " in crash
    assert crash in said


def test_a_unit_that_always_crashes_is_the_line_of_run(
    make_component: MakeComponent, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = campaign(make_component, tmp_path, d_most=1e-3)
    assert status(monkeypatch, "run", folder / "axis.ssp", "--out", folder / "out") == 1
    run = capfd.readouterr().err
    assert status(monkeypatch, "diagnose", folder) == 1
    diagnosed = capfd.readouterr().err.splitlines()[-1]
    line = "cobot-joint: axis: fmi2DoStep at t = 0 s crashed (SIGABRT: abort() or a failed assertion)"
    assert run.startswith(line)
    assert diagnosed.startswith(line)
    with pytest.raises(SimulationError, match=r"crashed \(SIGABRT: .*; in sine"):
        diagnose(load_campaign(folder))


@pytest.mark.long
def test_a_frequency_response_passes_over_what_crashes_its_unit_and_says_so(
    make_component: MakeComponent, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    write_ssp(system_of(make_component("axis", "axis")), tmp_path / "axis.ssp")
    amplitudes = "".join(f"{w},{0.4 / np.hypot(2e-3, 1e-3 * w):.6g}\n" for w in np.geomspace(5, 50, 12))
    (tmp_path / "table.csv").write_text("omega [rad/s],amplitude [rad/s]\n" + amplitudes)
    (tmp_path / "campaign.toml").write_text(
        'system = "axis.ssp"\nrecording = [{ file = "table.csv" }]\n[tolerances]\n"axis.friction.d" = "10 %"\n'
        '[frequency_response]\ninput = "u"\namplitude = 0.4\noutput = "w"\nsettle = 0.5\n'
    )
    assert status(monkeypatch, "diagnose", tmp_path) == 0
    (crash,) = json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text())["crashes"]
    assert "axis.asymmetry.tau_A = " in crash
    assert crash in capfd.readouterr().out
