"""Latent forces of the bench as they were put in."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.drafts.chain import chain
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.state_estimation.estimator import Smoothed, StateEstimator, Tracked
from cobot_joint.diagnosis.state_estimation.latents import Structure, structure, with_sizes
from cobot_joint.diagnosis.state_estimation.noise import ChannelNoise
from cobot_joint.diagnosis.state_estimation.sampled import SampledSystem
from tests.orchestrator.diagnosis.state_estimation.rig import NOISE, SIGMA, bench, clock, recorded, run


@pytest.fixture
def sampled() -> Iterator[SampledSystem]:
    with SampledSystem(bench()[0], list(SIGMA)) as found:
        yield found


def smoothed(sampled: SampledSystem, recording: Recording) -> tuple[Structure, Tracked, Smoothed]:
    known = structure(sampled, sampled.free(recording), bench()[1], NOISE)
    estimator = StateEstimator(sampled, NOISE, known.latents, known.followed, known.reached)
    tracked = estimator.track(recording)
    estimator = with_sizes(estimator, tracked)
    tracked = estimator.refilter(tracked)
    return known, tracked, estimator.smooth(tracked)


def port(known: Structure, name: str) -> int:
    return [latent.port for latent in known.latents].index(name)


def test_ports_that_the_channels_cannot_tell_apart_are_one(sampled: SampledSystem) -> None:
    known = structure(sampled, sampled.free(recorded(run())), bench()[1], NOISE)
    assert known.alike["motor_bldc.tau_add"] == ("planetary_gear.tau_add",)
    assert "torque_sensor.y_add" in known.alike
    assert "motor_bldc.v_add" in known.alike


def test_innovations_of_a_healthy_bench_are_white_and_of_unit_variance(sampled: SampledSystem) -> None:
    _, tracked, _ = smoothed(sampled, recorded(run()))
    white = tracked.filtered.white[100:]
    assert np.std(white, axis=0) == pytest.approx(np.ones(3), abs=0.04)
    after = np.sum(white[1:] * white[:-1], axis=0) / np.sum(white**2, axis=0)
    assert np.all(np.abs(after) < 0.06)


def test_a_push_at_the_pulley_is_found_there_and_then(sampled: SampledSystem) -> None:
    push = 2.0 * ((clock() > 1.0) & (clock() < 1.4))
    known, tracked, found = smoothed(sampled, recorded(run(added={"mr_brake_belt.tau_add": push})))
    d = found.d[:, port(known, "mr_brake_belt.tau_add")]
    inside = (tracked.time > 1.1) & (tracked.time < 1.3)
    outside = (tracked.time < 0.9) | (tracked.time > 1.5)
    assert np.mean(d[inside]) == pytest.approx(2.0, abs=0.05)
    assert np.std(d[outside]) < 0.1


def test_halved_viscous_friction_is_a_line_over_speed(sampled: SampledSystem) -> None:
    known, tracked, found = smoothed(sampled, recorded(run({"planetary_gear.friction.d": 1.05e-5 / 2})))
    w = tracked.signals["motor_bldc.w"]
    d = found.d[:, port(known, "motor_bldc.tau_add")]
    fast = np.abs(w) > 50
    assert np.sum((d * w)[fast]) / np.sum((w * w)[fast]) == pytest.approx(1.05e-5 / 2, rel=0.1)


def test_a_gap_is_passed_over_and_widens_the_band(sampled: SampledSystem) -> None:
    whole = recorded(run())
    lost = (clock() > 1.2) & (clock() < 1.4)
    outputs = {name: np.where(lost, np.nan, y) for name, y in whole.outputs.items()}
    recording = Recording("run", "train", "loaded", whole.time, whole.inputs, outputs, {})
    known = structure(sampled, sampled.free(recording), bench()[1], NOISE)
    estimator = StateEstimator(sampled, NOISE, known.latents, known.followed, known.reached)
    tracked = estimator.track(recording)
    found = estimator.smooth(tracked)
    assert np.all(np.isfinite(found.x))
    assert np.all(np.isfinite(found.d))
    prior = np.array([latent.sigma for latent in known.latents])
    assert np.all(found.d_sigma[1300] > 0.95 * prior)
    assert np.all(found.d_sigma[1000] < 0.95 * prior)
    assert np.all(tracked.filtered.e[lost] == 0)


def test_the_angle_of_a_motor_of_which_the_speed_alone_is_recorded_is_followed_all_the_same() -> None:
    """A wave that is off goes by it, and nothing that is on. It had been simulated from segment to segment, and was
    0.3 rad off by a torque that no model knew, here, and 88 rad on a turntable that sticks."""
    time = clock(9.0)
    driven = {"v_command": 4 * np.sin(2 * np.pi * time / 1.7)}
    push = {"motor.tau_add": 4e-3 * np.sign(np.sin(2 * np.pi * time / 0.9))}
    with FmuPlant({"": chain(["motor"]).system}) as plant:
        system = plant.systems[""]
        with SampledSystem(system, ["w_motor"]) as sampled:
            truth = sampled.run(sampled.start({}), time, {**driven, **push})
            w = truth.y[:, 0] + np.random.default_rng(1).normal(0, 0.1, len(time))
            recording = Recording("run", "train", "", time, driven, {"w_motor": w}, {})
            noise = {"w_motor": ChannelNoise(0.1)}
            known = structure(sampled, sampled.free(recording), ["motor.tau_add"], noise)
            estimator = StateEstimator(sampled, noise, known.latents, known.followed, known.reached)
            tracked = estimator.track(recording)
    off = tracked.signals["motor.phi"] - truth.signals["motor.phi"]
    assert np.ptp(truth.signals["motor.phi"]) > 50
    assert np.abs(off).max() < 0.2
