"""A campaign: a campaign.toml, the system it names, and its recordings."""

from __future__ import annotations

import os
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from cobot_joint import paths
from cobot_joint.diagnosis.data.campaign_file import (
    Alternative,
    CampaignFile,
    ColumnEntry,
    FrequencyExperiment,
    Logged,
    RecordingEntry,
    Tolerance,
    Values,
)
from cobot_joint.diagnosis.data.check import check
from cobot_joint.diagnosis.data.conditioning import smoothed, with_place
from cobot_joint.diagnosis.data.formats import nearest
from cobot_joint.diagnosis.data.parameters import imposed, moving_starts, place_of, run_values, with_values
from cobot_joint.diagnosis.data.recording import Column, Connector, Recording, Role, read_recording
from cobot_joint.diagnosis.data.suspicion import Suspicion, without_faults
from cobot_joint.diagnosis.data.tables import read_table
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import System
from cobot_joint.system.read import load_system, system_names
from cobot_joint.system.wiring import warn_of_unconnected, with_inputs


@dataclass
class Campaign:
    """Everything a diagnosis starts from."""

    title: str
    path: Path
    system: str
    setups: dict[str, Path]
    channels: dict[str, str]
    tolerances: dict[str, Tolerance]
    logged: dict[str, Logged]
    recordings: list[Recording]
    notes: list[str] = field(default_factory=list)
    terms: list[str] = field(default_factory=list)  # to look at; empty: all
    scan: dict[str, tuple[float, float]] = field(default_factory=dict)  # `component.term.shape` -> range of its values
    onsets: bool = True  # whether what is missing may set in during a run
    suspicions: list[Suspicion] = field(default_factory=list)  # of channels, once `plausible` has looked
    parameters: Values = field(default_factory=dict)  # nominal values of this machine, as given
    told: frozenset[str] = frozenset()  # channels whose noise the campaign itself says, which is believed

    def systems(self) -> dict[str, System]:
        """Set-up -> its system with this machine's nominal values, and inputs of components where columns give them.

        UserError: one cannot be loaded or set, or a column gives what is wired.
        """
        recorded = set(self.channels.values())
        systems = {setup: with_inputs(load_system(path), recorded) for setup, path in self.setups.items()}
        return with_values(systems, self.parameters, f"{self.path}: [parameters]")

    @property
    def train(self) -> list[Recording]:
        """What may be fitted."""
        return [r for r in self.recordings if r.role == "train"]

    @property
    def holdout(self) -> list[Recording]:
        """What is scored and never fitted."""
        return [r for r in self.recordings if r.role == "holdout"]

    @property
    def outputs(self) -> list[str]:
        """Compared connectors, in the order in which recordings bring them."""
        return list(dict.fromkeys(name for r in self.recordings for name in r.outputs))


