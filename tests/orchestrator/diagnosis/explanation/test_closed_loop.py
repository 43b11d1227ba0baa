"""A formula goes by the motion that it leads to once it is a unit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.diagnosis.anchored.search import Search
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.drafts.chain import chain, with_data_sheet
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem, Run
from cobot_joint.diagnosis.explanation.beyond_the_list import BeyondTheList
from cobot_joint.diagnosis.explanation.closed_loop import chi2_in_closed_loop
from cobot_joint.diagnosis.explanation.waves import repeats, without_waves
from cobot_joint.diagnosis.findings import Estimate, Feature, Finding, Form
from cobot_joint.diagnosis.plant.correction import Factor, Product, formula_parameters
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.repair.export import Correction, with_correction
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled
from cobot_joint.system.model import Inputs, System

DRAG, NOISE = -2e-4, 0.01  # N.m.s3/rad3, rad/s
T = np.arange(0, 4, 1e-3)


def drag(found: float) -> Finding:
    feature = Feature(Product((Factor("w", "u3"),)), Estimate(found, "N.m", (found, found)))
    shape = Form("load.tau_add", "N.m", ("load.w",), (feature,), 0.99)
    return Finding("load.unlisted", (), 0.9, None, {}, {}, 1e4, shape=shape)


def recorded(system: System, folder: Path) -> Recording:
    """The load with a cubic drag, driven to some 10 rad/s."""
    parameters, signals = formula_parameters([(DRAG, "w^3")])
    own = tuple(f"load.{signal}" for signal in signals)
    dragged = with_correction(system, Correction("drag", "load.tau_add", own, parameters), folder)
    tau = 0.4 * np.sin(2 * T)
    with Simulation(dragged) as simulation:
        run = simulation.run(Experiment(Inputs(T, {"tau": tau}), float(T[-1]), record=["w_load"])).signals
    w = run["w_load"] + np.random.default_rng(2).normal(0, NOISE, len(T))
    units = {"tau": "N.m", "w_load": "rad/s"}
    return Recording("run", "train", "", T, {"tau": tau}, {"w_load": w}, units)


@pytest.mark.parametrize(("size", "holds"), [(DRAG, True), (3 * DRAG, False)])
def test_a_formula_that_leaves_more_than_listed_terms_do_by_its_own_motion_is_no_answer(
    size: float, holds: bool, tmp_path: Path
) -> None:
    system = with_data_sheet(chain(["load"]), {"load.J": "0.02 kg.m2", "load.d": "0.01 N.m.s/rad"}).system
    recording = recorded(system, tmp_path)
    systems = {"": system, "without it": chain(["pendulum"]).system}
    sine = np.sin(2 * T)
    units = {"tau": "N.m", "phi_load": "rad"}
    other = Recording("other", "train", "without it", T, {"tau": sine}, {"phi_load": np.full(len(T), np.nan)}, units)
    case = cast(Campaign, SimpleNamespace(systems=lambda: systems))
    with FmuPlant(systems) as plant:
        problem = Problem(plant, [recording, other], {"w_load": Noise(NOISE), "phi_load": Noise(1.0)})
        (run,) = problem.simulate([Run()])
        assert run is not None
        hypothesis = Hypothesis(tolerances(problem, {"load.body.J": (0.018, 0.022)}))
        base = Fit(hypothesis, np.zeros(1), 0.0, run.white, run, np.zeros((problem.rows, 1)), 0)
        formula = Unmodelled(base, [], drag(size), 0.99)
        left = chi2_in_closed_loop(problem, systems, formula)
        assert left is not None
        assert (left < 1.2 * problem.samples) == holds
        told: list[str] = []
        listed = SimpleNamespace(selected=["load.windage"], fit=SimpleNamespace(chi2=2.0 * problem.samples))
        asked = SimpleNamespace(
            listed=listed, problem=problem, campaign=case, say=told.append, _is_lost=lambda found: False
        )
        assert BeyondTheList._fails_in_closed_loop(cast(BeyondTheList, asked), formula) is not holds
    assert bool(told) is not holds


def test_of_a_formula_over_an_angle_the_rest_has_to_hold_by_its_own_motion() -> None:
    """An axis with Stribeck friction was said to have a formula of an angle and of half its own friction, which made
    its speed twice as wrong."""
    features = [Factor("phi", "sin", 17.0)], [Factor("w", "tanh", 0.2)], [Factor("w", "u"), Factor("phi", "cos", 2.0)]
    drawn = tuple(Feature(Product(tuple(f)), Estimate(0.1, "N.m", (0.1, 0.1))) for f in features)
    finding = drag(DRAG)
    assert finding.shape is not None
    both = Unmodelled(cast(Fit, None), [], replace(finding, shape=replace(finding.shape, features=drawn)), 0.9)
    rest = without_waves(both)
    assert rest is not None
    assert rest.finding.shape is not None
    assert rest.finding.shape.features == drawn[1:2]
    waves = replace(finding, shape=replace(finding.shape, features=drawn[:1]))
    assert without_waves(Unmodelled(cast(Fit, None), [], waves, 0.9)) is None


@pytest.mark.parametrize(
    ("forms", "same"),
    [
        ([[Factor("phi", "sin", 6.0)], [Factor("phi", "cos", 6.0)]], True),
        ([[Factor("phi", "sin", 6.0)], [Factor("phi", "cos", 7.0)]], False),
        ([[Factor("phi", "sin", 6.0)], [Factor("w", "u")]], False),
        ([[Factor("phi", "sin", 6.0), Factor("w", "tanh", 0.001)]], False),
    ],
)
def test_a_wave_that_the_motion_has_named_is_not_said_once_more_as_a_formula(
    forms: list[list[Factor]], same: bool
) -> None:
    """field/open case04: cogging of order 6, 97 %, and a formula of order 6 at the same motor, 95 %."""
    finding = drag(DRAG)
    assert finding.shape is not None
    features = tuple(Feature(Product(tuple(f)), Estimate(0.1, "N.m", (0.1, 0.1))) for f in forms)
    formula = Unmodelled(cast(Fit, None), [], replace(finding, shape=replace(finding.shape, features=features)), 0.9)
    named = {"load.cogging.n": Estimate(6.0, "1", (6.0, 6.0)), "other.cogging.n": Estimate(7.0, "1", (7.0, 7.0))}
    assert repeats(formula, cast(Search, SimpleNamespace(repaired=named))) == same


def test_loads_that_come_and_go_are_not_asked_to_hold_by_their_own_motion() -> None:
    """They have no formula."""
    loads = Unmodelled(cast(Fit, None), [], replace(drag(DRAG), shape=None), 0.9)
    asked = cast(BeyondTheList, SimpleNamespace(listed=SimpleNamespace(selected=["load.windage"])))
    assert not BeyondTheList._fails_in_closed_loop(asked, loads)
