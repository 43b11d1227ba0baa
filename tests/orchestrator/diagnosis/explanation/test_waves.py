"""A listed wave by the recorded angle, where free runs lose it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from cobot_joint.diagnosis.anchored.search import Search
from cobot_joint.diagnosis.candidates.scan import Scan
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import fit_added
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.estimation.recorded_motion import WaveAlongRecording, at_recorded_angle
from cobot_joint.diagnosis.explanation import beyond_the_list as beyond
from cobot_joint.diagnosis.explanation.beyond_the_list import BeyondTheList
from cobot_joint.diagnosis.explanation.waves import by_recorded_angle, hides_a_wave, in_place_of
from cobot_joint.diagnosis.selection.competition import finished
from cobot_joint.diagnosis.selection.selection import Selection
from cobot_joint.diagnosis.selection.stepwise import Selector
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled, look_at_ports
from cobot_joint.diagnosis.store import Store
from tests.orchestrator.diagnosis.axis import NOISE, OFF, Axis, campaign

COGGING = {"axis.cogging.A": 0.02, "axis.cogging.n": 5.0, "axis.cogging.phi_0": 0.4}


def quiet(_: str) -> None:
    pass


def drifting(truth: dict[str, float], turns: bool = False) -> Campaign:
    """An axis beside which something comes and goes slowly, which no term is: free runs slip. turns: it has teeth that
    pull the other way where it turns back."""
    case, plant, rng = campaign(OFF), Axis(), np.random.default_rng(3)
    for recording in case.recordings:
        slow = 1e-3 * np.sin(2 * np.pi * recording.time / 2.3 + 1.0)
        clean = plant.simulate(truth, recording, added={"axis.tau_add": slow})
        for _ in range(12 if turns else 0):
            teeth = -0.02 * np.sin(5 * clean["axis.phi"]) * np.tanh(clean["axis.w"] / 0.05)
            clean = plant.simulate(truth, recording, added={"axis.tau_add": slow + teeth})
        recording.outputs["w"] = clean["w"] + rng.normal(0, NOISE, len(recording.time))
    return case


def calibrated(case: Campaign) -> tuple[Problem, Fit]:
    return calibrate(case, Axis(), quiet, Store(None))


def test_a_wave_whose_angle_free_runs_lose_is_named_with_its_size_by_the_recorded_angle() -> None:
    """Machine 223/6: a torque ripple of nineteen times the background was a formula, 95 % sure, for free runs that
    slip by half a turn of the motor had it in a local minimum."""
    problem, base = calibrated(drifting({**OFF, **COGGING}))
    beside = Selector(problem, Scan(problem, Axis().terms), quiet)
    found = by_recorded_angle(problem, Selection([base]), beside, quiet)
    assert [s.term for s in found.selected] == ["axis.cogging"]
    values = found.fit.run.values
    assert values["axis.cogging.n"] == 5
    assert values["axis.cogging.A"] == pytest.approx(0.02, rel=0.15)
    assert np.cos(values["axis.cogging.phi_0"] - 0.4) > 0.9


def test_a_machine_without_a_wave_gets_none() -> None:
    problem, base = calibrated(drifting(OFF))
    beside = Selector(problem, Scan(problem, Axis().terms), quiet)
    nothing = Selection([base])
    assert by_recorded_angle(problem, nothing, beside, quiet) is None


def test_of_a_machine_that_obeys_the_equations_the_wave_goes_by_its_own_angle() -> None:
    """An integrated speed knows an angle less well than a run that leaves nothing but noise."""
    problem, base = calibrated(campaign({**OFF, **COGGING}))
    beside = Selector(problem, Scan(problem, Axis().terms), quiet)
    found = by_recorded_angle(problem, Selection([base]), beside, quiet)
    assert [s.term for s in found.selected] == ["axis.cogging"]
    assert not isinstance(found.fit.hypothesis.terms[0], WaveAlongRecording)
    assert not problem.unexplained(found.fit.residual)


def formula(problem: Problem, base: Fit) -> Unmodelled:
    found = look_at_ports(problem, base, [], quiet)
    assert found is not None
    assert found.is_wave
    return found


def test_a_formula_is_held_against_the_listed_wave_of_its_order() -> None:
    problem, base = calibrated(drifting({**OFF, **COGGING}))
    found = formula(problem, base)
    wave, *_ = in_place_of(problem, found, {"axis.cogging": 1e-3})
    assert [a.name for a in wave.hypothesis.terms] == ["axis.cogging"]
    assert not found.outdoes(problem, wave)


def test_teeth_whose_pull_turns_with_the_direction_stay_on_no_list() -> None:
    """Machines 163/88 and 223/1 were cogging."""
    problem, base = calibrated(drifting(OFF, turns=True))
    found = formula(problem, base)
    waves = in_place_of(problem, found, {"axis.cogging": 1e-3})
    assert not waves or found.outdoes(problem, waves[0])


@pytest.mark.parametrize("turns", [False, True], ids=["cogging", "teeth that turn with the direction"])
def test_what_the_motion_claims_is_held_against_a_formula_by_the_same_angle(
    turns: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, base = calibrated(drifting(OFF if turns else {**OFF, **COGGING}, turns))
    found = formula(problem, base)
    (angle,) = (t for t in problem.plant.terms if t.phase)
    claim = ActiveTerm(angle, {**COGGING, "axis.cogging.A": 0.01})

    def freely(problem: Problem, listed: Selection, search: Search) -> object:
        wave = at_recorded_angle(problem, base.run, claim)
        fit = fit_added(problem, base, [wave], finished(1))
        return (fit, [SimpleNamespace(term="axis.cogging")]) if fit is not None else None

    monkeypatch.setattr(beyond, "beside_listed", freely)
    asked = BeyondTheList.__new__(BeyondTheList)
    asked.problem, asked.listed, asked.calibrated, asked._freely = problem, Selection([base]), base, None
    search = Search(named=[cast(beyond.Search, SimpleNamespace(name="axis.cogging", shows=True))])  # type: ignore[list-item]
    assert asked._outdoes_claimed(found, search) == turns


@pytest.mark.parametrize("truth", [{}, COGGING], ids=["none", "cogging"])
def test_a_wave_that_free_runs_have_lost_is_seen_in_what_they_leave(truth: dict[str, float]) -> None:
    problem, base = calibrated(drifting({**OFF, **truth}))
    assert hides_a_wave(problem, base) == bool(truth)