def load_campaign(path: Path, *, roles: tuple[Role, ...] = ("train", "holdout")) -> Campaign:
    """Read campaign.toml and the recordings of the given roles.

    Raises UserError with one line that says what, where and what is allowed.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "campaign.toml"
    given = read_campaign_file(path)
    if not given.recording:
        raise UserError(f"{path}: no [[recording]] is given, one at least is needed")
    if given.frequency_response:
        raise UserError(
            f"{path}: a frequency response is given, time series are allowed here; cobot-joint diagnose takes both"
        )
    _join_published_holdout(path, given)
    defaults, setups = systems_of(path, given)
    logged = defaults.logged | given.logged
    columns = {n: c.column if isinstance(c, ColumnEntry) else Column(c) for n, c in given.channels.items()}
    columns = columns or {n: Column(str(c)) for n, c in defaults.channels.items()}
    channels = {name: column.connector for name, column in columns.items()}
    parameters = defaults.parameters | given.parameters
    _each_once(path, given)
    campaign = Campaign(
        given.title, path, given.system, setups, channels, defaults.tolerances | given.tolerances, logged, [],
        terms=given.terms, scan=given.scan, onsets=given.onsets, parameters=parameters,
        told=frozenset(n for n, c in given.logged.items() if c.noise),
    )  # fmt: skip
    systems = campaign.systems()
    check(str(path), given, systems, {setup: system_connectors(file) for setup, file in setups.items()})
    for system in systems.values():
        warn_of_unconnected(system)
    recordings = campaign.recordings
    for files, entry in _runs(recording_files(path, given)):
        setup = entry.setup or next(iter(setups))
        if setup not in setups:
            raise UserError(
                f"{path}: recording {entry.file!r}: setup {setup!r} is given, {' or '.join(setups)} is allowed"
            )
        if entry.role not in roles:
            continue
        connectors = connectors_of(setups[setup], setup, logged, channels)
        reading = entry.reading(setup, given.initial)
        wired: dict[str, Column | str] = dict(columns or {name: Column(name) for name in connectors})
        if entry.table:
            recording = read_table(files, connectors, wired, reading)
        else:
            recording = read_recording(files[0], connectors, wired, reading)
            _take_motion(recording, systems[setup])
        recording.initial |= run_values(entry.parameters, systems[setup], f"{path}: recording {entry.file!r}")
        if entry.begin is not None or entry.end is not None:  # two windows of one file
            recording.name += f" from {recording.time[0]:.4g} s to {recording.time[-1]:.4g} s"
        recordings.append(recording)
    if "train" in roles and not campaign.train:
        raise UserError(f"{path}: every [[recording]] has role holdout, one at least with role train is needed")
    _something_moves(campaign)
    recordings[:] = without_faults(recordings)
    _name_apart(path.parent, recordings)
    return campaign


def _name_apart(folder: Path, recordings: Sequence[Recording]) -> None:
    """Each recording by a name of its own, which results go by: day1/run.csv and day2/run.csv, a.csv and a.parquet."""
    taken = Counter(r.name for r in recordings)
    for r in recordings:
        if taken[r.name] > 1 and r.scatter:  # of many files, none of which it is
            r.name += ", held out" if r.role == "holdout" else ", training"
        elif taken[r.name] > 1 and r.path:
            window = r.name.removeprefix(r.path.stem)
            r.name = os.path.relpath(r.path, folder).replace(os.sep, "/") + window
    seen: Counter[str] = Counter()
    for r in recordings:  # two windows of one file, whose times print alike
        seen[r.name] += 1
        r.name += f" ({seen[r.name]})" if seen[r.name] > 1 else ""


def _take_motion(recording: Recording, system: System) -> None:
    """Recorded motion as an input, less its noise; start values of what it drives, but for those that are given."""
    for name in imposed(system, recording.inputs):
        recording.inputs[name], width = smoothed(recording.inputs[name])
        if width > 1:
            recording.notes.append(f"{name}: recorded motion is an input, and smoothed over {width} samples")
        place = place_of(system, name)
        recorded = recording.outputs.get(place)
        found = None if recorded is None else with_place(recording.inputs[name], recorded, recording.step)
        if found is not None:
            recording.inputs[name], off = found
            del recording.outputs[place]
            said = f"from whose rate it was {off:.3g} {recording.units[name]} off (rms): what drives is not compared"
            recording.notes.append(f"{name}: its integral follows {place}, of the same shaft, {said}")
    starts = {n: w for n, w in moving_starts(system, recording.inputs).items() if n not in recording.initial}
    recording.initial |= starts
    if starts:
        said = ", ".join(f"{name} starts at {w:.4g} rad/s" for name, w in starts.items())
        recording.notes.append(f"it begins in motion: {said}")


def _each_once(path: Path, given: CampaignFile) -> None:
    """UserError: what is recorded once would count twice."""
    known = set()
    for file, entry in recording_files(path, given):
        key = file.resolve(), entry.begin, entry.end
        if key in known:
            raise UserError(f"{path}: recording {file.name!r} is given twice: once, or other begin and end")
        known.add(key)


def _something_moves(campaign: Campaign) -> None:
    """UserError: every output rests at one value in all recordings."""
    seen: dict[str, set[float]] = {}
    for recording in campaign.train:
        for name, x in recording.outputs.items():
            seen.setdefault(name, set()).update((float(np.nanmin(x)), float(np.nanmax(x))))
    if seen and all(len(values) == 1 for values in seen.values()):
        raise UserError(f"{campaign.path}: {among(seen)}: one value in all recordings, something that moves is needed")


def recording_files(path: Path, given: CampaignFile) -> list[tuple[Path, RecordingEntry]]:
    """Every file of a campaign with its entry, sorted where a pattern stands for several.

    A pattern leaves out what another entry names; one that fits nothing stands for itself, a file that is not there.
    """
    named = {path.parent / name for entry in given.recording for name in entry.patterns if not _is_pattern(name)}
    found = []
    for entry in given.recording:
        for name in entry.patterns:
            if not _is_pattern(name):
                found.append((path.parent / name, entry))
                continue
            folder = Path(path.parent, *Path(name).parts[:-1])
            files = sorted(file for file in folder.glob(Path(name).name) if file not in named)
            found += [(file, entry) for file in files or [folder / Path(name).name]]
    return found


def _runs(found: list[tuple[Path, RecordingEntry]]) -> list[tuple[list[Path], RecordingEntry]]:
    """One run per file, but one table of all files of an entry that is one."""
    tables = {id(entry): [f for f, e in found if e is entry] for _, entry in found if entry.table}
    runs = [([file], entry) for file, entry in found if not entry.table]
    return runs + [(files, next(e for _, e in found if id(e) == key)) for key, files in tables.items()]


def _is_pattern(name: str) -> bool:
    return any(c in Path(name).name for c in "*?[")


def holdouts(path: Path) -> list[Path]:
    """Held-out recordings of a campaign that are there, unread."""
    given = read_campaign_file(path)
    _join_published_holdout(path, given)
    return [file for file, entry in recording_files(path, given) if entry.role == "holdout" and file.is_file()]


def files_of(path: Path) -> list[Path]:
    """Recordings of a campaign that are there, each once, the published held-out one among them."""
    given = read_campaign_file(path)
    _join_published_holdout(path, given)
    return list(dict.fromkeys(file for file, _ in recording_files(path, given) if file.is_file()))


def has_training(path: Path) -> bool:
    """Whether a campaign has training recordings, and all of them are there."""
    path = path / "campaign.toml" if path.is_dir() else path
    files = [file for file, entry in recording_files(path, read_campaign_file(path)) if entry.role == "train"]
    return bool(files) and all(file.is_file() for file in files)


def missing_recordings(path: Path) -> list[Path]:
    """Recordings that a campaign names and that are not there."""
    return [file for file, _ in recording_files(path, read_campaign_file(path)) if not file.is_file()]


def _join_published_holdout(path: Path, given: CampaignFile) -> None:
    """A sealed case's held-out run is published as holdout.parquet beside a campaign.toml of before."""
    file = "holdout.parquet"
    if (
        given.recording
        and (path.parent / file).is_file()
        and all(file not in entry.patterns for entry in given.recording)
    ):
        given.recording.append(RecordingEntry(file=file, setup=given.recording[-1].setup, role="holdout"))


