"""A switched-off term is seen beside latent forces, with its amplitude, and nothing is where nothing is."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack

import numpy as np
import pytest

from cobot_joint.cosim.points import UnitFunction
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.state_estimation.discrepancy import PortDiscrepancy, discrepancies
from cobot_joint.diagnosis.state_estimation.estimator import StateEstimator
from cobot_joint.diagnosis.state_estimation.evidence import POINTS, Evidence, Tracking
from cobot_joint.diagnosis.state_estimation.latents import structure, with_sizes
from cobot_joint.diagnosis.state_estimation.linearisation import Known
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
    found, _ = tracking(stack, {})
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
