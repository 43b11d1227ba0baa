"""The scoreboard of machines that no model fits down to the noise: every one has a background that is worth no name.

An effect has to stand out of its machine's background, confidences count, and so does what a repair predicts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cobot_joint.diagnosis.evaluation.score import (
    NOISE,
    accepted,
    component_of,
    in_form,
    is_unlisted,
    places,
    terms_of,
)
from cobot_joint.diagnosis.store import read_object

MOST_TERMS = 4  # that one finding may carry
CLAIM = 0.5  # confidence from which on a finding counts as said
HORIZON = 0.2  # s; predictions that reach less far are no test of a model
SPEAKABLE = 0.02  # error above noise, in squares of the noise, below which there is nothing to improve
WORSE = 1.02  # ratio of errors above which a repair does harm


def of_field(answers: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether these are answers to campaigns with a background."""
    return any("style" in answer for answer in answers.values())


def scoreboard(answers: Mapping[str, Mapping[str, Any]], results: Path) -> dict[str, Any]:
    """{"summary": counts, "rows": per case}; results: folder of <case>/diagnosis.json and verify.json.

    UserError: the answers have another form.
    """
    with in_form():
        rows = [_row(case, answers[case], results / case) for case in sorted(answers)]
    effects = [e for r in rows for e in r["effects"]]
    ratios = [r["ratio"] for r in rows if r["ratio"] is not None]
    squares = [s for r in rows for s in r["squares"]]
    summary = {
        "cases": len(rows),
        "answered": sum(r["answered"] for r in rows),
        "right": sum(r["right"] for r in rows),
        "effects": len(effects),
        "named": sum(e["named"] for e in effects),
        "located": sum(e["located"] for e in effects),
        "false": sum(len(r["false"]) for r in rows),
        "healthy_with_a_claim": sum(bool(r["false"]) for r in rows if not r["effects"]),
        "verified": len(ratios),
        "better": sum(ratio < 1 for ratio in ratios),
        "worse": sum(r["worse"] for r in rows),
        "brier": round(sum(squares) / len(squares), 4) if squares else None,
    }
    return {"summary": summary, "rows": rows}


@dataclass(frozen=True)
class _Said:
    """A finding as it is scored."""

    terms: Sequence[str]
    component: str
    sure: float  # one that states no confidence is sure
    unlisted: bool

    @property
    def brief(self) -> bool:
        """Does it carry no more names than one finding may?"""
        return len(self.terms) <= MOST_TERMS

    def names(self, effect: Mapping[str, Any], listed: bool, where: set[str]) -> bool:
        """Whether it names a listed effect, or recognises an unlisted one at its component."""
        if listed:
            return self.brief and any(term in accepted(effect) for term in self.terms)
        return self.brief and self.unlisted and self.component in where


def _said(finding: Mapping[str, Any]) -> _Said:
    sure = finding.get("confidence")
    known = isinstance(sure, (int, float)) and math.isfinite(sure)
    return _Said(terms_of(finding), component_of(finding), sure if known else 1.0, is_unlisted(finding))  # type: ignore[arg-type]


def _row(case: str, answer: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    given, _ = read_object(folder / "diagnosis.json")
    verify, _ = read_object(folder / "verify.json")
    diagnosis = given or {}
    said = [_said(f) for f in diagnosis.get("findings") or [] if isinstance(f, dict) and terms_of(f)]
    effects, naming = [], set()
    for effect in answer["effects"]:
        listed, where = places(effect)
        hits = [k for k, s in enumerate(said) if s.names(effect, listed, where)]
        naming.update(hits)
        effects.append(
            {
                "name": effect["name"],
                "over_background": effect["over_background"],
                "where": sorted(where),
                "named": bool(hits),
                "sure": max((said[k].sure for k in hits), default=0.0),
                "located": bool(hits) or any(s.component in where for s in said),
            }
        )
    false, rest = _false([s for k, s in enumerate(said) if k not in naming], effects)
    ratio = error_ratio(verify) if verify is not None else None
    return {
        "case": case,
        "style": answer["style"],
        "answered": given is not None,
        "effects": effects,
        "false": false,
        "ratio": ratio,
        "worse": ratio is not None and ratio > WORSE and diagnosis.get("repair") != "withheld",
        "squares": [(1 - e["sure"]) ** 2 for e in effects] + [sure**2 for sure in rest],
        "right": given is not None and not false and all(e["named"] and e["sure"] >= CLAIM for e in effects),
    }


def _false(
    others: Sequence[_Said], effects: Sequence[Mapping[str, Any]]
) -> tuple[list[tuple[str, float]], list[float]]:
    """(term, confidence) of findings that name nothing, and the confidences of all that are no abstention.

    An abstention is `unlisted` at the component of an effect that stays unnamed. Where something is concealed, one
    further `unlisted` is forgiven.
    """
    unnamed = {place for e in effects if not e["named"] for place in e["where"]}
    forgiven, false, rest = not effects, [], []
    for s in others:
        abstains = s.unlisted and s.brief
        if abstains and s.component in unnamed:
            continue
        rest.append(s.sure)
        if s.brief and s.sure < CLAIM:
            continue
        if abstains and not forgiven:
            forgiven = True
        else:
            false.append((s.terms[0], s.sure))
    return false, rest


def error_ratio(verify: Mapping[str, Any]) -> float | None:
    """Held-out error above the logger's noise, repaired over calibrated: of predictions where they reach far enough.

    None: there was none to speak of. Infinite: a figure of the repair is missing or not finite.
    """
    before = after = 0.0
    for name, channel in (verify.get("channels") or {}).items():
        predicted = channel.get("predicted") or {}
        figures = predicted if (predicted.get("horizon") or 0) >= HORIZON else channel
        try:
            before += max((figures["calibrated"] / NOISE[name]) ** 2 - 1, 0)
            after += max((figures["repaired"] / NOISE[name]) ** 2 - 1, 0)
        except (KeyError, TypeError):
            return math.inf
    if not math.isfinite(after):
        return math.inf
    return after / before if before > SPEAKABLE else None
