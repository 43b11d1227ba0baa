"""A data sheet's value that is far off is found where resonances are out of step with every value near it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from cobot_joint.diagnosis import engine
from cobot_joint.diagnosis.anchored.search import Named, Search
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.calibrate import calibrate
from cobot_joint.diagnosis.estimation.effects import FreeParameter
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import Precision, fit
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem, one_blas_thread
from cobot_joint.diagnosis.explanation.explanation import Explanation
from cobot_joint.diagnosis.findings import Estimate
from cobot_joint.diagnosis.plant.plant import Parameter, Signals
from cobot_joint.diagnosis.selection.selection import Selection
from cobot_joint.diagnosis.selection.tolerances.far_off import TIMES, values_from_afar
from cobot_joint.diagnosis.selection.tolerances.outside import leaves_least
from cobot_joint.diagnosis.store import Store
from tests.orchestrator.diagnosis.axis import Axis, campaign
from tests.orchestrator.diagnosis.estimation.test_multiscale import LATE, PRECISION, stop

STEP, SIGMA = 1e-3, 0.002
J_1, TAU, DECAY = 1.0, 1.0, 1.0
J_2, C = Parameter("load.J", 1.0, "kg.m2", 0.0, 100.0), Parameter("shaft.c", 4000.0, "N.m/rad", 1.0, 1e6)
TOLERANCES = {J_2.name: (0.9, 1.1), C.name: (3200.0, 4800.0)}


class TwoInertias:
    """A torque that changes its sign every half second turns an inertia, and through a spring a second one.

    Free two-inertia oscillator, closed form: every step of the torque gives the first a ramp of tau/(J_1 + J_2), and a
    ringing of c (J_1 + J_2)/(J_1 J_2) that decays.
    """

    terms = ports = inputs = ()

    def __init__(self) -> None:
        self.parameters = {p.name: p for p in (J_2, C)}

    def has(self, name: str, recording: Recording) -> bool:
        """Both inertias are in every run."""
        return True

    def simulate(self, values: Mapping[str, float], recording: Recording, **_: object) -> Signals:
        """See Plant.simulate."""
        j_2, c = (values.get(p.name, p.nominal) for p in (J_2, C))
        total = J_1 + j_2
        omega = np.sqrt(c * total / (J_1 * j_2))
        w = np.zeros(len(recording.time))
        for k in range(int(recording.time[-1] / 0.5)):
            t = np.maximum(recording.time - 0.5 * k, 0.0)
            step = TAU * (1 if k == 0 else 2) * (-1) ** k
            w += step / total * (t + j_2 / J_1 / omega * np.exp(-DECAY * t) * np.sin(omega * t))
        return {"w": w}


def with_a_load(times: float) -> tuple[Problem, Fit]:
    """A recording of that many times the load's inertia, and the model re-fitted inside its tolerances."""
    time = STEP * np.arange(4000)
    recording = Recording("run", "train", "default", time, {}, {"w": np.zeros(4000)}, {"w": "rad/s"})
    clean = TwoInertias().simulate({J_2.name: times}, recording)["w"]
    noise = np.random.default_rng(1).normal(0, SIGMA, 4000)
    problem = Problem(TwoInertias(), [replace(recording, outputs={"w": clean + noise})], {"w": Noise(SIGMA)}, jobs=1)
    calibrated = fit(problem, Hypothesis(tolerances(problem, TOLERANCES)), precision=Precision(jacobians=8))
    assert calibrated is not None
    return problem, calibrated


@pytest.mark.parametrize("times", [0.45, 1.8, 2.3])
def test_an_inertia_far_off_is_found_and_not_the_stiffness_that_imitates_it(times: float) -> None:
    problem, calibrated = with_a_load(times)
    assert problem.stands_out(calibrated.residual)
    found = leaves_least(problem, calibrated, 0.0)
    assert found is not None
    assert [e.name for e in found.hypothesis.effects if isinstance(e, FreeParameter)] == [J_2.name]
    assert found.run.values[J_2.name] == pytest.approx(times, rel=0.01)
    assert not problem.unexplained(found.residual)


def test_values_inside_the_tolerance_and_beyond_what_a_data_sheet_is_ever_off_are_not_simulated() -> None:
    problem, calibrated = with_a_load(2.3)
    before = problem.runs
    values = values_from_afar(problem, calibrated)
    assert 0 < problem.runs - before <= 2 * len(TIMES)
    assert values[0][0] == J_2.name
    assert all(not TOLERANCES[name][0] <= value <= TOLERANCES[name][1] for name, value in values)


def test_where_a_fit_leaves_no_more_than_noise_no_value_is_worth_a_fit() -> None:
    assert values_from_afar(*with_a_load(1.0)) == []


@pytest.mark.parametrize(("name", "value", "found"), [("axis.J", 1.3e-3, "axis.d"), ("axis.d", 8e-4, None)])
def test_a_parameter_that_the_motion_claims_gives_way_to_one_that_leaves_less_of_free_runs(
    name: str, value: float, found: str | None
) -> None:
    """A gear of a quarter of its stiffness was a brake's inertia, 93 % sure (machine 193/26)."""
    search = Search(named=[cast(Named, SimpleNamespace(name=name))], repaired={name: Estimate(value, "1", (0.0, 1.0))})
    with one_blas_thread():
        problem, base = calibrate(campaign({"axis.d": 8e-4}), Axis(), lambda words: None, Store(None))
        motion = Explanation(base, base, Selection([base]), [], anchored=search)
        instead = engine._far_off(problem, motion, lambda fit: Selection([fit]), lambda words: None)
    assert (instead.outside.name if instead and instead.outside else None) == found


@pytest.mark.parametrize("late", [0.015, 0.03])
def test_a_parameter_let_go_of_is_brought_out_of_a_local_minimum(late: float) -> None:
    """A brake's torque per ampere left ten times what it does at its place, and a channel's gain was the answer
    (machine 193/62)."""
    problem = stop(late)
    calibrated = fit(problem, Hypothesis(tolerances(problem, {LATE.name: (0.0, 0.004)})), precision=PRECISION)
    assert calibrated is not None
    found = leaves_least(problem, calibrated, 0.0)
    assert found is not None
    assert found.run.values[LATE.name] == pytest.approx(late, abs=1e-4)
