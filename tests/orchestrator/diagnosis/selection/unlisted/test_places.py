"""Ports, and what the choices of forms there are expected to leave."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cobot_joint.diagnosis.candidates.formulas import Dictionary
from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.estimation.port_response import Column, refit
from cobot_joint.diagnosis.plant.correction import Product
from cobot_joint.diagnosis.plant.plant import Port
from cobot_joint.diagnosis.selection.selection import Selection
from cobot_joint.diagnosis.selection.unlisted import places
from cobot_joint.diagnosis.selection.unlisted.held_against import look_for_unmodelled
from cobot_joint.diagnosis.store import Store
from tests.orchestrator.diagnosis.axis import SAMPLES, STEP, Axis, concealed


def test_what_a_choice_beside_forms_that_were_fitted_is_expected_to_leave_is_what_a_fit_of_it_leaves() -> None:
    """Without the signal, base parameters are where they were beside it: what they would take is not the choice's."""
    problem, calibrated = calibrate(concealed(lambda w, phi: -1e-7 * w**3), Axis(), lambda words: None, Store(None))
    (place,) = places.pointed_to(problem, calibrated, 0.0)
    assert place.choice is not None
    fitted = refit(problem, calibrated, place.choice)
    assert fitted is not None
    place.look_closer(problem, calibrated, fitted)
    assert place.at is not None
    again = refit(problem, place.at, place.choice)
    assert again is not None
    leaves, nothing = places.expected_to_leave(problem, calibrated, [place]), problem.above(place.at.residual)
    assert leaves - problem.above(again.residual) == pytest.approx(0.0, abs=1e-3 * nothing)
    assert nothing > 10 * problem.above(calibrated.residual)


def test_of_a_torque_and_a_force_that_do_the_same_to_a_load_the_torque_is_named() -> None:
    one = np.array([1.0, 2.0, 3.0])
    force, torque, other = (Port("load.F_add", "N", ()), Port("load.tau_add", "N.m", ()), Port("motor.v_add", "V", ()))
    every: Any = [
        SimpleNamespace(port=port, columns=[Column(port, Product(), {}, size * one)])
        for port, size in ((force, 1.0), (torque, 2.0), (other, 3.0))
    ]
    assert [place.port for place in places._distinguishable(every)] == [torque, other]


def test_where_no_form_does_in_one_recording_the_others_are_not_simulated() -> None:
    t = np.arange(SAMPLES) * STEP
    case = concealed(lambda w, phi: 2e-3 * np.sin(9 * t) + 2e-3 * np.sin(14 * t + 1))
    problem, calibrated = calibrate(case, Axis(), lambda words: None, Store(None))
    forms = len(Dictionary(problem, calibrated, Axis.ports[0]).first())
    before = problem.runs
    assert len(problem.recordings) > 1
    assert look_for_unmodelled(problem, calibrated, Selection([calibrated]), lambda words: None, 0.8) is None
    assert problem.runs - before == forms
