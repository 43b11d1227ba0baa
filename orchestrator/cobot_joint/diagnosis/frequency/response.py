"""A frequency-response campaign, read: its table of amplitudes, its system, and what there is to simulate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.campaign import read_campaign_file, system_connectors
from cobot_joint.diagnosis.data.campaign_file import Alternative, CampaignFile, FrequencyExperiment
from cobot_joint.diagnosis.data.check import check
from cobot_joint.diagnosis.data.parameters import with_values
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import SMOOTH, Problem
from cobot_joint.diagnosis.plant.frequency_plant import CHANNEL, FrequencyPlant, by_frequency, quick
from cobot_joint.errors import UserError, among
from cobot_joint.scenario.frequency_response import read_table
from cobot_joint.system.model import System, Value
from cobot_joint.system.read import find_system, load_system

DEGREE = 7  # degree of the polynomial in ln omega from which the data's own scatter is told
LEAST_ROWS = DEGREE + 3  # that leave it two degrees of freedom
Vector = NDArray[np.float64]


def read_amplitudes(path: Path) -> tuple[Vector, Vector]:
    """Two columns with headers: (frequencies rad/s, amplitudes). UserError: it is not that."""
    omega, amplitude = read_table(path)
    if len(omega) < LEAST_ROWS:
        raise UserError(f"{path}: {len(omega)} frequencies are given, {LEAST_ROWS} at least are needed")
    if not (np.all(omega > 0) and np.all(amplitude > 0)):
        raise UserError(f"{path}: frequencies and amplitudes have to be positive")
    return omega, amplitude


def scatter(omega: Vector, amplitude: Vector) -> float:
    """The data's own noise: rms of ln amplitude about a smooth curve, for the degrees of freedom that are left."""
    x, y = np.log(omega), np.log(amplitude)
    rest = y - np.polyval(np.polyfit(x, y, DEGREE), x)
    return float(np.sqrt(rest @ rest / (len(y) - DEGREE - 1)))


def is_response(path: Path) -> bool:
    """Whether the campaign is about a frequency response. UserError: it is no campaign."""
    return read_campaign_file(path / "campaign.toml" if path.is_dir() else path).frequency_response is not None


@dataclass(frozen=True)
class Response:
    """A frequency-response campaign, read."""

    path: Path
    given: CampaignFile
    experiment: FrequencyExperiment
    system: System
    recording: Recording
    noise: float
    crashes: list[str] = field(default_factory=list)  # of units, in what was simulated so far


def load_response(path: Path) -> Response:
    """UserError: what is wrong with the campaign, its system or its table."""
    path = path / "campaign.toml" if path.is_dir() else path
    given = read_campaign_file(path)
    assert given.frequency_response is not None
    if len(given.recording) != 1:
        raise UserError(f"{path}: {len(given.recording)} [[recording]] are given, one table is allowed")
    if given.scan or not given.onsets:
        raise UserError(f"{path}: {'[scan]' if given.scan else 'onsets'} is given, it is for recordings in time")
    file = path.parent / given.system if given.system.endswith((".ssd", ".ssp")) else given.system
    system = with_values({"default": load_system(file)}, given.parameters, f"{path}: [parameters]")["default"]
    check(str(path), given, {"default": system}, {"default": system_connectors(find_system(file))})
    system = read_as(system, given.frequency_response.parameters, f"{path}: frequency_response")
    for alternative in given.alternative:
        read_as(system, alternative.parameters, f"{path}: alternative {alternative.name!r}")
    experiment = given.frequency_response
    for key, name, ends in (("input", experiment.input, system.inputs), ("output", experiment.output, system.outputs)):
        if name not in ends:
            raise UserError(f"{path}: frequency_response.{key}: {name!r} is given, {among(ends)} is allowed")
    table = path.parent / given.recording[0].patterns[0]
    omega, amplitude = read_amplitudes(table)
    recording = Recording(
        table.stem, "train", "default", omega, {}, {CHANNEL: np.log(amplitude)}, {CHANNEL: "1"}, path=table
    )
    return Response(path, given, given.frequency_response, system, recording, scatter(omega, amplitude))


def read_as(system: System, values: Mapping[str, Value | str], where: str) -> System:
    """The system under one reading of the experiment."""
    return with_values({"default": system}, values, where)["default"]


@contextmanager
def problems(response: Response, alternative: Alternative) -> Iterator[tuple[Problem, Problem]]:
    """All frequencies, and those that cost little."""
    system = read_as(response.system, alternative.parameters, f"{response.path}: {alternative.name}")
    noise = {CHANNEL: Noise(response.noise)}
    with FrequencyPlant(system, response.experiment, response.recording.time) as plant:
        every = by_frequency(response.recording)
        few = quick(every, response.experiment.settle)
        yield Problem(plant, every, noise, step=SMOOTH), Problem(plant, few, noise, step=SMOOTH)
        response.crashes.extend(str(crash) for crash in plant.plant.crashes.values())
