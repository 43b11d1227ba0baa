"""What the diagnosis is held against: re-fit only, a Gaussian-process discrepancy, sparse regression (`sparse.py`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.calibrate import noises
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import Precision, fit
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.findings import Diagnosis, Estimate
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import SimulationError
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.diagnosis.repair.discrepancy import Discrepancy, Process, local_signals
from cobot_joint.diagnosis.store import Store

if TYPE_CHECKING:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.preprocessing import StandardScaler

SAMPLES = 500  # that a Gaussian process is fitted to: its cost grows with their cube
CONVERGED = Precision(settled=10.0, roughly=0.003)
HEALTHY = 1.05  # whitened residual per sample up to which a re-fit says that nothing is missing


@dataclass
class DiscrepancyDiagnosis(Diagnosis):
    """A diagnosis whose repair is no physics but a correction of the outputs."""

    discrepancy: Discrepancy | None = None


def refit(campaign: Campaign, *, progress: Any = None, store: Store | None = None) -> Diagnosis:
    """The base model inside its tolerances and nothing else: the fair "before" as a diagnosis."""
    calibrated, healthy = calibrate(campaign, progress, store)
    return Diagnosis("nothing_missing" if healthy else "undecided", [], calibrated, dict(calibrated))


def gaussian_process(campaign: Campaign, *, progress: Any = None, store: Store | None = None) -> Diagnosis:
    """Re-fit, then a Gaussian process for what remains (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63(3)).

    It fits whatever there is, so it names nothing.
    """
    store = store or Store(None)
    calibrated, healthy = calibrate(campaign, progress, store)
    values = {name: estimate.value for name, estimate in calibrated.items()}
    if progress:
        progress("Gaussian process")
    with Simulator(campaign.systems(), values) as simulate:
        pairs = [(recording, dict(simulate(recording))) for recording in campaign.train]
    discrepancy = store.remember("gp", values, lambda: _processes(pairs))
    verdict = "nothing_missing" if healthy else "undecided"
    return DiscrepancyDiagnosis(verdict, [], calibrated, dict(calibrated), discrepancy=discrepancy)  # type: ignore[arg-type]


def sparse(campaign: Campaign, *, progress: Any = None, store: Store | None = None) -> Diagnosis:
    """See sparse.py."""
    from cobot_joint.diagnosis.evaluation.sparse import sparse_regression

    calibrated, _ = calibrate(campaign, progress, store)
    return sparse_regression(campaign, calibrated)


BASELINES: Mapping[str, Callable[..., Diagnosis]] = {"refit": refit, "sparse": sparse, "gp": gaussian_process}


def calibrate(campaign: Campaign, progress: Any, store: Store | None) -> tuple[dict[str, Estimate], bool]:
    """Parameters re-fitted inside their tolerances over all training runs, and whether that leaves noise alone."""
    if progress:
        progress("re-fitting")
    return (store or Store(None)).remember("refit", None, lambda: _calibrate(campaign))


def _calibrate(campaign: Campaign) -> tuple[dict[str, Estimate], bool]:
    with FmuPlant(campaign.systems()) as plant:
        problem = Problem(plant, campaign.train, noises(campaign))
        bounds = {name: t.bounds(plant.parameters[name].nominal) for name, t in campaign.tolerances.items()}
        found = fit(problem, Hypothesis(tolerances(problem, bounds)), precision=CONVERGED)
        if found is None:
            raise SimulationError(f"{campaign.title}: the system as specified does not run through these recordings")
        units = {name: parameter.unit for name, parameter in plant.parameters.items()}
        return found.estimates(units), found.chi2 / problem.samples < HEALTHY


def _processes(pairs: list[tuple[Recording, dict[str, NDArray[np.float64]]]]) -> Discrepancy:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
    from sklearn.preprocessing import StandardScaler

    signals = tuple(dict.fromkeys(name for recording, _ in pairs for name in (*recording.inputs, *recording.outputs)))
    rng = np.random.default_rng(0)
    models = {}
    for channel in dict.fromkeys(name for recording, _ in pairs for name in recording.outputs):
        having = [(r, s) for r, s in pairs if channel in r.outputs]
        z = np.concatenate([local_signals(signals, r, s) for r, s in having])
        rest = np.concatenate([r.outputs[channel] - s[channel] for r, s in having])
        known = np.flatnonzero(np.isfinite(rest))
        chosen = rng.choice(known, min(SAMPLES, len(known)), replace=False)
        kernel = ConstantKernel() * RBF(np.ones(len(signals)), (1e-2, 1e3)) + WhiteKernel()
        scaler = StandardScaler().fit(z[chosen])
        process = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0)
        process.fit(scaler.transform(z[chosen]), rest[chosen])
        models[channel] = _plain(scaler, process)
    return Discrepancy(signals, models)


def _plain(scaler: StandardScaler, process: GaussianProcessRegressor) -> Process:
    """The numbers that scikit-learn's objects hold."""
    covariance = process.kernel_.k1  # beside the noise: variance * RBF
    return Process(
        mean=scaler.mean_,
        scale=scaler.scale_,
        lengths=np.atleast_1d(covariance.k2.length_scale),
        variance=float(covariance.k1.constant_value),
        samples=process.X_train_,
        weights=process.alpha_,
        offset=float(process._y_train_mean),
        gain=float(process._y_train_std),
    )
