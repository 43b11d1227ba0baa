"""The diagnosis: calibrate, name, look for what no list has, and say what was found and how sure that is."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cobot_joint.diagnosis.candidates.score_test import Scan
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.conditioning import condition
from cobot_joint.diagnosis.estimation.fit import Fit, Hypothesis, fit, tolerances
from cobot_joint.diagnosis.estimation.problem import Noise, Problem
from cobot_joint.diagnosis.experiments.discriminate import next_experiment
from cobot_joint.diagnosis.findings import Candidate, Diagnosis, Estimate, Finding
from cobot_joint.diagnosis.localization.evidence import locate
from cobot_joint.diagnosis.localization.isolability import prefetch
from cobot_joint.diagnosis.localization.localize import locate_difference
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import Plant
from cobot_joint.diagnosis.selection.confidence import confidence
from cobot_joint.diagnosis.selection.external_loads import look_for_a_hand, look_for_episodes
from cobot_joint.diagnosis.selection.stepwise import SETTLED, Named, Namer, prune, worth_naming
from cobot_joint.diagnosis.selection.unmodelled import Unlisted, look_for_unlisted
from cobot_joint.diagnosis.store import Store
from cobot_joint.errors import UserError, among

Progress = Callable[[str], None]
MOST_NAMES = 4  # that one finding may carry


@dataclass
class Naming:
    """What naming leaves for the answer."""

    calibrated: Fit
    fit: Fit
    named: list[Named]
    ranking: list[list[Candidate]]
    twins: dict[str, str]
    unlisted: Unlisted | None


def diagnose(campaign: Campaign, *, progress: Progress | None = None, store: Store | None = None) -> Diagnosis:
    """What the recordings with role "train" say of the campaign's system. Held-out recordings are not looked at.

    progress: called with what is being done, in words. store: stages finished by an earlier call are taken from it.
    """
    systems = campaign.systems()
    with FmuPlant(systems) as plant:
        return diagnose_plant(campaign, plant, progress=progress, store=store)


def diagnose_plant(
    campaign: Campaign, plant: Plant, *, progress: Progress | None = None, store: Store | None = None
) -> Diagnosis:
    """`diagnose` with any simulator."""
    begun = time.monotonic()
    prefetch()
    say, store = progress or (lambda words: None), store or Store(None)
    problem, naming, found = identify(campaign, plant, progress=say, store=store)
    basis = (found.calibrated, found.repaired, [f.term for f in found.findings])
    say("locating the difference")
    found.located = store.remember("located", basis, lambda: locate_difference(problem, naming.calibrated).to_json())
    if found.findings:
        say("looking for the experiment that would tell more")
    found.next_experiment = store.remember(
        "experiment", basis, lambda: next_experiment(problem, found.findings, naming.fit)
    )
    found.seconds = time.monotonic() - begun
    return found


def identify(
    campaign: Campaign, plant: Plant, *, progress: Progress | None = None, store: Store | None = None
) -> tuple[Problem, Naming, Diagnosis]:
    """What is missing, without where it shows in the recordings and what would tell more."""
    say, store = progress or (lambda words: None), store or Store(None)
    problem = Problem(plant, campaign.train, noises(campaign))
    bounds = {name: t.bounds(plant.parameters[name].nominal) for name, t in campaign.tolerances.items()}
    say("re-fitting the base model inside its tolerances")
    base = Hypothesis(tolerances(problem, bounds))
    told = tuple((name, c.noise, c.colour) for name, c in campaign.logged.items() if c.colour is not None)
    calibrated = store.remember(
        "calibrated", told, lambda: fit(problem, base, settled=10.0, roughly=SETTLED, fresh_most=8)
    )
    if calibrated is None:
        raise RuntimeError("the system cannot be simulated with its nominal parameters on these recordings")
    basis = (*told, *campaign.terms)
    naming = store.remember("naming", basis, lambda: _name(problem, calibrated, say, store, basis, campaign.terms))
    say("writing down what was found")
    return problem, naming, _answer(problem, naming)


def noises(campaign: Campaign) -> dict[str, Noise]:
    """Per compared channel, as the recordings show it; never below what the logger's data sheet says."""
    found = {}
    for name, quality in condition(replace(campaign, recordings=campaign.train)).items():
        logged = campaign.logged.get(name)
        floor = float(np.hypot(logged.noise, (logged.step or 0.0) / np.sqrt(12))) if logged and logged.noise else 0.0
        colour = logged.colour if logged and logged.colour is not None else max(quality.colour, 0.0)
        sigma = quality.noise if np.isfinite(quality.noise) and quality.noise > 0 else floor or 1.0
        found[name] = Noise(sigma if not floor or sigma > 0.9 * floor else floor, colour, quality.step)
    return found


