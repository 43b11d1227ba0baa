"""What no signal announces: a hand that held the coupling, a belt that jumped."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cobot_joint.diagnosis.candidates.load_histories import frozen_meanwhile
from cobot_joint.diagnosis.candidates.scan import Scan
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.engine import identify
from cobot_joint.diagnosis.estimation.effects import ActiveTerm, LoadPulse
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.least_squares import fit, fit_added
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.findings import Diagnosis, Finding, LoadHistory
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.repair.verify import acted_on
from cobot_joint.diagnosis.selection import external_loads
from cobot_joint.diagnosis.selection.competition import finished
from cobot_joint.diagnosis.selection.external_loads import (
    look_for_external_loads,
    look_for_onset,
    look_for_unlogged_load,
    short_times,
)
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.stepwise import Selector
from cobot_joint.diagnosis.selection.tolerances.outside import beside_load
from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.bench import NOISE, SETUPS, TIME, calibrated, recordings

HELD = np.interp(TIME, [1.30, 1.36, 1.46, 1.56], [0.0, 1.5, 1.5, 0.0])  # N.m; a grip while the joint runs forwards
JUMP = np.where(TIME >= 1.5, 0.02, 0.0)  # rad, at the brake shaft
LOUD = 12.0  # times the noise that there is


def nothing(start: Fit) -> Selection:
    """A selection that finds no term."""
    return Selection([start])


def silent(words: str) -> None:
    """Nobody is told."""


def test_a_hand_that_held_the_coupling_is_named_with_its_torque_and_times() -> None:
    with calibrated({}, added={"mr_brake_belt.tau_h": HELD}) as (problem, base):
        found = look_for_external_loads(problem, nothing(base), nothing, silent)
        assert found is not None
        assert found.finding.term == "mr_brake_belt.external_torque"
        assert found.finding.load_history is not None
        assert found.finding.load_history.port == "mr_brake_belt.tau_h"
        t, value = found.finding.load_history.recordings["loaded"]
        assert np.allclose(t, [1.30, 1.36, 1.46, 1.56], atol=5e-3)
        assert np.max(value) == pytest.approx(1.5, rel=0.01)
        assert not problem.unexplained(found.fit.residual)


def test_a_term_beside_a_hand_is_named_as_well() -> None:
    with calibrated({"motor_bldc.windage.c": 4e-9}, added={"mr_brake_belt.tau_h": HELD}) as (problem, base):
        windage = [t for t in problem.plant.terms if t.name.endswith(".windage")]
        selector = Selector(problem, Scan(problem, windage), silent)
        found = look_for_unlogged_load(problem, base, selector.select, silent)
        assert found is not None
        assert found.finding.term == "mr_brake_belt.external_torque"
        assert [n.term for n in found.selected] == ["motor_bldc.windage"]
        assert found.fit.run.values["motor_bldc.windage.c"] == pytest.approx(4e-9, rel=0.1)


def test_a_hand_beside_a_background_is_named_unless_a_listed_term_promises_half_of_it() -> None:
    background = 2e-4 * np.sin(7 * TIME + 3 * TIME**2)
    added = {"mr_brake_belt.tau_h": HELD, "motor_bldc.tau_add": background}
    with calibrated({}, added=added) as (problem, base):
        found = look_for_unlogged_load(problem, base, nothing, silent, lambda fit: 0.1)
        assert found is not None
        assert problem.unexplained(found.fit.residual)
        assert found.finding.term == "mr_brake_belt.external_torque"
        assert found.finding.confidence > 0.5
        assert look_for_unlogged_load(problem, base, nothing, silent, lambda fit: 0.6) is None


@pytest.mark.parametrize("other", [0.0, 1e-2])
def test_a_parameter_beside_a_load_is_the_finding_where_together_they_leave_little(other: float) -> None:
    """A load took 59 % beside a brake's inertia of twice its data sheet's, and 98 % were asked (machine 233/39)."""
    load = {"mr_brake_belt.external_torque.T": 0.5, "mr_brake_belt.external_torque.t_0": 1.3}
    added = {"motor_bldc.tau_add": other * np.sin(7 * TIME + 3 * TIME**2)}
    with calibrated({**load, "motor_bldc.friction.d": 3e-5}, added=added) as (problem, base):
        term = next(t for t in problem.plant.terms if t.name == "mr_brake_belt.external_torque")
        about = {**load, **{s.name: s.values[0] for s in term.shapes if s.name not in load}}
        loaded = fit_added(problem, base, [ActiveTerm(term, about)], finished(1))
        assert loaded is not None
        listed = Selection([base, loaded], [Selected(term.name, base.cost - loaded.cost)])
        found = beside_load(problem, listed, silent)
        assert (found is None) == (other > 0)
        if found is not None:
            assert found.name == "motor_bldc.friction.d"
            assert found.fit.run.values[found.name] == pytest.approx(3e-5, rel=0.02)
            assert found.selection.selected[0].gain > problem.evidence
        assert beside_load(problem, Selection([base]), silent) is None


def test_loads_are_not_fitted_to_what_lies_below_the_noise_unless_they_promise_nearly_all_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # what is left was less, in all, than the noise that a campaign gave, and any load promised more than that
    monkeypatch.setattr(external_loads, "fitted", lambda *_: pytest.fail("loads were fitted"))
    with calibrated({}, added={"mr_brake_belt.stretch_add": JUMP}) as (fine, _):
        problem = Problem(fine.plant, fine.recordings, {n: Noise(LOUD * s) for n, s in NOISE.items()}, jobs=1)
        base = fit(problem, Hypothesis(()))
        assert base is not None
        assert short_times(problem, base.residual)
        assert problem.unexplained(base.residual)
        assert base.chi2 < problem.samples
        assert look_for_unlogged_load(problem, base, nothing, silent) is None


def test_a_belt_that_jumped_is_unlisted_with_the_angle_and_the_moment() -> None:
    with calibrated({}, added={"mr_brake_belt.stretch_add": JUMP}) as (problem, base):
        found = look_for_external_loads(problem, nothing(base), nothing, silent)
        assert found is not None
        assert found.finding.term == "mr_brake_belt.unlisted"
        assert found.finding.onset == pytest.approx(1.5, abs=2e-3)
        shape = found.finding.shape
        assert shape is not None
        assert shape.port == "mr_brake_belt.stretch_add"
        assert shape.features[0].coefficient.value == pytest.approx(0.02, rel=0.05)


def test_an_eccentricity_that_sets_in_with_a_jump_of_the_belt_is_named_with_its_time() -> None:
    ecc = "mr_brake_belt.pulley_eccentricity"
    concealed = {f"{ecc}.A": 7e-4, f"{ecc}.phi_0": 2.0}
    with calibrated(concealed, onsets={f"{ecc}.A": 1.5}) as (problem, base):
        # not transmission_error, which can do the same over the part of a turn that the pulley moves here
        rivals = ("pulley_eccentricity", "stiffness_hardening", "backlash", "windage")
        terms = [t for t in problem.plant.terms if t.name.split(".")[1] in rivals]
        selector = Selector(problem, Scan(problem, terms), silent)
        selector.scan.columns(base)
        offset = look_for_external_loads(problem, nothing(base), nothing, silent)
        assert offset is not None
        assert offset.finding.onset is not None
        found = selector.setting_in(base, offset.finding.onset)
        assert found is not None
        assert found.cost < offset.fit.cost
        last = found.settled().hypothesis.terms[-1]
        assert last.name == ecc
        assert last.onset == pytest.approx(1.5, abs=2e-3)
        assert last.values[f"{ecc}.A"] == pytest.approx(7e-4, rel=0.05)
        assert last.values[f"{ecc}.phi_0"] == pytest.approx(2.0, abs=0.05)
        assert not problem.unexplained(found.residual)


def test_a_wave_that_sets_in_with_a_jump_which_is_not_all_of_it_is_named_with_its_time() -> None:
    """It was no offset, since the wave goes on, nor always there: nothing was named (machine 241/2)."""
    error = "planetary_gear.transmission_error"
    concealed = {f"{error}.A": 6e-3, f"{error}.phi_0": 3.3, f"{error}.n": 4.0}
    with calibrated(concealed, onsets={f"{error}.A": 1.5}) as (problem, base):
        terms = [
            t for t in problem.plant.terms if t.name.split(".")[1] in ("transmission_error", "backlash", "windage")
        ]
        selector = Selector(problem, Scan(problem, terms), silent)
        selector.scan.columns(base)
        assert look_for_external_loads(problem, nothing(base), nothing, silent) is None
        found = look_for_onset(problem, nothing(base), selector, silent)
        assert found is not None
        assert [s.term for s in found.selected] == [error]
        (first,) = found.fit.settled().hypothesis.terms
        assert first.onset == pytest.approx(1.5, abs=2e-3)
        assert first.values[f"{error}.n"] == 4.0
        assert first.values[f"{error}.A"] == pytest.approx(6e-3, rel=0.02)


@pytest.mark.long
@pytest.mark.machine
def test_a_sealed_campaign_whose_pulley_gives_way_is_answered_with_the_term_and_not_with_an_offset(root: Path) -> None:
    campaign = load_campaign(root / "proof/sealed/case23", roles=("train",))
    with FmuPlant(campaign.systems()) as plant:
        found = identify(campaign, plant)
    assert [f.term for f in found.findings] == ["mr_brake_belt.pulley_eccentricity"]
    assert found.findings[0].onset == pytest.approx(7.3641, abs=2e-3)  # as published


@pytest.mark.parametrize(
    ("moves_until", "frozen"),
    [(12.0, "i_brake"), (0.0, ""), (15.0, "")],
    ids=["frozen over the last quarter", "one value all the time", "moves while it is held"],
)
def test_loads_while_an_input_is_one_value_and_moves_before_may_be_what_was_not_logged(
    moves_until: float, frozen: str
) -> None:
    time = 1e-2 * np.arange(1600)
    u = np.sin(np.minimum(time, moves_until))
    recordings = [SimpleNamespace(name=n, time=time, inputs={"i_brake": u}) for n in ("a", "b")]
    port = SimpleNamespace(name="brake.tau", component="brake", unit="N.m")
    loads = [
        LoadPulse(port, n, time, 1.0, (t, t + 0.1, t + 0.5, t + 0.6))  # type: ignore[arg-type]
        for n in ("a", "b")
        for t in (12.5, 14.0)
    ]
    assert frozen_meanwhile(SimpleNamespace(recordings=recordings), loads) == frozen  # type: ignore[arg-type]


def test_a_difference_that_lasts_is_not_looked_at_as_an_episode() -> None:
    with calibrated({"motor_bldc.windage.c": 2e-8}) as (problem, base):
        assert problem.unexplained(base.residual)
        assert short_times(problem, base.residual) == {}


def test_what_listed_terms_explain_is_not_looked_at_again() -> None:
    with calibrated({}, added={"mr_brake_belt.tau_h": HELD}) as (problem, base):
        true = Fit(base.hypothesis, base.x, 0.0, problem.recorded * 0, base.simulated, base.jacobian, 0)
        listed = Selection([base, true], [Selected("motor_bldc.windage", 1e6)])
        assert look_for_external_loads(problem, listed, nothing, silent) is None


def test_recordings_are_compared_with_what_acted_on_the_machine_while_they_were_made() -> None:
    t = np.array([1.30, 1.36, 1.46, 1.56])
    history = LoadHistory("mr_brake_belt.tau_h", "N.m", {"loaded": (t, np.array([0.0, 1.5, 1.5, 0.0]))})
    finding = Finding("mr_brake_belt.external_torque", (), 0.9, None, {}, {}, 1.0, load_history=history)
    loads = Diagnosis("explained", [finding], {}, {}).load_histories()
    with FmuPlant({setup: load_system(name) for setup, name in SETUPS.items()}) as plant:
        held, _ = recordings(plant, {}, added={"mr_brake_belt.tau_h": HELD})
        assert rms(held.outputs["tau_sensor"] - plant.simulate({}, held)["tau_sensor"]) > 0.1
        assert rms(held.outputs["tau_sensor"] - acted_on(plant, loads)(held)["tau_sensor"]) < 6e-3


def rms(x: Vector) -> float:
    return float(np.sqrt(np.mean(x**2)))
