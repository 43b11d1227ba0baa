"""What rings out of step is found at its size, not where a sensitivity at zero points to."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cobot_joint.diagnosis.candidates.score_test import Column
from cobot_joint.diagnosis.estimation.effects import ActiveTerm, BaseParameter
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.least_squares import fit, fit_added
from cobot_joint.diagnosis.estimation.problem import Problem, Run
from cobot_joint.diagnosis.plant.plant import TermCandidate
from cobot_joint.diagnosis.selection.competition import finished
from cobot_joint.diagnosis.selection.from_afar import SIZES, look_from_afar
from tests.orchestrator.diagnosis.estimation.test_multiscale import DECAY, LATE, PRECISION, stop

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
    """A gear that gives way, 11 times the background, has -0.6e6; its sensitivity asked for -12e6 (157, 18)."""
    problem, best, column = beside_the_base_model(TRUE)
    faint = replace(column, vectors=(1e-6 * column.vectors[0],))
    assert look_from_afar(problem, best, [faint])["stop.late"].run.values[LATE.name] == pytest.approx(TRUE, abs=1e-4)
