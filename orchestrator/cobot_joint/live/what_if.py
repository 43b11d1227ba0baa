"""What a slider does: recordings beside the repaired system with other values, simulated again at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.repair.repair import correction, onsets
from cobot_joint.diagnosis.repair.verify import read_diagnosis, repaired_systems
from cobot_joint.diagnosis.report.headline import SEEN, title_of
from cobot_joint.diagnosis.run import nominal_values, term_texts
from cobot_joint.errors import UserError
from cobot_joint.system.model import System

Array = NDArray[np.float64]
SHOWN = 3  # recordings at first: what half a second is enough for
WIDER = 2.0  # tolerances, that a parameter's slider reaches to


@dataclass(frozen=True)
class Slider:
    """One value that can be moved. kind: a term's parameter, a base parameter, the amplitude of a rival that is off, or
    the share of an effect that is a load history or a form; `name`: `component.variable`, of a share the finding's.
    beside: values that are set with it.
    """

    name: str
    label: str
    unit: str
    low: float
    high: float
    found: float
    kind: str
    beside: Mapping[str, float] = field(default_factory=dict)


class WhatIf:
    """A diagnosis with its recordings, loaded once. A context manager.

    folder: what `diagnose` wrote. UserError: no diagnosis there, or one of a baseline that is no system.
    """

    def __init__(self, folder: Path, campaign: Campaign) -> None:
        self.folder, self.campaign = folder, campaign
        self.diagnosis = read_diagnosis(folder)
        self.nominal = campaign.systems()
        self.sliders = [*_sliders(self.diagnosis, campaign), *_rivals(self.diagnosis, self.nominal)]
        self._beside = {s.name: s.beside for s in self.sliders}
        self.noise = {n: c["noise"] for n, c in self.diagnosis["channels"].items() if seen(c["noise"], n, campaign)}
        findings = self.diagnosis["findings"]
        self._onsets = onsets(findings, self.nominal)
        self._forms = {f["term"]: correction(k, f) for k, f in enumerate(findings, 1) if f.get("shape")}
        self._loads = {f["term"]: f["load_history"] for f in findings if f.get("load_history")}
        self._plant = FmuPlant(repaired_systems(campaign, folder))
        self._base = FmuPlant(self.nominal)
        self._pool = ThreadPoolExecutor(max_workers=SHOWN)
        self._calibrated: dict[str, Mapping[str, Array]] = {}

    def __enter__(self) -> WhatIf:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)
        for plant in (self._plant, self._base):
            plant.__exit__(None, None, None)

    @property
    def first_shown(self) -> list[str]:
        """Names of recordings: fitted ones, and one that was held out."""
        held = [r.name for r in self.campaign.holdout][:1]
        return [*[r.name for r in self.campaign.train][: SHOWN - len(held)], *held]

    def recording(self, name: str) -> Recording:
        """The recording of that name."""
        return next(r for r in self.campaign.recordings if r.name == name)

    def calibrated(self, name: str) -> Mapping[str, Array]:
        """Channel -> (n,), the base model re-fitted with nothing added; simulated once."""
        if name not in self._calibrated:
            values = {n: e["value"] for n, e in self.diagnosis["calibrated"].items()}
            recording = self.recording(name)
            there = {n: x for n, x in values.items() if self._base.has(n, recording)}
            self._calibrated[name] = self._base.simulate(there, recording)
        return self._calibrated[name]

    def simulate(self, moved: Mapping[str, float], names: Sequence[str]) -> dict[str, Mapping[str, Array]]:
        """Recording -> channel -> (n,) of the repaired system with these sliders (name -> value) moved.

        SimulationError: a unit fails with these values.
        """
        runs = {name: self._pool.submit(self._one, self.recording(name), moved) for name in names}
        return {name: run.result() for name, run in runs.items()}

    def _one(self, recording: Recording, moved: Mapping[str, float]) -> Mapping[str, Array]:
        values = self.valued(moved)
        for term, share in moved.items():
            if term in self._forms:
                values |= scaled(self._forms[term], share)
        there = {n: x for n, x in values.items() if self._plant.has(n, recording)}
        late = {n: t for n, t in self._onsets.items() if n in there}
        time, added = recording.time - recording.time[0], {}
        for term, history in self._loads.items():
            if recording.name in history["recordings"]:
                series = history["recordings"][recording.name]
                added[history["port"]] = moved.get(term, 1.0) * np.interp(time, series["t"], series["value"])
        return self._plant.simulate(there, recording, onsets=late, added=added)

    def valued(self, moved: Mapping[str, float]) -> dict[str, float]:
        """`component.variable` -> value of those sliders that are one, with what is set beside them."""
        values = {n: x for n, x in moved.items() if n not in self._forms and n not in self._loads}
        for name in moved:
            values = {**self._beside.get(name, {}), **values}
        return values

    def rms(self, simulated: Mapping[str, Mapping[str, Array]]) -> dict[str, float]:
        """Channel -> rms of recording - simulation over these recordings."""
        squares: dict[str, list[Array]] = {}
        for name, outputs in simulated.items():
            for channel, recorded in self.recording(name).outputs.items():
                squares.setdefault(channel, []).append((recorded - outputs[channel]) ** 2)
        return {channel: float(np.sqrt(np.nanmean(np.concatenate(x)))) for channel, x in squares.items()}


def seen(noise: float | None, channel: str, campaign: Campaign) -> bool:
    """Whether there is noise to compare with, more than what rounding leaves."""
    recorded = [r.outputs[channel] for r in campaign.recordings if channel in r.outputs]
    largest = max((float(np.nanmax(np.abs(y), initial=0.0)) for y in recorded), default=0.0)
    return (noise or 0.0) > SEEN * largest


def scaled(form: Any, share: float) -> dict[str, float]:
    """Of a correction unit, `component.variable` -> value with its effect times `share`."""
    sizes = {n: x for n, x in form.parameters.items() if n.startswith("table.y") or n.endswith(".A")}
    return {f"{form.name}.{n}": share * x for n, x in sizes.items()}


def _sliders(d: Mapping[str, Any], campaign: Campaign) -> list[Slider]:
    """Terms first, each from neutral to twice what was found; then base parameters, over twice their tolerance."""
    systems = campaign.systems()
    texts, found = term_texts(systems), []
    units = {c.name: c.unit for system in systems.values() for c in system.components}
    neutral = {f"{n}.{t.amplitude}": t.neutral for n, unit in units.items() for t in unit.terms if t.amplitude}
    for f in d["findings"]:
        if f.get("shape") or f.get("load_history"):
            found.append(Slider(f["term"], title_of(f["term"], texts), "times", 0.0, 2.0, 1.0, "share"))
    base = set(d["calibrated"])
    for name, e in d["repaired"].items():
        if name in base or "." not in name or name.split(".")[0] not in units:
            continue
        component, variable = name.split(".", 1)
        at = neutral.get(name, 0.0)
        low, high = sorted((at, 2 * e["value"] - at))
        low, high = _within(units[component].bounds_of(variable), low, high)
        owner = next((t for t in texts if name.startswith(f"{t}.")), "")
        what = texts[owner].parameters.get(name.removeprefix(f"{owner}."), "") if owner else ""
        label = f"{title_of(owner, texts)}, {what or variable}" if owner else name
        if high > low:
            found.append(Slider(name, label, e["unit"], low, high, e["value"], "term"))
    nominal = nominal_values(systems, [*campaign.tolerances])
    for name, e in d["repaired"].items():
        if name in base and name in campaign.tolerances and name in nominal:
            component, variable = name.split(".", 1)
            lower, upper = campaign.tolerances[name].bounds(nominal[name])
            middle, half = (lower + upper) / 2, (upper - lower) / 2
            low, high = min(middle - WIDER * half, e["value"]), max(middle + WIDER * half, e["value"])
            low, high = _within(units[component].bounds_of(variable), low, high)
            if not high > low:
                continue
            found.append(Slider(name, name, e["unit"], low, high, e["value"], "parameter"))
    return found


def _rivals(d: Mapping[str, Any], systems: Mapping[str, System]) -> list[Slider]:
    """Terms that the recordings cannot tell from a finding: from neutral to twice the finding's amplitude, with its
    shape where they have the same one. Only those in whose unit of measure it is given.
    """
    texts, found = term_texts(systems), []
    terms = {f"{c.name}.{t.name}": (c, t) for s in systems.values() for c in s.components for t in c.unit.terms}
    for f in d["findings"]:
        if f["term"] not in terms:
            continue
        component, term = terms[f["term"]]
        amplitude = d["repaired"].get(f"{component.name}.{term.amplitude}")
        for name in f.get("equivalent") or []:
            other, rival = terms.get(name, (component, term))
            full = f"{other.name}.{rival.amplitude}"
            if amplitude is None or rival.amplitude is None or full in d["repaired"]:
                continue
            unit = other.unit.unit_of(rival.amplitude) or "1"
            low, high = sorted((rival.neutral, 2 * amplitude["value"] - rival.neutral))
            low, high = _within(other.unit.bounds_of(rival.amplitude), low, high)
            if unit == amplitude["unit"] and high > low:
                beside = {
                    f"{name}.{p}": e["value"]
                    for p, e in f["parameters"].items()
                    if f"{rival.name}.{p}" in other.unit.variables
                }
                label = f"{title_of(name, texts)} in {other.name}"
                found.append(Slider(full, label, unit, low, high, rival.neutral, "rival", beside))
    return found


def _within(bounds: tuple[float | None, float | None], low: float, high: float) -> tuple[float, float]:
    """What the unit takes."""
    lower, upper = bounds
    return low if lower is None else max(low, lower), high if upper is None else min(high, upper)


def campaign_of(folder: Path, given: Path | None) -> Path:
    """The campaign that a diagnosis was made from. UserError: it does not say, or the file is not there any more."""
    if given is not None:
        return given
    diagnosis = read_diagnosis(folder)
    if "readings" in diagnosis:
        raise UserError(f"{folder}: a frequency response is given, results of runs over time are allowed")
    said = diagnosis.get("campaign")
    ask = "say where it is with --campaign CAMPAIGN.toml"
    if not said:
        raise UserError(f"{folder / 'diagnosis.json'}: it does not name its campaign; {ask}")
    path = (folder / said).resolve()
    if not path.is_file():
        raise UserError(f"{folder / 'diagnosis.json'}: its campaign {said} is not there; {ask}")
    return path
