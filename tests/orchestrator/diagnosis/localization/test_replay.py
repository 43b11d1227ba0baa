"""Which parts of the bench are off when they are driven by what was recorded at their ports."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cobot_joint.diagnosis.data.conditioning import assess
from cobot_joint.diagnosis.estimation.calibrate import refit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.localization.localize import Localization, locate_difference
from cobot_joint.diagnosis.plant.influence import behind, influences
from cobot_joint.diagnosis.repair.compare import VARIANTS, Comparison
from cobot_joint.diagnosis.report import localization_words
from cobot_joint.diagnosis.report.report import ReportData, render
from cobot_joint.diagnosis.report.words import spoken
from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.bench import NOISE, UNITS, calibrated

UPSTREAM = {"motor_bldc", "planetary_gear", "acquisition"}
DOWNSTREAM = {"planetary_gear", "torque_sensor", "mr_brake_belt", "acquisition"}


def located(concealed: dict[str, float]) -> Localization:
    with calibrated(concealed) as (problem, fit):
        return locate_difference(problem, fit)


def off(found: Localization) -> dict[tuple[str, ...], bool]:
    """Driving channels -> whether the loaded part that they drive is off."""
    return {r.part.driven: bool(r.off) for r in found.replayed if r.part.setup == "loaded"}


def test_cutting_the_recorded_wires_leaves_the_motors_side_and_the_brakes_side() -> None:
    parts = {r.part.driven: r.part for r in located({}).replayed if r.part.setup == "loaded"}
    assert set(parts) == {(), ("tau_sensor",), ("w_motor",)}
    assert set(parts["tau_sensor",].units) == UPSTREAM
    assert parts["tau_sensor",].channels == ("i_motor", "w_motor")
    assert set(parts["w_motor",].units) == DOWNSTREAM
    assert parts["w_motor",].channels == ("tau_sensor",)


def test_on_a_healthy_bench_no_part_is_off_and_no_unit_suspect() -> None:
    found = located({"motor_bldc.friction.tau_C": 1.1e-3, "mr_brake_belt.brake.tau_off": 0.09})
    assert not any(r.off for r in found.replayed)
    assert found.suspects == ()


@pytest.mark.parametrize("unit", ["motor_bldc", "planetary_gear"])
def test_missing_friction_at_the_motor_shaft_puts_the_motors_side_off_and_not_the_brakes(unit: str) -> None:
    found = located({f"{unit}.stribeck.tau_S": 3e-3})
    assert off(found) == {(): True, ("tau_sensor",): True, ("w_motor",): False}
    assert set(found.suspects) == {"motor_bldc", "planetary_gear", "acquisition"}


def test_a_missing_effect_of_the_brake_puts_its_side_off_and_not_the_motors() -> None:
    found = located({"mr_brake_belt.imbalance.G": 0.05})
    assert off(found) == {(): True, ("tau_sensor",): False, ("w_motor",): True}
    assert "mr_brake_belt" in found.suspects
    assert "motor_bldc" not in found.suspects


def test_a_wrong_reading_of_the_torque_puts_both_sides_off_and_suspects_the_sensor() -> None:
    found = located({"torque_sensor.offset.tau_0": 0.06})
    assert off(found) == {(): True, ("tau_sensor",): True, ("w_motor",): True}
    assert "torque_sensor" in found.suspects
    assert not {"motor_bldc", "mr_brake_belt"} & set(found.suspects)


def test_a_loss_that_only_load_brings_out_keeps_the_gear_suspect_though_without_load_nothing_is_off() -> None:
    found = located({"planetary_gear.mesh.eta": 0.65})
    assert not any(r.off for r in found.replayed if r.part.setup == "no_load")
    assert "planetary_gear" in found.suspects


def test_a_unit_whose_inputs_are_not_recorded_is_said_not_to_be_replayed_alone() -> None:
    found = located({})
    assert "planetary_gear.tau" in found.not_alone["motor_bldc"]
    assert "mr_brake_belt" not in found.not_alone  # the sensor's torque is recorded
    assert any(
        s.startswith("motor_bldc cannot be replayed alone: ")
        for s in localization_words.located(found.to_json())["components"]
    )


def test_what_lies_behind_a_known_signal_is_not_needed() -> None:
    before = influences(load_system("joint_logged"))
    everything = behind(["i_motor"], before)
    assert {"mr_brake_belt.w_p", "planetary_gear.tau", "v_command"} <= everything
    driven = behind(["i_motor"], before, ["torque_sensor.tau_s"])
    assert "planetary_gear.tau" in driven
    assert "mr_brake_belt.w_p" not in driven


def test_the_report_shows_part_by_part_what_is_off_and_when() -> None:
    with calibrated({"motor_bldc.stribeck.tau_S": 3e-3}) as (problem, fit):
        found = locate_difference(problem, fit).to_json()
        runs = problem.outputs(fit.run)
    compared = [Comparison(r, dict.fromkeys(VARIANTS, run)) for r, run in zip(problem.recordings, runs, strict=True)]
    channels = {name: {"noise": sigma, "train": dict.fromkeys(VARIANTS, sigma)} for name, sigma in NOISE.items()}
    content = {"verdict": "undecided", "findings": [], "channels": channels, "calibrated": {}, "repaired": {}}
    content = spoken(content | {"located": found, "advice": [], "structure": {}, "repair": "offered"})
    text = render(ReportData("friction", content, compared, {n: assess(runs[0][n]) for n in NOISE}, UNITS))
    for part in ("Part by part", "By operating condition", "When: loaded", "When: no_load", "cannot be replayed alone"):
        assert part in text


def test_a_run_that_lacks_a_channel_is_replayed_with_the_others() -> None:
    with calibrated({}) as (problem, _):
        runs = problem.recordings
        without = replace(runs[0], name="other", outputs={n: x for n, x in runs[0].outputs.items() if n != "i_motor"})
        weaker = Problem(problem.plant, [*runs, without], problem.noise)
        fit = refit(weaker, Hypothesis(()))
        assert fit is not None
        assert locate_difference(weaker, fit).replayed
