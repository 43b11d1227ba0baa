"""The advice names an experiment whose outcome it predicts."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import fit
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.experiments.discriminate import Bench, advise
from cobot_joint.diagnosis.experiments.excitation import experiments
from cobot_joint.diagnosis.findings import Finding
from cobot_joint.diagnosis.report.words import next_experiment
from cobot_joint.diagnosis.thresholds import SEPARATES
from tests.orchestrator.diagnosis.axis import NOISE, NOMINAL, TERMS, Axis, campaign

ASYMMETRY, WINDAGE = (next(t for t in TERMS if t.name == f"axis.{name}") for name in ("asymmetry", "windage"))


def found() -> tuple[Problem, Fit]:
    """An axis with friction that differs by direction, recorded in one direction: windage does as well."""
    case = campaign({"axis.asymmetry.tau_A": 4e-3})
    problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
    bounds = {name: t.bounds(NOMINAL[name]) for name, t in case.tolerances.items()}
    hypothesis = Hypothesis(tolerances(problem, bounds), (ActiveTerm(ASYMMETRY, {ASYMMETRY.amplitude: 4e-3}),))
    best = fit(problem, hypothesis)
    assert best is not None
    return problem, best


def test_no_experiment_has_a_parameter_beyond_the_end_of_its_range() -> None:
    """An efficiency that was fitted as 1 went to 1.0045, and a diagnosis of three minutes ended with an error."""
    problem, best = found()
    count = len(best.hypothesis.base)
    at_ends = replace(best, x=np.concatenate([np.ones(count), best.x[count:]]))
    bench = Bench(problem, at_ends, best.hypothesis.terms[0])
    for f, (moved, step) in zip(best.hypothesis.base, bench._moved(bench.without), strict=True):
        assert f.lower <= moved.values[f.parameter.name] < f.upper
        assert step < 0


def finding(*equivalent: str) -> Finding:
    return Finding(ASYMMETRY.name, equivalent, 0.9, None, {}, {}, 1000.0)


def test_the_chi_square_by_which_an_experiment_separates_two_terms_is_what_a_fit_of_the_rival_leaves() -> None:
    problem, best = found()
    bench = Bench(problem, best, best.hypothesis.terms[0])
    apart = {name: chi2[""] for name, chi2 in bench.separations(WINDAGE).items()}
    name = max(apart, key=lambda name: apart[name])
    recording = next(r for r in experiments(problem.recordings) if r.name == name)
    recording.outputs.update({"w": Axis().simulate(best.run.values, recording)["w"]})
    done = Problem(Axis(), [recording], {"w": Noise(NOISE)})
    start = {n: best.run.values[n] for n in NOMINAL if n in best.run.values}
    free = tuple(
        replace(f, lower=start[f.parameter.name] - half, upper=start[f.parameter.name] + half)
        for f in best.hypothesis.base
        for half in [(f.upper - f.lower) / 2]
    )
    left = fit(done, Hypothesis(free, (ActiveTerm(WINDAGE, {WINDAGE.amplitude: 1e-6}),)))
    assert left is not None
    assert 0.3 < left.cost / apart[name] < 3


def test_the_advice_says_which_experiment_and_by_how_much_it_separates() -> None:
    problem, best = found()
    (advice,) = advise(problem, [finding(WINDAGE.name)], best)
    assert advice.terms == (ASYMMETRY.name, WINDAGE.name)
    assert advice.experiment in {r.name for r in experiments(problem.recordings)}
    assert advice.chi2 is not None
    assert advice.chi2 >= SEPARATES
    assert f"{ASYMMETRY.name} or {WINDAGE.name}: {advice.experiment}" in str(next_experiment([asdict(advice)]))


def test_terms_of_one_name_on_a_shaft_want_it_uncoupled_whatever_is_done_to_it() -> None:
    problem, best = found()
    (advice,) = advise(problem, [finding("gear.asymmetry")], best)
    assert advice.uncouple == "axis"
    assert advice.chi2 is None
    assert "run axis uncoupled, driven as before" in str(next_experiment([asdict(advice)]))


def test_a_finding_that_stands_alone_needs_no_experiment() -> None:
    problem, best = found()
    assert advise(problem, [finding()], best) == []


def test_candidates_stay_inside_what_was_driven_and_begin_at_rest() -> None:
    problem, _ = found()
    largest = max(float(np.max(np.abs(r.inputs["u"]))) for r in problem.recordings)
    candidates = experiments(problem.recordings)
    assert len({r.name for r in candidates}) == len(candidates)
    for r in candidates:
        assert np.max(np.abs(r.inputs["u"])) <= largest * (1 + 1e-12)
        assert r.inputs["u"][0] == 0
