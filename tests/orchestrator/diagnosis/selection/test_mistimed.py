"""A channel that is late beside a background, which no delay explains to the noise, is said to be."""

from __future__ import annotations

import numpy as np
import pytest

from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.engine import diagnose_plant
from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.estimation.problem import one_blas_thread
from cobot_joint.diagnosis.report.words import notes
from cobot_joint.diagnosis.selection.mistimed import held_inputs, look_for_mistiming, still_late
from cobot_joint.diagnosis.store import Store
from cobot_joint.diagnosis.thresholds import WITHHELD
from tests.orchestrator.diagnosis.axis import OFF, STEP, Axis, campaign

LATE = 3  # samples


def beside_a_background(late: int) -> Campaign:
    """Two runs of an axis that lacks something on no list, its speed stamped late by so many samples."""
    case = campaign(OFF, extra="cube")
    for r in case.recordings:
        t = r.time
        r.outputs["w"] = np.interp(t - late * STEP, t, r.outputs["w"])
    return case


def said(late: int) -> list[str]:
    with one_blas_thread():
        problem, base = calibrate(beside_a_background(late), Axis(), lambda words: None, Store(None))
        assert look_for_mistiming(problem, base) is None  # it does not take all that is left
        return still_late(problem, base, base)


def test_a_channel_that_is_late_beside_a_background_is_said_to_be() -> None:
    (words,) = said(LATE)
    assert words.startswith("w lags the re-fitted system by ")
    assert float(words.split()[6]) == pytest.approx(1e3 * LATE * STEP, rel=0.1)
    assert "w stamped late, u stamped early, a filter" in words


def test_a_background_alone_is_no_delay() -> None:
    assert said(0) == []


@pytest.mark.parametrize("hold", [True, False])
def test_an_input_that_leaves_less_if_it_is_held_is_told_of(hold: bool) -> None:
    case = campaign(OFF)
    for r in case.recordings:
        if hold:  # what the drive got was held, the log has its set values
            t, late = r.time, STEP / 2
            r.inputs["u"] = np.interp(t + late, t, r.inputs["u"])
    with one_blas_thread():
        problem, base = calibrate(case, Axis(), lambda words: None, Store(None))
        words = held_inputs(problem, base)
        for r in problem.recordings:
            r.held.add("u")
        assert held_inputs(problem, base) == []
    assert [w.split(":")[0] for w in words] == (["u"] if hold else [])
    assert not hold or "write hold = true in [channels]" in words[0]


def test_beside_a_background_an_input_that_leaves_more_if_it_is_held_is_not_told_of() -> None:
    """Three times as much was left, of which a re-fit took some: said was "133 % less" (field/open case02)."""
    with one_blas_thread():
        problem, base = calibrate(beside_a_background(0), Axis(), lambda words: None, Store(None))
        assert problem.unexplained(base.residual)
        assert held_inputs(problem, base) == []


@pytest.mark.long
def test_beside_a_channel_that_is_late_no_name_is_a_claim() -> None:
    found = diagnose_plant(beside_a_background(LATE), Axis())
    assert [words.split()[0] for words in found.mistimed] == ["w"]
    assert all(f.confidence <= WITHHELD for f in found.findings)
    assert found.mistimed[0] in notes(found.to_json())
