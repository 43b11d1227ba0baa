"""A switched-off term is seen beside latent forces, with its amplitude, and nothing is where nothing is."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import ExitStack

import numpy as np
import pytest

from cobot_joint.cosim.points import UnitFunction
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.state_estimation.estimator import StateEstimator
from cobot_joint.diagnosis.state_estimation.evidence import POINTS, Evidence, Tracking, combinations
from cobot_joint.diagnosis.state_estimation.latents import structure, with_sizes
from cobot_joint.diagnosis.state_estimation.linearisation import Known
from cobot_joint.diagnosis.state_estimation.sampled import SampledSystem
from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.state_estimation.rig import NOISE, SIGMA, bench, recorded, run

PLANT = FmuPlant({"loaded": load_system("joint_logged")})
TOLERANCES = {
    "motor_bldc.winding.R": (0.0, 0.006),
    "motor_bldc.friction.d": (0.0, 1e-6),
    "planetary_gear.mesh.eta": (0.0, 0.03),
}


def tracking(stack: ExitStack, values: Mapping[str, float], added: Mapping[str, np.ndarray] | None = None) -> Tracking:
    sampled = stack.enter_context(SampledSystem(bench()[0], list(SIGMA)))
    recording = recorded(run(values, added))
    known = structure(sampled, sampled.free(recording), bench()[1], NOISE)
    estimator = StateEstimator(sampled, NOISE, known.latents, known.followed, known.reached)
    tracked = estimator.track(recording)
    estimator = with_sizes(estimator, tracked)
    return Tracking(estimator, estimator.refilter(tracked))


@pytest.fixture
def stack() -> ExitStack:
    with ExitStack() as found:
        yield found


def gains(evidence: Evidence, names: Collection[str]) -> dict[str, tuple[np.ndarray, float]]:
    """Term -> coefficients and gain in twice the log likelihood, its shapes where it does best."""
    found = {}
    for term in (t for t in PLANT.terms if t.name.split(".")[1] in names):
        width, some = (1 if term.phase is None else 2), list(combinations(term))
        groups = [slice(k * width, (k + 1) * width) for k in range(len(some))]
        fits = evidence.gls(evidence.of_term(term, some), groups)
        theta, _, gain = max(fits, key=lambda each: each[2])
        found[term.name] = theta, gain
    return found


def test_a_term_outranks_its_rivals_and_has_its_amplitude_and_phase(stack: ExitStack) -> None:
    values = {"mr_brake_belt.pulley_eccentricity.A": 0.03, "mr_brake_belt.pulley_eccentricity.phi_0": 1.0}
    found = tracking(stack, values | {"motor_bldc.winding.R": 0.209 * 1.02})
    some = {"pulley_eccentricity", "imbalance", "stribeck", "windage", "gain", "offset", "load_friction"}
    by_term = gains(Evidence([found], TOLERANCES), some)
    best = max(by_term, key=lambda name: by_term[name][1])
    assert best == "mr_brake_belt.pulley_eccentricity"
    theta = by_term[best][0]
    assert np.hypot(*theta) == pytest.approx(0.03, rel=0.15)
    assert np.arctan2(theta[1], theta[0]) == pytest.approx(1.0, abs=0.15)


def test_on_a_healthy_machine_whose_winding_is_off_no_term_gains(stack: ExitStack) -> None:
    found = tracking(stack, {"motor_bldc.winding.R": 0.209 * 1.02})
    by_term = gains(Evidence([found], TOLERANCES), {"imbalance", "windage", "gain", "offset", "load_friction"})
    # twice the log likelihood per coefficient is chi-square of one degree of freedom: above 20 once in 100,000
    assert max(gain / len(theta) for theta, gain in by_term.values()) < 20


def one_by_one(t: Tracking, amplitude: str, values: Mapping[str, float], points: int) -> tuple[np.ndarray, np.ndarray]:
    """What a unit of an amplitude adds to states and channels, by the unit's own Jacobians and numpy."""
    name, variable = amplitude.split(".", 1)
    lineariser, piece, tangent = t.estimator.lineariser, t.tracked.piece, t.tracked.tangent
    part = next(p for p in lineariser._parts if p.component.name == name)
    known = Known(lineariser.sampled, [(name, v) for v in part.known])(piece)
    own = {n.split(".", 1)[1]: v for n, v in values.items()}
    unit = UnitFunction(lineariser.sampled.simulation.instances[name], own, part.known, part.unknown)

    def added(time: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        J = unit.jacobian(time, known, [variable])[:, :, 0]
        inner, outer = np.zeros((len(J), len(lineariser.followed))), np.zeros((len(J), tangent.S.shape[2]))
        inner[:, part.inner], outer[:, part.outer] = J[:, : len(part.inner)], J[:, len(part.inner) :]
        return inner, outer

    inner, outer = added(piece.time, known)
    direct = (tangent.S @ outer[:, :, None])[:, :, 0]
    if not points:
        inner, outer = ((M[1:] + M[:-1]) / 2 for M in (inner, outer))
        return (tangent.Hold @ (inner[:, :, None] + tangent.T @ outer[:, :, None]))[:, :, 0], direct
    Phi, Hold = lineariser.step(tangent.A, t.tracked.recording.step / points)
    psi = np.zeros((*Phi.shape[:2], 1))
    for share in (np.arange(points) + 0.5) / points:
        inner, outer = added(piece.time[:-1] + share * np.diff(piece.time), known[:-1] + share * np.diff(known, axis=0))
        psi = Phi @ psi + Hold @ (inner[:, :, None] + tangent.T @ outer[:, :, None])
    return psi[:, :, 0], direct


@pytest.mark.parametrize("gives_derivatives", [True, False])
def test_shapes_looked_at_together_are_those_looked_at_one_by_one(
    stack: ExitStack, monkeypatch: pytest.MonkeyPatch, gives_derivatives: bool
) -> None:
    """Of a slow and of a quick period, of a term that a channel reads at once, and of base parameters; a unit that
    gives no directional derivatives is looked at by differences, at the samples alone."""
    found = tracking(stack, {})
    evidence = Evidence([found], TOLERANCES)
    if not gives_derivatives:
        monkeypatch.setattr(UnitFunction, "gives_derivatives", False)
    terms = {term.name: term for term in PLANT.terms}
    cogging, gain = terms["motor_bldc.cogging"], terms["torque_sensor.gain"]
    orders = [{"motor_bldc.cogging.n": n} for n in (24.0, 2.0, 6.0)]
    together = evidence.of_term(cogging, orders)
    for k, order in enumerate(orders):
        points = POINTS if gives_derivatives and order["motor_bldc.cogging.n"] > 2 else 0
        for j, phase in enumerate((0.0, np.pi / 2)):
            values = {**order, "motor_bldc.cogging.phi_0": phase}
            for one, each in zip(together.of(0), one_by_one(found, cogging.amplitude, values, points), strict=True):
                size = np.abs(each).max() + 1e-300
                np.testing.assert_allclose(one[:, :, 2 * k + j] / size, each / size, atol=1e-6)
    pairs = [(evidence.of_term(gain, [{}]), 0, gain.amplitude)]
    pairs += [(evidence.base, k, name) for k, name in enumerate(evidence.parameters)]
    for effect, k, name in pairs:
        for one, each in zip(effect.of(0), one_by_one(found, name, {}, 0), strict=True):
            size = np.abs(each).max() + 1e-300
            np.testing.assert_allclose(one[:, :, k] / size, each / size, atol=1e-4)
