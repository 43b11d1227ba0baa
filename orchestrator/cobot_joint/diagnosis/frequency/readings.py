"""A frequency response's diagnosis: every way to read the experiment, and the one that leaves least."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.data.campaign_file import Alternative
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import one_blas_thread
from cobot_joint.diagnosis.findings import Candidate, Diagnosis, Estimate, Finding
from cobot_joint.diagnosis.frequency.fits import calibrate, on_all, ranked, roughly
from cobot_joint.diagnosis.frequency.response import Response
from cobot_joint.diagnosis.localization.conditions import Condition
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.frequency_plant import CHANNEL
from cobot_joint.diagnosis.plant.plant import Parameter
from cobot_joint.diagnosis.selection.confidence import confidence
from cobot_joint.diagnosis.store import Store

BAND = 0.8  # of what a finding takes, that its band holds
FITTED = 2  # kinds of terms of the best score that are fitted, in every unit that has them
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Reading:
    """One way to read the experiment's description, and what was found under it."""

    alternative: Alternative
    nominal: float  # rms of ln(simulated/measured)
    calibrated: Fit
    repaired: Fit
    ranking: list[Candidate]
    equivalent: tuple[str, ...]


def diagnose_response(
    response: Response, store: Store, progress: Progress | None = None
) -> tuple[Diagnosis, list[Reading]]:
    """The best reading's diagnosis, and every reading.

    Terms are ranked under the reading that the base model fits best; the candidates are fitted under all of them.
    """
    with one_blas_thread():
        return _diagnosed(response, store, progress or (lambda words: None))


def _diagnosed(response: Response, store: Store, say: Progress) -> tuple[Diagnosis, list[Reading]]:
    since = time.monotonic()
    given = response.given.alternative or [Alternative(name="as described")]
    say(f"re-fitting the base model under {len(given)} readings")
    bases = [store.remember("calibrated", a.model_dump(), partial(calibrate, response, a)) for a in given]
    lead = min(range(len(given)), key=lambda k: bases[k][1].chi2)
    say(f"ranking every term: {given[lead].name}")
    ranking = store.remember(
        "ranking", given[lead].model_dump(), partial(ranked, response, given[lead], bases[lead][1])
    )
    only = response.given.terms
    worth = [c for c in ranking if c.gain > 2 * np.log(len(ranking)) and (not only or c.term in only)]
    candidates = leaders(worth)
    terms = [candidate.term for candidate in candidates]
    rough = []
    for alternative, (_, base) in zip(given, bases, strict=True):
        say(f"fitting {' and '.join(terms)}: {alternative.name}")
        key = (alternative.model_dump(), terms)
        rough.append(store.remember("rough", key, partial(roughly, response, alternative, base, candidates)))
    least = min((found.chi2 for fits in rough for found in fits.values()), default=0.0)
    readings = []
    for alternative, (nominal, base), begun in zip(given, bases, rough, strict=True):
        say(f"fitting to all frequencies: {alternative.name}")
        key = (alternative.model_dump(), terms)
        fits = store.remember("named", key, partial(on_all, response, alternative, begun, least))
        repaired, equivalent = choose(base, fits, len(ranking))
        readings.append(Reading(alternative, nominal, base, repaired, ranking, equivalent))
    best = min(readings, key=lambda r: r.repaired.chi2)
    diagnosis = _diagnosis(response, best, readings)
    diagnosis.crashes = list(dict.fromkeys(response.crashes))
    diagnosis.seconds = time.monotonic() - since
    return diagnosis, readings


def leaders(ranked: Sequence[Candidate]) -> list[Candidate]:
    """Those of the best kinds. On one shaft the motor's and the gearhead's friction score the same, and a place among
    the best is worth more to other physics."""
    kinds = list(dict.fromkeys(c.term.split(".")[-1] for c in ranked))[:FITTED]
    return [c for c in ranked if c.term.split(".")[-1] in kinds]


def choose(base: Fit, fits: Mapping[str, Fit], looked: int) -> tuple[Fit, tuple[str, ...]]:
    """The best fit where it takes away more than having looked at so many terms would, and what does as well.

    Gains count in units of what is left per degree of freedom, as in an F test: far from noise, a little is nothing.
    """
    needed = 2 * np.log(looked) + thresholds.LOOK_ELSEWHERE

    def gain(found: Fit) -> float:
        return (base.chi2 - found.chi2) / max(1.0, found.chi2 / (len(found.residual) - len(found.x)))

    good = sorted((name for name in fits if gain(fits[name]) > needed), key=lambda name: fits[name].chi2)
    if not good:
        return base, ()
    best = fits[good[0]]
    return best, tuple(name for name in good[1:] if fits[name].chi2 - best.chi2 < thresholds.INDISTINGUISHABLE)


def _diagnosis(response: Response, best: Reading, readings: Sequence[Reading]) -> Diagnosis:
    found = best.repaired
    units = {name: p.unit for name, p in _parameters(response).items()}
    estimates = found.estimates(units)
    findings = []
    dof = len(response.recording.time) - len(found.x)
    where, left = _where(response, best), max(found.chi2 - dof, 0.0)

    def finding(term: str, alike: tuple[str, ...], parameters: dict[str, Estimate], gain: float) -> Finding:
        sure = confidence(gain, left)
        return Finding(term, alike, sure, None, parameters, where, gain, ground="frequency response")

    for active in found.hypothesis.terms:
        names = [active.term.amplitude, *(s.name for s in active.term.shapes)]
        parameters = {n.split(".", 1)[1]: estimates[n] for n in names}
        gain = best.calibrated.chi2 - found.chi2
        findings.append(finding(active.name, best.equivalent, parameters, gain))
    if best.alternative.term:
        others = [r.repaired.chi2 for r in readings if r.alternative.term != best.alternative.term]
        gain = max(min(others) - found.chi2, 0.0) if others else 0.0
        findings.append(finding(best.alternative.term, (), {}, gain))
    explained = found.chi2 < dof + thresholds.LEFT_SIGMA * np.sqrt(2 * dof)
    return Diagnosis(
        ("explained" if findings else "nothing_missing") if explained else "undecided",
        findings,
        best.calibrated.estimates(units),
        estimates,
        ranking=[best.ranking],
    )


def _parameters(response: Response) -> Mapping[str, Parameter]:
    with FmuPlant({"default": response.system}) as plant:
        return plant.parameters


def _where(response: Response, best: Reading) -> dict[str, object]:
    """The band in which the finding takes most of the misfit away."""
    gained = best.calibrated.residual**2 - best.repaired.residual**2
    share = np.maximum(gained, 0.0)
    order = np.argsort(-share)
    most = order[: int(np.searchsorted(np.cumsum(share[order]), BAND * share.sum())) + 1]
    omega = response.recording.time[most]
    part = float(share[most].sum() / max(share.sum(), 1e-300))
    band = Condition("omega", "in a band", part, len(most) / len(share), float(omega.min()), float(omega.max()))
    return {"recording": response.recording.name, "channel": CHANNEL, "by_regime": [band.to_json()]}
