"""A listed term and a formula of which neither shows while the other is left out."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.candidates.scan import Scan
from cobot_joint.diagnosis.candidates.scan_ranges import driven
from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem, one_blas_thread
from cobot_joint.diagnosis.explanation.explanation import Explanation, answer
from cobot_joint.diagnosis.selection.selection import Selection
from cobot_joint.diagnosis.selection.stepwise import Selector
from cobot_joint.diagnosis.selection.tolerances.outside import Outside
from cobot_joint.diagnosis.selection.unlisted import together
from cobot_joint.diagnosis.selection.unlisted.together import Pair, look_together
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled, look_at_ports
from cobot_joint.diagnosis.store import Store
from tests.orchestrator.diagnosis.axis import (
    NOISE,
    NOMINAL,
    OFF,
    OFFSET,
    SAMPLES,
    TERMS,
    Axis,
    Driven,
    campaign,
    weak_drive,
)


def chosen(offset: float, given: bool = False) -> tuple[Problem, Selection, Unmodelled | None]:
    """Of an axis with eddy currents, strongest at 15 rad/s, whose speed is read with an offset. given: the best form
    alone is known."""
    values, rng = OFF | {"sensor.offset.y_0": offset}, np.random.default_rng(1)
    case, plant = campaign(OFF), Axis((*TERMS, OFFSET))
    for recording in case.recordings:
        clean = plant.simulate(values, recording)
        for _ in range(12):  # the drag follows the motion that it changes
            w = clean["axis.w"] / 15
            clean = plant.simulate(values, recording, added={"axis.tau_add": -0.05 * w / (1 + w**2)})
        recording.outputs["w"] = clean["w"] + rng.normal(0, NOISE, SAMPLES)
    with one_blas_thread():
        problem, base = calibrate(case, plant, lambda words: None, Store(None))
        scan = Scan(problem, driven(problem, base, plant.terms), lambda words: None)
        listed = Selector(problem, scan, lambda words: None).select(base)
        beside = Selector(problem, scan, lambda words: None)
        alone = look_at_ports(problem, base, [], lambda words: None) if given else None
        pair = look_together(problem, listed, alone, beside, lambda words: None)
        return problem, listed, pair.formula if isinstance(pair, Pair) else None


Chosen = tuple[Problem, Selection, Unmodelled]


@pytest.fixture(scope="module")
def both() -> Chosen:
    problem, listed, pair = chosen(offset=1.0)
    assert pair is not None
    return problem, listed, pair


def test_an_offset_beside_a_drag_on_no_list_is_found_where_listed_terms_alone_leave_most(both: Chosen) -> None:
    problem, listed, pair = both
    before, left = (problem.excess(fit.residual) for fit in (listed.history[0], listed.fit))
    assert "sensor.offset" not in [s.term for s in listed.selected]
    assert left > thresholds.HOLDS * before
    assert [s.term for s in pair.selected] == ["sensor.offset"]
    assert pair.fit.run.values["sensor.offset.y_0"] == pytest.approx(1.0, abs=0.05)
    assert pair.finding.shape is not None
    assert [str(f.form) for f in pair.finding.shape.features] == ["eddy(w/18)"]
    assert problem.excess(pair.fit.residual) < 0.01 * before


@pytest.mark.parametrize("table", [False, True])
def test_a_term_beside_a_formula_or_a_table_is_as_sure_as_what_both_leave_says(both: Chosen, table: bool) -> None:
    """Belt creep beside a drag on no list (machine 83/41) had 0.42, by what listed terms leave without the drag."""
    problem, listed, pair = both
    shape = pair.finding.shape
    assert shape is not None
    shape = replace(shape, features=(), table=(np.zeros(2), np.zeros(2))) if table else shape
    pair = replace(pair, finding=replace(pair.finding, shape=shape))
    found = answer(problem, Explanation(listed.history[0], pair.fit, listed, pair.selected, pair)).findings
    assert {f.term: f.confidence >= thresholds.EVEN for f in found} == {"axis.unlisted": True, "sensor.offset": True}


@pytest.mark.parametrize("given", [False, True])
def test_no_listed_term_is_said_beside_a_drag_that_needs_none(given: bool) -> None:
    assert chosen(offset=0.0, given=given)[2] is None


def test_no_pair_replaces_a_form_that_does_a_third_as_well_alone() -> None:
    """The best form alone leaves twice what the pair does: a drag and a decay over the time."""
    assert chosen(offset=1.0, given=True)[2] is None


def beside_weak_drive(**effects: float) -> tuple[Problem, Fit, Pair | Outside | None]:
    """What a form at a port and a drive's torque constant of 0.7 are found to be together."""
    case, plant = weak_drive(**effects), Driven()
    with one_blas_thread():
        problem, base = calibrate(case, plant, lambda words: None, Store(None))
        scan = Scan(problem, driven(problem, base, plant.terms), lambda words: None)
        beside = Selector(problem, scan, lambda words: None)
        return problem, base, look_together(problem, Selection([base]), None, beside, lambda words: None)


