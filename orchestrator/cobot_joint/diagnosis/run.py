"""From a campaign to the files of its diagnosis: diagnosis.json, report.html, repaired.ssp, fmus/."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.archive import save
from cobot_joint.diagnosis.basis import of_campaign
from cobot_joint.diagnosis.budget import Budget
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.conditioning import ChannelQuality
from cobot_joint.diagnosis.data.recording import condition
from cobot_joint.diagnosis.estimation.problem import one_blas_thread
from cobot_joint.diagnosis.findings import Diagnosis
from cobot_joint.diagnosis.provenance import components, provenance
from cobot_joint.diagnosis.repair.compare import Comparison, channel_figures
from cobot_joint.diagnosis.repair.discrepancy import DISCREPANCY
from cobot_joint.diagnosis.repair.gate import beyond_doubt, judged, predicts_worse
from cobot_joint.diagnosis.repair.repair import repair
from cobot_joint.diagnosis.repair.verify import compare_systems, exported, variants, write_json
from cobot_joint.diagnosis.report.headline import TermText, first_clause, verdict_sentence
from cobot_joint.diagnosis.report.report import ReportData, write_report
from cobot_joint.diagnosis.report.words import spoken
from cobot_joint.diagnosis.state_estimation.noise import noise_of
from cobot_joint.diagnosis.state_estimation.prediction import predicted_figures
from cobot_joint.diagnosis.store import Store
from cobot_joint.errors import UserError, among
from cobot_joint.files import relative, write_atomically
from cobot_joint.system.model import System

TRIED = 8  # candidates that a report lists
Progress = Callable[[str], None]  # what is being done, in words


@dataclass(frozen=True)
class Outcome:
    """What a diagnosis left behind."""

    sentence: str
    diagnosis: dict[str, Any]  # as diagnosis.json
    units: dict[str, str]
    files: list[Path]


def diagnose_campaign(
    campaign: Campaign,
    out: Path,
    *,
    baseline: str | None = None,
    within: float = math.inf,
    progress: Progress | None = None,
) -> Outcome:
    """Diagnose, repair, compare, report. diagnosis.json is written last: where it is, all is written and cleared away.

    Stages that an earlier, interrupted call finished are taken from OUT/.work. within: s, after which nothing further
    is looked at.
    """
    say = progress or (lambda words: None)
    systems = campaign.systems()
    source = provenance(campaign.path, campaign.title, systems, parameters=campaign.parameters, baseline=baseline)
    store = Store(out / ".work", of_campaign(campaign, systems))
    diagnosis = engine(baseline, Budget(within))(campaign, progress=progress, store=store)
    if discrepancy := getattr(diagnosis, "discrepancy", None):
        write_atomically(out / DISCREPANCY, lambda file: save(file, discrepancy, DISCREPANCY))
    quality = condition(campaign.recordings)
    compared, unpredicted = _tried(campaign, diagnosis, systems, out, quality, say)
    missing = {
        "not_compared": not_compared(campaign),
        "not_simulated": not_simulated(compared),
        "not_predicted": unpredicted,
    }
    content = spoken(diagnosis.to_json() | {name: what for name, what in missing.items() if what})
    content |= {"exported": exported(out, campaign.setups), "campaign": relative(campaign.path, out)}
    say("reporting")
    texts = term_texts(systems)
    nominal = nominal_values(systems, [*diagnosis.repaired, *campaign.tolerances])
    data = ReportData(
        title=campaign.title,
        diagnosis=content,
        compared=compared,
        quality=quality,
        units=units_of(campaign),
        nominal=nominal,
        bounds={name: t.bounds(nominal[name]) for name, t in campaign.tolerances.items() if name in nominal},
        terms=texts,
        tried=[(c.term, c.gain) for c in (diagnosis.ranking[0] if diagnosis.ranking else [])][:TRIED],
        provenance=source,
        created=date.today(),
        system=fullest(systems),
    )
    write_report(out / "report.html", data)
    if not diagnosis.left_out:
        store.clear()
    write_json(out / "diagnosis.json", content | {"provenance": source})
    files = [out / name for name in ("diagnosis.json", "report.html", "repaired.ssp", "fmus")]
    return Outcome(verdict_sentence(content, texts), content, units_of(campaign), files)


def _tried(
    campaign: Campaign,
    diagnosis: Diagnosis,
    systems: Mapping[str, System],
    out: Path,
    quality: Mapping[str, ChannelQuality],
    say: Progress,
) -> tuple[list[Comparison], str]:
    """The repair, written, simulated beside all recordings, and judged; "", or why it is predicted from nowhere.

    Where all that was found is refuted, nothing is repaired: the re-fitted base model is written.
    """
    say("repairing")
    repair(diagnosis.to_json(), systems, out)
    say("comparing")
    calibrated, loads = diagnosis.parameters("calibrated"), diagnosis.load_histories()
    compared = compare_systems(campaign, campaign.recordings, out, calibrated, loads)
    diagnosis.channels = channels(compared, quality)
    unpredicted: list[str] = []
    judge(diagnosis, lambda: anchored(campaign, out, calibrated, say, unpredicted))
    if diagnosis.refuted and not diagnosis.findings:
        diagnosis.repaired = dict(diagnosis.calibrated)
        repair(diagnosis.to_json(), systems, out)
        compared = compare_systems(campaign, campaign.recordings, out, calibrated, loads)
        diagnosis.channels, diagnosis.repair = channels(compared, quality), "offered"
    return compared, " ".join(unpredicted)


def judge(diagnosis: Diagnosis, predict: Callable[[], Mapping[str, Mapping[str, Any]]] = dict) -> None:
    """Withhold a repair that does not predict, and what was claimed with it.

    A base parameter has no form that could be somewhat off: outside its tolerance without predicting, it is refuted.

    predict: role -> channel -> figures of anchored predictions. Asked where free runs speak against the repair, since
    these add up whatever is wrong, and lose angles; and where they leave half of the error, which a wrong repair does
    as well: one that took 30 % had predicted three times worse.
    """
    if not diagnosis.findings or beyond_doubt(diagnosis.channels):
        return
    for_it = judged(diagnosis.channels) == "offered"
    for role, predicted in predict().items():
        for name, figures in predicted.items():
            if role in diagnosis.channels[name]:
                diagnosis.channels[name][role]["predicted"] = figures
    predicts = not predicts_worse(diagnosis.channels) if for_it else judged(diagnosis.channels) == "offered"
    if predicts:
        return
    diagnosis.repair, diagnosis.verdict = "withheld", "undecided"
    kept = [f for f in diagnosis.findings if f.term not in diagnosis.calibrated]
    diagnosis.refuted = [f.term for f in diagnosis.findings if f not in kept]
    diagnosis.findings = [f.withheld("its repair is withheld") for f in kept]


def anchored(
    campaign: Campaign, out: Path, calibrated: Mapping[str, float], say: Progress, why: list[str]
) -> dict[str, Any]:
    """Role -> channel -> figures of anchored predictions; empty: none can be had, and `why` is added to."""
    say("predicting all runs from short distances")
    runs = {role: found for role, found in (("holdout", campaign.holdout), ("train", campaign.train)) if found}
    try:
        systems, noise = variants(campaign, out, calibrated), noise_of(campaign)
        with one_blas_thread():
            return {role: predicted_figures(recordings, systems, noise) for role, recordings in runs.items()}
    except SimulationError as error:
        why.append(str(error))
        return {}


def engine(baseline: str | None, budget: Budget) -> Callable[..., Diagnosis]:
    """The diagnosis, or what it is held against. UserError: no such baseline, or it cannot be limited."""
    if baseline is None:
        from cobot_joint.diagnosis.engine import diagnose

        return partial(diagnose, budget=budget)
    if budget.limited:
        raise UserError(
            f"--within {budget.seconds:g} is given, a baseline (--baseline {baseline}) takes as long as it takes"
        )
    from cobot_joint.diagnosis.evaluation.baselines import BASELINES

    if baseline not in BASELINES:
        raise UserError(f"--baseline {baseline!r} is given, {among(BASELINES)} is allowed")
    return BASELINES[baseline]


def channels(compared: Sequence[Comparison], quality: Mapping[str, ChannelQuality]) -> dict[str, dict[str, Any]]:
    """diagnosis.json's `channels`; without holdout recordings no `holdout`."""
    content: dict[str, dict[str, Any]] = {name: {"noise": q.noise} for name, q in quality.items()}
    for role in ("train", "holdout"):
        for name, figures in channel_figures([c for c in compared if c.recording.role == role]).items():
            content[name][role] = figures
    return content