def read_campaign_file(path: Path) -> CampaignFile:
    """The file as it is. UserError: it is not a campaign."""
    try:
        return CampaignFile.model_validate(tomllib.loads(path.read_text(encoding="utf-8-sig")))
    except FileNotFoundError as error:
        raise UserError(f"{path}: there is no such campaign file") from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UserError(f"{path}: not a TOML file: {error}") from error
    except RecursionError:
        raise UserError(f"{path}: not a TOML file: brackets within brackets, deeper than can be read") from None
    except ValidationError as error:
        raise UserError(f"{path}: {_first(error)}") from error


def _first(error: ValidationError) -> str:
    """The first finding of pydantic, in one line."""
    finding = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")  # misspelt explains missing
    if finding["loc"][0] == "channels":  # a name or a table: of the two readings, that which came further
        finding = max(error.errors(), key=lambda e: (e["loc"][:2] == finding["loc"][:2], len(e["loc"])))
    where = ".".join(str(part) for part in finding["loc"] if part not in ("ColumnEntry", "str"))
    if finding["type"] == "extra_forbidden":
        tables = {"recording": RecordingEntry, "logged": Logged, "alternative": Alternative, "channels": ColumnEntry}
        tables["frequency_response"] = FrequencyExperiment
        parent: Any = tables.get(str(finding["loc"][0]), CampaignFile) if len(finding["loc"]) > 1 else CampaignFile
        return f"{where}: no such key, allowed are {', '.join(parent.model_fields)}"
    if finding["type"] == "missing":
        return f"{where}: missing"
    message = finding["msg"].removeprefix("Value error, ")
    return f"{where}: {message}" if "is given" in message else f"{where}: {finding['input']!r} is given; {message}"


