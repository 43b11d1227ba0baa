"""Forms that set in during the runs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.estimation.port_response import Choice
from cobot_joint.diagnosis.selection.unlisted import late_onset
from cobot_joint.diagnosis.selection.unlisted.late_onset import look_late
from cobot_joint.diagnosis.selection.unlisted.places import pointed_to
from cobot_joint.diagnosis.store import Store
from tests.orchestrator.diagnosis.axis import Axis, concealed


def test_no_onset_is_simulated_where_none_takes_what_it_has_to() -> None:
    problem, calibrated = calibrate(concealed(lambda w, phi: -1e-7 * w**3), Axis(), lambda words: None, Store(None))
    (place,) = pointed_to(problem, calibrated, 0.0)
    before = problem.runs
    assert look_late(problem, calibrated, place.columns, 10 * problem.above(calibrated.residual)) is None
    assert problem.runs == before
    assert look_late(problem, calibrated, place.columns) is not None


def test_what_takes_most_from_the_start_has_no_onset(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rotary table's drag was tried at eight onsets before the run's beginning."""
    problem, calibrated = calibrate(concealed(lambda w, phi: -1e-7 * w**3), Axis(), lambda words: None, Store(None))
    (place,) = pointed_to(problem, calibrated, 0.0)
    asked: list[float] = []

    def earlier_takes_more(*given: Any) -> tuple[float, list[float], list[Any]]:
        asked.append(given[-1])
        return 1.0 - given[-1], [1.0], list(place.columns[:1])

    monkeypatch.setattr(late_onset, "_from", earlier_takes_more)
    monkeypatch.setattr(late_onset, "forward", lambda problem, start, late: Choice(tuple(late[:1]), np.ones(1), 1.0))
    assert look_late(problem, calibrated, place.columns) is None
    assert len(asked) == 9
