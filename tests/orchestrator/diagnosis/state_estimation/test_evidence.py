"""A switched-off term is seen beside latent forces, with its amplitude, and nothing is where nothing is."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack

import numpy as np
import pytest

from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.state_estimation.discrepancy import PortDiscrepancy, discrepancies
from cobot_joint.diagnosis.state_estimation.estimator import StateEstimator
from cobot_joint.diagnosis.state_estimation.evidence import Evidence, Tracking
from cobot_joint.diagnosis.state_estimation.latents import structure, with_sizes
from cobot_joint.diagnosis.state_estimation.pictures import picture
from cobot_joint.diagnosis.state_estimation.sampled import SampledSystem
from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.state_estimation.rig import COGGING, NOISE, SIGMA, bench, clock, recorded, run

PLANT = FmuPlant({"loaded": load_system("joint_logged")})
TOLERANCES = {
    "motor_bldc.winding.R": (0.0, 0.006),
    "motor_bldc.friction.d": (0.0, 1e-6),
    "planetary_gear.mesh.eta": (0.0, 0.03),
}


def tracking(
    stack: ExitStack, values: Mapping[str, float], added: Mapping[str, np.ndarray] | None = None
) -> tuple[Tracking, dict[str, tuple[str, ...]]]:
    sampled = stack.enter_context(SampledSystem(bench()[0], list(SIGMA)))
    recording = recorded(run(values, added))
    known = structure(sampled, sampled.free(recording), bench()[1], NOISE)
    estimator = StateEstimator(sampled, NOISE, known.latents, known.followed)
    tracked = estimator.track(recording)
    estimator = with_sizes(estimator, tracked)
    return Tracking(estimator, estimator.refilter(tracked)), dict(known.alike)


@pytest.fixture
def stack() -> ExitStack:
    with ExitStack() as found:
        yield found


def test_a_term_outranks_its_rivals_and_has_its_amplitude(stack: ExitStack) -> None:
    values = {"mr_brake_belt.pulley_eccentricity.A": 0.03, "mr_brake_belt.pulley_eccentricity.phi_0": 1.0}
    found, _ = tracking(stack, values | {"motor_bldc.winding.R": 0.209 * 1.02})
    some = {"pulley_eccentricity", "imbalance", "stribeck", "windage", "gain", "offset", "load_friction"}
    terms = [t for t in PLANT.terms if t.name.split(".")[1] in some]
    evidence = Evidence([found], TOLERANCES)
    best = evidence.score(terms, refined=2)[0]
    assert best.term == "mr_brake_belt.pulley_eccentricity"
    assert best.amplitude == pytest.approx(0.03, rel=0.15)
    assert best.phase == pytest.approx(1.0, abs=0.15)
    assert best.evidence is not None
    assert best.evidence > 100


def test_a_healthy_machine_gives_no_term_evidence(stack: ExitStack) -> None:
    found, _ = tracking(stack, {"motor_bldc.winding.R": 0.209 * 1.02})
    terms = [
        t for t in PLANT.terms if t.name.split(".")[1] in {"imbalance", "windage", "gain", "offset", "load_friction"}
    ]
    scores = Evidence([found], TOLERANCES).score(terms, refined=3)
    assert all(s.evidence is None or s.evidence < 5 for s in scores)


def test_a_base_parameter_that_is_off_is_seen_off(stack: ExitStack) -> None:
    found, _ = tracking(stack, {"motor_bldc.winding.R": 0.209 * 1.02})
    off = Evidence([found], TOLERANCES).corrections["motor_bldc.winding.R"]
    assert off == pytest.approx(0.02 * 0.209, abs=0.0015)


def port(found: list[PortDiscrepancy], name: str) -> PortDiscrepancy:
    return next(d for d in found if d.port == name)


def test_cogging_is_an_order_of_the_rotor_angle_of_its_own_amplitude(stack: ExitStack) -> None:
    one, alike = tracking(stack, COGGING)
    torque = port(discrepancies(one, PLANT.ports, alike), "motor_bldc.tau_add")
    spectrum = torque.spectra[0]
    assert spectrum.signal == "motor_bldc.phi"
    assert spectrum.peaks[0].order == pytest.approx(6.0, abs=0.03)
    assert spectrum.peaks[0].amplitude == pytest.approx(5e-3, rel=0.1)
    assert torque.alike == ("planetary_gear.tau_add",)


def test_a_slow_course_is_no_period_of_an_angle_and_hides_none(stack: ExitStack) -> None:
    """A drift of 4 mN.m beside 5 mN.m of cogging."""
    drift = {"motor_bldc.tau_add": 4e-3 * np.sin(2 * np.pi * 0.4 * clock())}
    one, alike = tracking(stack, COGGING, drift)
    spectrum = port(discrepancies(one, PLANT.ports, alike), "motor_bldc.tau_add").spectra[0]
    assert spectrum.orders.min() >= 1
    assert spectrum.orders[np.argmax(spectrum.amplitude)] == pytest.approx(6.0, abs=0.03)
    assert spectrum.peaks[0].order == pytest.approx(6.0, abs=0.03)
    assert spectrum.peaks[0].amplitude == pytest.approx(5e-3, rel=0.1)


def test_friction_that_is_off_is_a_curve_over_speed_and_its_size_is_stated(stack: ExitStack) -> None:
    one, alike = tracking(stack, {"planetary_gear.friction.d": 1.05e-5 / 3})
    found = discrepancies(one, PLANT.ports, alike)
    torque = port(found, "motor_bldc.tau_add")
    assert torque.curves[0].variable == "w"
    w = one.tracked.signals["motor_bldc.w"]
    true = float(np.sqrt(np.mean((1.05e-5 * 2 / 3 * w) ** 2)))
    assert torque.ci95[0] < true < torque.ci95[1]
    entry = torque.to_json()
    assert (entry["port"], entry["unit"], entry["variable"]) == ("motor_bldc.tau_add", "N.m", "w")
    assert len(picture(found).data) > 3 * len(found)
