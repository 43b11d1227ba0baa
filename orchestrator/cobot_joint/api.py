"""The bench from Python: load a system, run it, sweep parameters, diagnose recordings, open results."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from cobot_joint.cosim import Advance, Experiment, simulate, simulate_many
from cobot_joint.cosim.energy import warn_of_residuals
from cobot_joint.errors import UserError
from cobot_joint.files import results_folder
from cobot_joint.results.diagnosed import Diagnosed
from cobot_joint.results.files import read_json, read_signals
from cobot_joint.results.result import Result
from cobot_joint.results.sweep import Sweep
from cobot_joint.scenario.model import TimeScenario, load_scenario
from cobot_joint.system import Inputs, System, load_system, with_parameters
from cobot_joint.system.model import Value

__all__ = ["Experiment", "Inputs", "diagnose", "load_results", "load_system", "run", "sweep"]

SystemOrName = System | str | Path


def run(
    system: SystemOrName,
    experiment: Experiment | str | Path | None = None,
    *,
    parameters: Mapping[str, Value | str] | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> Result:
    """One run of a system.

    system      a System; or a shipped one by name (`joint`), an .ssd or .ssp file; or, where no experiment is given, a
                scenario by name (`load_mr_brake`) or .toml file, which names its system
    experiment  an Experiment, or a scenario to take inputs and times from; None: of a system, its default experiment
                with no input driven
    parameters  `component.variable` -> value, SI units, over those of system and experiment
    progress    called with (simulated time, stop time), s, now and then

    Signals come in the units of the system's connectors (`Result.units`). Where more than 1 % of the energy that flows
    between two units is lost or made, the log `cobot_joint` has a warning.
    UserError: a name, file, value or time that is wrong, in one line. SimulationError: a unit failed; which, where,
    and what it said.
    """
    system, experiment = _resolved(system, experiment)
    result = simulate(with_parameters(system, parameters or {}), experiment, progress)
    warn_of_residuals(result.energy)
    return result


def sweep(
    system: SystemOrName,
    experiment: Experiment | str | Path | None,
    parameters: Mapping[str, Sequence[float]],
    *,
    jobs: int = -1,
    progress: Callable[[Advance], None] | None = None,
) -> Sweep:
    """A run for every combination of the parameters' values, over `jobs` processes (-1: one per core).

    system, experiment  as of `run`
    parameters          `component.variable` -> its values, SI units
    progress            called after every run

    A run that fails is in `Sweep.errors` and stops nothing. UserError: a name or value that is wrong, before any run.
    """
    system, experiment = _resolved(system, experiment)
    axes = {name: np.asarray(values, dtype=np.float64).reshape(-1) for name, values in parameters.items()}
    points = [dict(zip(axes, map(float, values), strict=True)) for values in product(*axes.values())]
    results: list[Result | None] = [None] * len(points)
    errors = {}
    for outcome in simulate_many(system, map(experiment.with_parameters, points), jobs=jobs, progress=progress):
        results[outcome.index] = outcome.kept
        if outcome.error is not None:
            errors[outcome.index] = outcome.error
    return Sweep(axes, results, errors)


def diagnose(
    campaign: str | Path,
    out: str | Path | None = None,
    *,
    within: float = math.inf,
    progress: Callable[[str], None] | None = None,
) -> Diagnosed:
    """Locate where a campaign's recordings and its system differ, name what the model lacks, repair the system.

    campaign  a campaign.toml, or the folder that holds it (docs/campaigns.md)
    out       folder for report.html, diagnosis.json, repaired.ssp; None: `diagnosis` beside the campaign
    within    s, after which nothing further is looked at; what is left out is in the answer. Recordings in time only
    progress  called with what is being done

    Stages that an earlier, interrupted call finished are taken over. What looks wrong with recordings is warned of.
    UserError: campaign or recordings are wrong.
    """
    from cobot_joint.diagnosis.checks.plausibility import plausible
    from cobot_joint.diagnosis.data.campaign import load_campaign
    from cobot_joint.diagnosis.frequency.response import is_response
    from cobot_joint.diagnosis.frequency_run import diagnose_response_campaign
    from cobot_joint.diagnosis.run import diagnose_campaign

    path = Path(campaign)
    path = path / "campaign.toml" if path.is_dir() else path
    folder = Path(out) if out is not None else path.parent / "diagnosis"
    if is_response(path):
        outcome = diagnose_response_campaign(path, results_folder(folder), progress=progress)
    else:
        loaded = load_campaign(path)
        results_folder(folder)
        for suspicion in plausible(loaded):
            warnings.warn(str(suspicion), stacklevel=2)
        outcome = diagnose_campaign(loaded, folder, within=within, progress=progress)
    return Diagnosed(folder, outcome.diagnosis)


def load_results(path: str | Path) -> Result | Diagnosed:
    """What `cobot-joint run` or `diagnose` left in a folder, or a signals file (.parquet) itself.

    UserError: there is neither signals.parquet nor diagnosis.json, or a file that cannot be read.
    """
    path = Path(path)
    if (path / "diagnosis.json").is_file():
        return Diagnosed(path, read_json(path / "diagnosis.json"))
    file = path / "signals.parquet" if path.is_dir() else path
    if not file.is_file():
        raise UserError(f"results {str(path)!r}: a folder with signals.parquet or diagnosis.json, or a .parquet file")
    return read_signals(file)


def _resolved(system: SystemOrName, experiment: Experiment | str | Path | None) -> tuple[System, Experiment]:
    if isinstance(experiment, Experiment):
        return (system if isinstance(system, System) else load_system(system)), experiment
    if isinstance(system, System) and experiment is None:
        default = system.default_experiment
        return system, Experiment(Inputs(np.zeros(1)), default.stop_time, default.start_time)
    scenario = load_scenario(str(system if experiment is None else experiment))
    if not isinstance(scenario, TimeScenario):
        raise UserError(f"{scenario.name} takes several runs: `cobot-joint run {scenario.name}` does them")
    if experiment is None:
        system = scenario.system
    loaded = system if isinstance(system, System) else load_system(system)
    return with_parameters(loaded, scenario.parameters, str(scenario.path)), scenario.experiment(loaded)
