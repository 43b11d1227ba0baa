"""A diagnosis on recordings that it has not seen: nominal, calibrated and repaired beside the held-out runs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
from numpy.typing import NDArray

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.recording import Recording, condition
from cobot_joint.diagnosis.estimation.problem import one_blas_thread
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.diagnosis.repair.compare import Comparison, channel_figures, compare, table
from cobot_joint.diagnosis.repair.compare import Simulator as Simulate
from cobot_joint.diagnosis.repair.discrepancy import read_discrepancy
from cobot_joint.diagnosis.repair.export import ssp_files
from cobot_joint.diagnosis.repair.repair import repair
from cobot_joint.diagnosis.state_estimation.noise import noise_of
from cobot_joint.diagnosis.state_estimation.prediction import Variant, predicted_figures
from cobot_joint.diagnosis.store import plain, read_object
from cobot_joint.errors import UserError
from cobot_joint.files import write_atomically
from cobot_joint.system.model import System
from cobot_joint.system.read import load_system

History = tuple[NDArray[np.float64], NDArray[np.float64]]  # time, value
LoadHistories = Mapping[str, Mapping[str, History]]  # recording -> port


def verify(folder: Path, campaign: Campaign) -> dict[str, Any]:
    """Simulate every held-out recording with the systems of a diagnosis; write verify.json and verify.parquet to its
    folder.

    folder: what `diagnose` wrote. The repaired systems are its SSP files, as anyone would run them; only where none of
    them was kept, they are built from diagnosis.json. `system` of verify.json, which is returned, says which it was.
    Where no anchored prediction can be had, `predicted` is null and `not_predicted` says why. UserError: no diagnosis
    there, or nothing held out.
    """
    diagnosis = read_diagnosis(folder)
    if not campaign.holdout:
        raise UserError(f'{campaign.path}: no recording has role = "holdout", one at least is needed to verify')
    files = ssp_files(campaign.setups).values()
    kept = [file for file in files if (folder / file).is_file()]
    if not kept:  # of a proof, only the description is kept
        repair(diagnosis, campaign.systems(), folder)
    system = ", ".join(files) if kept else "built from diagnosis.json"
    if kept and exported(folder, campaign.setups) != diagnosis.get("exported", exported(folder, campaign.setups)):
        system += ", changed since diagnose wrote it"
    calibrated = {name: estimate["value"] for name, estimate in diagnosis["calibrated"].items()}
    compared = compare_systems(campaign, campaign.holdout, folder, calibrated)
    quality = condition(campaign.recordings)
    figures = channel_figures(compared)
    noise = {name: (diagnosis["channels"].get(name) or {}).get("noise") or quality[name].noise for name in figures}
    predicted, why = _predicted(campaign, variants(campaign, folder, calibrated))
    content = {
        "system": system,
        "channels": {
            name: {"noise": noise[name], **values, "predicted": predicted.get(name)} for name, values in figures.items()
        },
    } | ({"not_predicted": why} if why else {})
    write_atomically(folder / "verify.parquet", lambda file: pyarrow.parquet.write_table(table(compared), file))
    write_json(folder / "verify.json", content)
    return content


def _predicted(campaign: Campaign, systems: Mapping[str, Variant]) -> tuple[Mapping[str, Any], str]:
    """Anchored predictions by channel; none, and why, where a unit fails at a state that a filter has estimated."""
    try:
        with one_blas_thread():
            return predicted_figures(campaign.holdout, systems, noise_of(campaign)), ""
    except SimulationError as error:
        return {}, str(error)


def variants(campaign: Campaign, folder: Path, calibrated: Mapping[str, float]) -> dict[str, Variant]:
    """The system as specified, as re-fitted, and as the folder has it repaired."""
    nominal = campaign.systems()
    return {
        "nominal": Variant(nominal),
        "calibrated": Variant(nominal, calibrated),
        "repaired": Variant(repaired_systems(campaign, folder)),
    }


def read_diagnosis(folder: Path) -> dict[str, Any]:
    """diagnosis.json. UserError: there is none, or none that can be read."""
    diagnosis, why = read_object(folder / "diagnosis.json")
    if diagnosis is None or not {"verdict", "findings", "calibrated", "repaired", "channels"} <= set(diagnosis):
        raise UserError(f"{folder / 'diagnosis.json'}: {why or 'not a diagnosis'}; run cobot-joint diagnose first")
    return diagnosis


def compare_systems(
    campaign: Campaign,
    recordings: Sequence[Recording],
    folder: Path,
    calibrated: Mapping[str, float],
    loads: LoadHistories | None = None,
) -> list[Comparison]:
    """Recordings beside the system as specified, as re-fitted, and as repaired: the last are the SSP files of the
    folder, in the recordings of `loads` with what acted on the machine then.
    """
    nominal = campaign.systems()
    with ExitStack() as stack:
        simulators: dict[str, Simulate] = {
            "nominal": stack.enter_context(Simulator(nominal)),
            "calibrated": stack.enter_context(Simulator(nominal, calibrated)),
            "repaired": acted_on(stack.enter_context(FmuPlant(repaired_systems(campaign, folder))), loads or {}),
        }
        if (discrepancy := read_discrepancy(folder)) is not None:
            simulators["repaired"] = discrepancy.around(simulators["repaired"])
        return compare(recordings, simulators)


def acted_on(plant: FmuPlant, loads: LoadHistories) -> Simulate:
    """The systems with what acted on them in some of the recordings."""

    def simulate(recording: Recording) -> Mapping[str, NDArray[np.float64]]:
        time = recording.time - recording.time[0]
        added = {port: np.interp(time, t, value) for port, (t, value) in loads.get(recording.name, {}).items()}
        return plant.simulate({}, recording, added=added)

    return simulate


def repaired_systems(campaign: Campaign, folder: Path) -> dict[str, System]:
    """Set-up -> repaired system, as `export.write_repair` wrote them. UserError: one is missing."""
    return {setup: load_system(folder / file) for setup, file in ssp_files(campaign.setups).items()}


def exported(folder: Path, setups: Iterable[str]) -> dict[str, str]:
    """Repaired systems in a folder -> SHA-256, so that a later change of a file can be told."""
    files = [folder / file for file in ssp_files(setups).values()]
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files if file.is_file()}


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Plain JSON, whole or not at all."""
    text = json.dumps(plain(content), indent=1, allow_nan=False) + "\n"
    write_atomically(path, lambda file: file.write_text(text, encoding="utf-8"))