def not_compared(campaign: Campaign) -> list[dict[str, Any]]:
    """diagnosis.json's `not_compared`: samples that are no measurements, by recording and channel."""
    return [
        {"recording": r.name, "channel": out.channel, "why": out.kind, "samples": out.samples, "of": len(r.time)}
        for r in campaign.recordings
        for out in r.left_out
    ]


def not_simulated(compared: Sequence[Comparison]) -> list[dict[str, str]]:
    """diagnosis.json's `not_simulated`: which system failed in which recording, and why."""
    return [
        {"recording": c.recording.name, "variant": variant, "why": why}
        for c in compared
        for variant, why in c.failed.items()
    ]


def term_texts(systems: Mapping[str, System]) -> dict[str, TermText]:
    """`component.term` -> what its unit says of it"""
    return {
        f"{component.name}.{term.name}": TermText(
            term.title,
            term.equation,
            term.source,
            {
                name.removeprefix(f"{term.name}."): first_clause(variable.description)
                for name, variable in component.unit.variables.items()
                if name.startswith(f"{term.name}.")
            },
        )
        for component in components(systems)
        for term in component.unit.terms
    }


def fullest(systems: Mapping[str, System]) -> System:
    """That of the set-up with the most units."""
    return max(systems.values(), key=lambda system: len(system.components))


def nominal_values(systems: Mapping[str, System], names: Sequence[str]) -> dict[str, float]:
    """`component.variable` -> value as the system has it."""
    values = {}
    for component in components(systems):
        for name in names:
            variable = name.removeprefix(f"{component.name}.")
            if variable != name and variable in component.unit.variables:
                start = component.parameters.get(variable, component.unit.variables[variable].start)
                values[name] = float(start)
    return values


def units_of(campaign: Campaign) -> dict[str, str]:
    """Channel -> unit"""
    return {name: unit for recording in campaign.recordings for name, unit in recording.units.items()}