def systems_of(path: Path, given: CampaignFile) -> tuple[CampaignFile, dict[str, Path]]:
    """Defaults that come with the system, and set-up -> system file."""
    defaults, folder = CampaignFile(), path.parent
    single = folder / given.system
    if given.system in system_names():
        folder = paths.folder("systems")
        single, sidecar = folder / f"{given.system}.ssd", folder / f"{given.system}.campaign.toml"
        defaults = read_campaign_file(sidecar) if sidecar.is_file() else defaults
    elif single.suffix not in (".ssp", ".ssd"):
        allowed = among([*system_names(), "an .ssp or .ssd file"])
        raise UserError(f"{path}: system {given.system!r} is given, allowed are {allowed}")
    elif not single.is_file():
        raise UserError(f"{path}: system {given.system!r}: there is no {single}")
    setups = {name: folder / file for name, file in (defaults.setups | given.setups).items()}
    if given.setups:
        setups |= {name: path.parent / file for name, file in given.setups.items()}
    return defaults, setups or {"default": single}


def connectors_of(
    system: Path, setup: str, logged: dict[str, Logged], channels: dict[str, str] | None = None
) -> dict[str, Connector]:
    """What recordings of a set-up may belong to: the logger's channels, and connectors that [channels] names."""
    here = {name: channel for name, channel in logged.items() if channel.setups is None or setup in channel.setups}
    found = {n: Connector(n, c.causality, c.unit) for n, c in here.items() if c.causality and c.unit}
    channels = channels or {}
    if set(channels.values()) <= set(logged) and found and len(found) == len(here):
        return found
    offered = system_connectors(system)
    found |= {name: offered[name] for name in here if name not in found}
    for column, name in channels.items():
        if name not in logged and name not in offered:
            raise UserError(
                f"[channels] {column!r} = {name!r}: {system.name} has no such connector, it has "
                f"{among(offered)}{nearest(name, offered)}"
            )
    wanted = set(channels.values()) - set(logged)
    return found | {name: connector for name, connector in offered.items() if not channels or name in wanted}


def system_connectors(path: Path) -> dict[str, Connector]:
    """Inputs and outputs of a system: its own connectors by name, those of its components as `component.variable`."""
    system = load_system(path)
    own = {c.name: Connector(c.name, c.causality, c.unit) for c in [*system.inputs.values(), *system.outputs.values()]}
    of_components = {
        f"{component.name}.{v.name}": Connector(
            f"{component.name}.{v.name}", v.causality, component.unit.unit_of(v.name)
        )
        for component in system.components
        for v in component.unit.variables.values()
        if v.causality in ("input", "output")
    }
    return own | of_components


__all__ = [
    "Campaign",
    "Connector",
    "Logged",
    "Recording",
    "Tolerance",
    "UserError",
    "load_campaign",
    "system_connectors",
]