def test_a_parameter_outside_its_tolerance_and_a_drag_on_no_list_are_chosen_together() -> None:
    """A rotor's inertia and a brake's rough places (machine 127/9), 8 times the background: the latter were missed."""
    problem, base, pair = beside_weak_drive(eddy_currents=0.05)
    assert isinstance(pair, Pair)
    assert pair.outside is not None
    assert pair.outside.name == "drive.k"
    assert pair.outside.confidence(problem) > 0.9
    assert pair.formula.fit.run.values["drive.k"] == pytest.approx(0.7 * NOMINAL["axis.k"], rel=0.02)
    found = answer(
        problem, Explanation(base, pair.formula.fit, Selection([base]), [], pair.formula, outside=pair.outside)
    )
    assert {f.term for f in found.findings} == {"drive.k", "axis.unlisted"}


def test_a_listed_term_that_does_as_well_as_a_form_beside_a_parameter_is_the_answer() -> None:
    """A sensor's offset beside a motor's torque constant was a constant on no list, 95 % (machine 227/26)."""
    problem, _, found = beside_weak_drive(windage=2e-4)
    assert isinstance(found, Outside)
    assert found.name == "drive.k"
    assert [s.term for s in found.selection.selected] == ["axis.windage"]
    assert found.confidence(problem) > 0.9
    assert found.fit.run.values["axis.windage.c"] == pytest.approx(2e-4, rel=0.1)
    assert not problem.unexplained(found.fit.residual)


@pytest.mark.parametrize(
    ("alone", "forms", "with_it", "too_little"),
    [
        pytest.param(True, 0.063, 0.052, True, id="an elbow with gravity, and a motor that warms up"),
        pytest.param(True, 0.063, 0.021, False, id="what takes two thirds"),
        pytest.param(False, 0.325, 0.194, False, id="machine 83/13, hysteresis beside a drag"),
        pytest.param(False, 0.567, 0.293, False, id="machine 83/41, creep beside a drag"),
        pytest.param(False, 0.9, 0.6, True, id="both leave most"),
    ],
)
def test_no_other_forms_are_sought_beside_what_takes_too_little_for_a_pair(
    monkeypatch: pytest.MonkeyPatch, alone: bool, forms: float, with_it: float, too_little: bool
) -> None:
    """The search takes hundreds of simulations."""
    left = {"base": 1.0, "forms": forms, "both": with_it}
    monkeypatch.setattr(together, "remains", lambda problem, *fits: [left[fit] for fit in fits])
    listed: Any = SimpleNamespace(history=["base"])
    nothing: Any = None
    start: Any = "forms"
    both: Any = "both"
    assert together._too_little(nothing, listed, start, both, alone) == too_little
