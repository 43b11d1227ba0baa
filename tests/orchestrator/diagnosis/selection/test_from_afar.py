"""What rings out of step is found at its size, not where a sensitivity at zero points to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cobot_joint.diagnosis.candidates.columns import Column
from cobot_joint.diagnosis.candidates.score_test import SEGMENTS
from cobot_joint.diagnosis.estimation.effects import ActiveTerm, BaseParameter
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import fit, fit_added
from cobot_joint.diagnosis.estimation.multiscale import slow_part
from cobot_joint.diagnosis.estimation.problem import Problem, Run
from cobot_joint.diagnosis.plant.plant import TermCandidate
from cobot_joint.diagnosis.selection.competition import finished
from cobot_joint.diagnosis.selection.from_afar import NEAR, SIZES, _leading, _nearby, look_from_afar
from tests.orchestrator.diagnosis.axis import NOMINAL, TERMS, campaign
from tests.orchestrator.diagnosis.estimation.test_multiscale import DECAY, LATE, PRECISION, stop
from tests.orchestrator.diagnosis.selection.test_stepwise import refitted

TRUE = 0.08  # s: three periods of the ringing
TERM = TermCandidate("stop.late", LATE.name, 0.0, 0.0, 0.5, "s", (), None)


def beside_the_base_model(late: float) -> tuple[Problem, Fit, Column]:
    """A stop that is met so late, what a re-fit without that makes of it, and the response to a little of it."""
    problem = stop(late)
    best = fit(problem, Hypothesis((BaseParameter(DECAY, 1.0, 16.0),)), precision=PRECISION)
    assert best is not None
    little = problem.simulate([Run({**best.run.values, LATE.name: 1e-4})])[0]
    assert little is not None
    return problem, best, Column(TERM, {}, ((little.white - best.simulated.white) / 1e-4,))


def test_a_stop_that_is_met_three_periods_late_is_found_where_it_is() -> None:
    problem, best, column = beside_the_base_model(TRUE)
    near = fit_added(problem, best, [ActiveTerm(TERM, {LATE.name: 1e-3})], finished(2))
    assert near is not None
    assert near.run.values[LATE.name] != pytest.approx(TRUE, abs=0.01)  # the nearest minimum
    found = look_from_afar(problem, best, [column])
    assert found["stop.late"].run.values[LATE.name] == pytest.approx(TRUE, abs=1e-4)
    assert not problem.unexplained(found["stop.late"].residual)


def test_a_term_that_helps_at_no_size_is_simulated_and_not_fitted() -> None:
    problem, best, column = beside_the_base_model(TRUE)
    other = replace(TERM, name="stop.other", amplitude="stop.other")  # does nothing
    before = problem.runs
    assert look_from_afar(problem, best, [replace(column, term=other)]) == {}
    assert 0 < problem.runs - before <= 2 * len(SIZES)


def test_where_a_term_is_larger_than_its_bounds_before_it_shows_parts_of_its_bounds_are_tried() -> None:
    """A gear that gives way, 11 times the background, has -0.6e6; its sensitivity asked for -12e6 (machine 157/18)."""
    problem, best, column = beside_the_base_model(TRUE)
    faint = replace(column, vectors=(1e-6 * column.vectors[0],))
    assert look_from_afar(problem, best, [faint])["stop.late"].run.values[LATE.name] == pytest.approx(TRUE, abs=1e-4)


def test_parts_of_the_bound_on_one_side_are_tried_where_the_other_is_far() -> None:
    """Its stiffness may be 1e9 more and 1e7 less; of 105 times the background it had -0.17e6 (machine 163/21)."""
    problem, best, column = beside_the_base_model(TRUE)
    one_sided = replace(column, term=replace(TERM, lower=-1e9), vectors=(1e-6 * column.vectors[0],))
    found = look_from_afar(problem, best, [one_sided])
    assert found["stop.late"].run.values[LATE.name] == pytest.approx(TRUE, abs=1e-4)


def test_of_onsets_near_one_that_another_term_has_the_best_is_taken() -> None:
    """A belt that creeps from 4.141 s on; a brake that fades from 4.089 s on had been fitted (machine 163/53)."""
    problem, _ = refitted(campaign({"axis.windage.c": 2e-4}, onsets={"axis.windage.c": 2.6}))
    bounds = {name: (value, value * (1 + 1e-9)) for name, value in NOMINAL.items()}  # all else is known
    known = fit(problem, Hypothesis(tolerances(problem, bounds)))
    slow = slow_part(problem)
    assert known is not None
    assert slow is not None
    windage = next(t for t in TERMS if t.name == "axis.windage")
    segment = problem.times().max() / SEGMENTS
    begun = ActiveTerm(windage, {"axis.windage.c": 2e-4}, 2.5)
    ((found, left),) = _leading(slow, known, _nearby([(begun, 0.0)], [2.5 + part * segment for part in NEAR]))
    assert found.onset == pytest.approx(2.6, abs=segment / 32)
    assert left < 0.01 * np.sum(slow.seen(known.residual) ** 2)