def _name(problem: Problem, calibrated: Fit, say: Progress, store: Store, basis: object, only: Sequence[str]) -> Naming:
    """`only`: the terms to look at, and nothing beyond them; empty: all, and what no list names."""
    terms = [term for term in problem.plant.terms if not only or term.name in only]
    if unknown := set(only) - {term.name for term in terms}:
        known = among(term.name for term in problem.plant.terms)
        raise UserError(f"terms: {unknown.pop()!r} is given, the system has {known}")
    namer = Namer(problem, Scan(problem, terms), say, store)
    name_on = Namer(problem, namer.scan, say).name
    hand = None if only else look_for_a_hand(problem, calibrated, name_on, say)
    if hand:
        return Naming(calibrated, hand.fit, hand.named, [], dict(namer.scan.twins), hand)
    listed = namer.name(calibrated, basis)
    calibrated = listed.history[0]  # that of before, or a better one that naming came upon
    unlisted = None
    if not only:
        unlisted = look_for_episodes(problem, listed, name_on, say)
        unlisted = unlisted or look_for_unlisted(problem, calibrated, listed, say)
    best, named = (unlisted.fit, unlisted.named) if unlisted else (listed.fit, listed.named)
    if not unlisted:
        best, named = (worth_naming if only else prune)(problem, calibrated, listed)
    return Naming(calibrated, best, named, listed.ranking, dict(namer.scan.twins), unlisted)


def _answer(problem: Problem, naming: Naming) -> Diagnosis:
    plant = problem.plant
    units = {p.name: p.unit for p in plant.parameters.values()}
    units |= {t.amplitude: t.unit for t in plant.terms} | {s.name: s.unit for t in plant.terms for s in t.shapes}
    repaired = naming.fit.estimates(units)
    left = max(problem.excess(naming.fit.residual), 0.0)
    findings = [_finding(problem, naming, named, repaired, left) for named in naming.named]
    if naming.unlisted:
        findings.append(naming.unlisted.finding)
    findings.sort(key=lambda f: -f.gain)
    onsets = {a.term.amplitude: a.onset for a in naming.fit.hypothesis.active if a.onset is not None}
    notes = []
    if left > 10 * problem.excess_scatter and findings:
        before = max(problem.excess(naming.calibrated.residual), left)
        notes.append(f"{100 * left / before:.1f} % of the slow structure in the residual is left unexplained")
    beyond = any(f.term.endswith(".unlisted") for f in findings)
    verdict = "unlisted" if beyond else "explained" if findings else "nothing_missing"
    if not findings and left > 30 * problem.excess_scatter:
        verdict = "undecided"
        notes.append("the recordings differ from the re-fitted base model, and nothing that was tried explains how")
    return Diagnosis(
        verdict=verdict,  # type: ignore[arg-type]
        findings=findings,
        calibrated=naming.calibrated.estimates(units),
        repaired=repaired,
        onsets=onsets,
        ranking=naming.ranking,
        notes=notes,
        structure={"calibrated": problem.excess(naming.calibrated.residual), "repaired": left},
    )


def _finding(problem: Problem, naming: Naming, named: Named, repaired: Mapping[str, Estimate], left: float) -> Finding:
    on = {a.term.name: a for a in naming.fit.hypothesis.active}
    active = on[named.term]
    alike = sorted(named.alike, key=named.alike.__getitem__)
    twins = [t for t, leader in naming.twins.items() if leader == named.term] + [
        naming.twins[named.term] for _ in (0,) if named.term in naming.twins
    ]
    equivalent = list(dict.fromkeys([*twins, *alike]))[: MOST_NAMES - 1]
    both = [active, *(on[t] for t in twins if t in on)]
    parameters = {name: repaired[name] for a in both for name in a.values if name in repaired}
    where, words = locate(problem, naming.fit, active)
    return Finding(
        term=named.term,
        equivalent=tuple(equivalent),
        confidence=confidence(named.gain, left),
        onset=active.onset,
        parameters=parameters,
        where=where,
        gain=named.gain,
        words=words,
    )
