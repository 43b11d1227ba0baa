"""The whitened residual: what slow structure is left in it, and what was not recorded adds nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem, Run
from tests.orchestrator.diagnosis.axis import NOISE, Axis, campaign

TRUTH = {"axis.d": 1.9e-3}


def with_gap(share: float, seed: int = 1) -> Problem:
    """Healthy runs whose channel was not recorded for this share of the time."""
    case = campaign(TRUTH, seed=seed)
    for recording in case.recordings:
        y = recording.outputs["w"]
        y[: int(share * len(y))] = np.nan
    return Problem(Axis(), case.train, {"w": Noise(NOISE)})


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_gap_adds_nothing_to_the_excess(share: float) -> None:
    left = []
    for seed in range(1, 6):
        problem = with_gap(share, seed)
        residual = problem.recorded - problem.whiten([Axis().simulate(TRUTH, r) for r in problem.recordings])
        assert abs(problem.excess(residual)) < 4 * problem.excess_scatter
        assert not problem.unexplained(residual)
        left.append(problem.excess(residual) / problem.excess_scatter)
    assert abs(np.mean(left)) < 3 / np.sqrt(len(left))


@pytest.mark.parametrize("lost", ["single samples", "a stretch"])
@pytest.mark.parametrize("step", [0.0, 1.0], ids=["fine", "coarse"])
@pytest.mark.parametrize("colour", [0.0, 0.3, 0.6])
def test_coloured_noise_stays_white_across_gaps(colour: float, step: float, lost: str) -> None:
    rng, n = np.random.default_rng(4), 40_000
    noise, there = Noise(1.0, colour, step), 300 + 100 * np.sin(np.arange(n) / 500)
    first = 1 - step**2 / 12  # rounding has no colour
    gaps = rng.random(n) < 0.3 if lost == "single samples" else np.arange(n) % 1000 < 300
    w = np.where(gaps, np.nan, noise.on(there, rng))
    r = Recording("run", "train", "default", np.arange(n) * 1e-3, {}, {"w": w}, {"w": "rad/s"})
    problem = Problem(Axis(), [r], {"w": Noise(1.0, colour * first, step)})
    rest = problem.recorded - problem.whiten([{"w": there}])
    known = problem.blocks[0].weight > 0
    assert known.sum() == (~gaps).sum()
    assert rest @ rest / problem.samples == pytest.approx(1, abs=0.03)
    assert np.abs(rest).max() < 6
    assert abs(np.mean((rest[1:] * rest[:-1])[known[1:] & known[:-1]])) < 0.03


def test_the_excess_is_that_of_its_blocks_and_sees_slow_structure() -> None:
    problem = with_gap(0.3)
    residual = np.random.default_rng(2).standard_normal(problem.rows) + 0.5
    residual *= np.concatenate([b.weight for b in problem.blocks])
    by_block = problem.excess_by_block(residual)
    assert problem.excess(residual) == pytest.approx(sum(part.sum() for part in by_block))
    # a mean of 0.5 gives 16 samples a chi-square of 16 * 0.25 above their expectation
    assert problem.excess(residual) == pytest.approx(4 * problem.samples / 16, rel=0.15)
    assert problem.unexplained(residual)


def test_what_is_above_noise_is_what_is_slow_where_the_noise_is_said_to_be_larger_than_all_that_is_left() -> None:
    problem = with_gap(0.0)
    noise = np.random.default_rng(2).standard_normal(problem.rows)
    loud, quiet = 0.5 + noise, 0.5 + 0.3 * noise
    assert problem.above(loud) == pytest.approx(0.25 * problem.samples, rel=0.1)
    assert quiet @ quiet < problem.samples
    assert problem.above(quiet) == problem.excess(quiet) > 0
    assert problem.above(0 * noise) > 0  # shares of it are asked for


def test_signals_at_one_port_add_up() -> None:
    a, b = np.ones(3), np.array([0.0, 1.0, 2.0])
    run = Run().with_signals("axis.tau_add", {"run0": a}).with_signals("axis.tau_add", {"run0": b, "run1": b})
    assert run.added["run0"]["axis.tau_add"] == pytest.approx(a + b)
    assert run.added["run1"]["axis.tau_add"] == pytest.approx(b)


def test_noise_is_drawn_with_its_sigma_its_correlation_and_the_converters_steps() -> None:
    noise = Noise(5e-3, 0.8, 1e-3)
    y = noise.on(np.zeros(50_000), np.random.default_rng(2))
    assert np.std(y) == pytest.approx(5e-3, rel=0.05)
    assert np.mean(y[1:] * y[:-1]) / np.var(y) == pytest.approx(0.8, abs=0.03)
    assert np.allclose(np.mod(y / 1e-3 + 0.5, 1), 0.5)


def test_a_run_that_touches_nothing_of_a_recording_is_not_simulated_there() -> None:
    class Elsewhere(Axis):
        def has(self, name: str, recording) -> bool:  # type: ignore[no-untyped-def]
            return recording.name == "run0" or not name.startswith("sensor")

    case = campaign(TRUTH)
    problem = Problem(Elsewhere(), case.train, {"w": Noise(NOISE)})
    base = problem.simulate([Run(TRUTH)])[0]
    before = problem.runs
    found = problem.simulate([replace(Run({**TRUTH, "sensor.offset.y_0": 1.0}), touches=("sensor",))], base)[0]
    assert problem.runs - before == 1
    assert base is not None
    assert found is not None
    assert found.outputs[1] is base.outputs[1]


@pytest.mark.parametrize("step", [0.0, 1e-6, 1e-4, 1e-2, 0.5])
def test_the_filter_of_coloured_noise_in_fine_steps_is_that_of_the_noise_alone_and_then_some(step: float) -> None:
    sigma, colour = 0.576, 0.5
    rho, theta, e = Noise(sigma, colour, step).filter
    # (1 - rho B) y = (1 + theta B) e has the variance and the first covariance that it was made for (Ljung 1999, ch. 4)
    variance = e**2 * (1 + theta**2 + 2 * rho * theta) / (1 - rho**2)
    assert variance == pytest.approx(sigma**2, rel=1e-9)
    assert rho * variance + theta * e**2 == pytest.approx(colour * sigma**2, rel=1e-9)


def test_what_a_start_value_may_be_off_counts_as_if_it_were_fitted_with_its_own_uncertainty() -> None:
    """Beside a closed form: of residuals r the least of |r - e s|^2 + e^2 over e, s being what 1 sigma makes."""
    (case,) = campaign(TRUTH).train[:1]
    stray = {"w": 3 * NOISE * np.exp(-(case.time - case.time[0]) / 5)}
    problem = Problem(Axis(), [replace(case, strays=[stray])], {"w": Noise(NOISE)})
    plain = Problem(Axis(), [case], {"w": Noise(NOISE)})
    rng, s = np.random.default_rng(3), plain.whiten([stray])
    for e in (0.0, 1.0, -40.0):
        r = rng.standard_normal(plain.rows) + e * s
        fitted = (s @ r) / (1 + s @ s)
        least = np.sum((r - fitted * s) ** 2) + fitted**2
        seen = problem.whiten([{"w": NOISE * r}])
        assert seen @ seen == pytest.approx(least, rel=1e-9)
    assert plain.unexplained(rng.standard_normal(plain.rows) + s)
    assert not problem.unexplained(problem.whiten([{"w": NOISE * (rng.standard_normal(plain.rows) + s)}]))
