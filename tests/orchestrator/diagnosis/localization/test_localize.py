"""Where and when the difference lies, on an axis whose truth is known."""

from __future__ import annotations

import json

import pytest

from cobot_joint.diagnosis.engine import diagnose_plant
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import fit
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.localization.conditions import Condition
from cobot_joint.diagnosis.localization.localize import Localization, locate_difference
from cobot_joint.diagnosis.report import localization_words
from cobot_joint.diagnosis.report.words import spoken
from tests.orchestrator.diagnosis.axis import NOISE, NOMINAL, Axis, campaign

COGGING = {"axis.cogging.A": 6e-3, "axis.cogging.n": 5.0}


def located(truth: dict[str, float], onsets: dict[str, float] | None = None) -> Localization:
    case = campaign(truth, onsets=onsets)
    problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
    bounds = {name: t.bounds(NOMINAL[name]) for name, t in case.tolerances.items()}
    calibrated = fit(problem, Hypothesis(tolerances(problem, bounds)))
    assert calibrated is not None
    return locate_difference(problem, calibrated)


def level(found: Localization, variable: str, name: str) -> Condition:
    return next(r for r in found.conditions[variable] if r.level == name)


def test_a_healthy_axis_has_no_condition_and_no_change() -> None:
    found = located({"axis.d": 1.9e-3})
    assert (found.conditions, found.orders, found.changes) == ({}, (), ())
    words = localization_words.located(found.to_json())
    assert words["regimes"] == words["time"] == ["Nothing is above noise."]


def test_the_shares_of_a_variables_levels_are_all_there_is() -> None:
    for variable, levels in located(COGGING).conditions.items():
        assert sum(r.share for r in levels) == pytest.approx(1.0, abs=0.01), variable
        assert sum(r.time for r in levels) == pytest.approx(1.0, abs=0.01), variable


def test_stribeck_friction_lies_at_low_speed() -> None:
    found = located({"axis.stribeck.tau_S": 0.02, "axis.stribeck.w_S": 4.0})
    slow = [level(found, "w", name) for name in ("near zero", "low")]
    assert sum(r.share for r in slow) > 2 * sum(r.time for r in slow)


def test_cogging_is_located_at_its_order_of_the_shafts_angle() -> None:
    found = located(COGGING)
    assert [(o.angle, o.order) for o in found.orders] == [("axis.phi", 5)]
    assert any(
        "5 periods per turn of axis.phi" in words for words in localization_words.located(found.to_json())["regimes"]
    )


def test_an_effect_that_sets_in_is_dated_and_no_input_is_blamed() -> None:
    found = located({"axis.cogging.A": 0.02, "axis.cogging.n": 1.0}, {"axis.cogging.A": 2.0})
    onsets = [c for c in found.changes if c.after > c.before and abs(c.time - 2.0) < 0.2]
    assert [c.recording for c in onsets if not c.driven] == ["run1"]  # in run0 the input never rests
    assert {c.recording for c in onsets} == {"run0", "run1"}


def test_a_change_at_a_step_of_the_input_is_said_to_be_driven() -> None:
    at_steps = [c for c in located({"axis.windage.c": 8e-5}).changes if c.recording == "run1" and c.time > 2.7]
    assert at_steps
    assert all(c.driven for c in at_steps if min(abs(c.time - 3.0), abs(c.time - 4.5)) < 0.2)


def test_a_diagnosis_says_where_before_it_names() -> None:
    said: list[str] = []
    content = json.loads(json.dumps(spoken(diagnose_plant(campaign(COGGING), Axis(), progress=said.append).to_json())))
    assert said.index("locating the difference") < next(k for k, s in enumerate(said) if s.startswith("round 1"))
    assert content["located"]["orders"][0]["order"] == 5
    assert {"components", "isolability", "regimes", "change_points", "words"} <= set(content["located"])
    where = content["findings"][0]["where"]
    assert {"recording", "regime", "by_regime"} <= set(where)
