"""The scoreboard: answers of the tool against what was concealed, and the seals that fixed the latter beforehand."""

from __future__ import annotations

import hashlib
import json
import math
import statistics
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

from cobot_joint.diagnosis.store import read_object
from cobot_joint.errors import UserError

NOISE = {
    "i_motor": 4.06e-3,
    "w_motor": 0.320,
    "tau_sensor": 5.19e-3,
}  # of the bench's logger: white noise and quantisation
OUT_OF_TOLERANCE = {"backlash": ("planetary_gear.mesh.b",), "load_friction": ("planetary_gear.mesh.eta",)}
ALWAYS_THIN = 2e-4  # N.m; shear-thinning below this torque is viscous friction that is too low, no more


def seal(answer: Mapping[str, Any]) -> str:
    """SHA-256 of an answer without its salt as sorted JSON, followed by the salt."""
    bare = {key: value for key, value in answer.items() if key != "salt"}
    return hashlib.sha256((json.dumps(bare, sort_keys=True) + answer.get("salt", "")).encode()).hexdigest()


def broken_seals(answers: Mapping[str, Mapping[str, Any]], seals: Mapping[str, str]) -> dict[str, str]:
    """case -> why, for every case whose answer is not the one that was sealed."""
    broken = {}
    for case in sorted(set(answers) | set(seals)):
        if case not in seals:
            broken[case] = "has no seal"
        elif case not in answers:
            broken[case] = "is sealed and has no answer"
        elif seal(answers[case]) != seals[case]:
            broken[case] = f"answer has SHA-256 {seal(answers[case])[:12]}..., sealed was {seals[case][:12]}..."
    return broken


def scoreboard(answers: Mapping[str, Mapping[str, Any]], results: Path) -> dict[str, Any]:
    """{"summary": rates with 95 % Wilson intervals, "rows": per case}; results: folder of <case>/diagnosis.json."""
    with in_form():
        rows = [_row(case, answers[case], results / case) for case in sorted(answers)]
    healthy = [r for r in rows if r["healthy"]]
    effects = [e for r in rows for e in r["effects"]]
    listed = [e for e in effects if e["listed"]]
    unlisted = [e for e in effects if not e["listed"]]
    single = [r["effects"][0] for r in rows if len(r["effects"]) == 1 and r["effects"][0]["listed"]]
    excess = [r["excess_removed"] for r in rows if r["excess_removed"] is not None]
    onset = [e["onset_error"] for e in effects if e["onset_error"] is not None]
    confidences = [c for r in rows for c in r["conf"]]
    false, true = sum(len(r["false"]) for r in rows), sum(e["named"] for e in effects)
    summary = {
        "cases": len(rows),
        "answered": sum(r["why"] is None for r in rows),
        "right": rate(sum(r["right"] for r in rows), len(rows)),
        "located": rate(sum(e["located"] for e in effects), len(effects)),
        "named": rate(sum(e["named"] for e in listed), len(listed)),
        "named_single": rate(sum(e["named"] for e in single), len(single)),
        "unlisted": rate(sum(e["named"] for e in unlisted), len(unlisted)),
        "healthy_with_a_claim": rate(sum(bool(r["false"]) for r in healthy), len(healthy)),
        "false_claims": rate(false, false + true),
        "excess_error_removed_median": round(statistics.median(excess), 4) if excess else None,
        "onset_error_median_s": statistics.median(onset) if onset else None,
        "brier": round(statistics.fmean((c - t) ** 2 for c, t in confidences), 4) if confidences else None,
    }
    return {"summary": summary, "rows": rows}


@contextmanager
def in_form() -> Iterator[None]:
    """UserError: what is looked for in answers.json is not there."""
    try:
        yield
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise UserError(f"answers: not in the form of answers.json: {error!r}") from error


def rate(k: int, n: int) -> dict[str, Any]:
    """k of n with its 95 % Wilson interval"""
    if n == 0:
        return {"k": k, "n": n, "rate": None, "ci95": None}
    interval = binomtest(k, n).proportion_ci(0.95, method="wilson")
    return {"k": k, "n": n, "rate": round(k / n, 4), "ci95": [round(interval.low, 3), round(interval.high, 3)]}


def _row(case: str, answer: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    diagnosis, why = read_object(folder / "diagnosis.json")
    effects, false, conf = _compare(answer, diagnosis or {})
    healthy = not answer["effects"]
    quiet = not healthy or (diagnosis or {}).get("verdict") == "nothing_missing"
    verify, _ = read_object(folder / "verify.json")
    return {
        "case": case,
        "effects": effects,
        "false": false,
        "conf": conf,
        "verdict": (diagnosis or {}).get("verdict"),
        "why": why,
        "healthy": healthy,
        "right": diagnosis is not None and not false and all(e["named"] for e in effects) and quiet,
        "excess_removed": excess_removed(verify) if verify and not healthy else None,
    }


def _compare(answer: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> tuple[list[dict], list[str], list[tuple]]:
    """Effects with what was said of each, terms of findings that name none, (confidence, was it true) of findings.

    A listed effect is named by a finding whose term, or one that it declares equivalent (at most four in all), is
    accepted for it; an unlisted one is recognised by `unlisted` at its component. Such an abstention is also no false
    claim where a listed effect stays unnamed.
    """
    found = [f for f in (diagnosis.get("findings") or []) if isinstance(f, dict)]
    true: set[int] = set()
    rows = []
    for effect in answer["effects"]:
        listed, where = places(effect)
        abstains = [j for j, f in enumerate(found) if is_unlisted(f) and component_of(f) in where]
        named = accepted(effect)
        names = [j for j, f in enumerate(found) if len(terms_of(f)) <= 4 and any(term in named for term in terms_of(f))]
        hits = names if listed else abstains
        true.update(hits or abstains)
        onset = found[hits[0]].get("onset") if hits and effect.get("onset_s") else None
        rows.append(
            {
                "name": effect["name"],
                "listed": listed,
                "named": bool(hits),
                "located": bool(hits) or any(component_of(f) in where for f in found),
                "onset_error": abs(onset - effect["onset_s"]) if isinstance(onset, (int, float)) else None,
            }
        )
    false = [(terms_of(f) or ["?"])[0] for j, f in enumerate(found) if j not in true]
    conf = [(f["confidence"], j in true) for j, f in enumerate(found) if isinstance(f.get("confidence"), (int, float))]
    return rows, false, conf


def places(effect: Mapping[str, Any]) -> tuple[bool, set[str]]:
    """Whether a list names the effect, and the components where it may be said to be."""
    accept = effect["accept"]
    if accept[0].startswith("unlisted:"):
        return False, set(accept[0].split(":")[1].split("|"))
    return True, {term.split(".")[0] for term in accept}


def accepted(effect: Mapping[str, Any]) -> set[str]:
    """Terms that name an effect, and base parameters outside their tolerance where that is what it amounts to."""
    alike = set(OUT_OF_TOLERANCE.get(effect["name"], ()))
    if 0 < effect.get("parameters", {}).get("x_thin_T", 0) < ALWAYS_THIN:
        alike |= {"motor_bldc.friction.d", "planetary_gear.friction.d"}
    return alike.union(effect["accept"])


def terms_of(finding: Mapping[str, Any]) -> list[str]:
    """The term of a finding, and those that it declares equivalent."""
    return [t for t in [finding.get("term"), *(finding.get("equivalent") or [])] if isinstance(t, str)]


def component_of(finding: Mapping[str, Any]) -> str:
    """Of its first term."""
    return terms_of(finding)[0].split(".")[0] if terms_of(finding) else ""


def is_unlisted(finding: Mapping[str, Any]) -> bool:
    """Whether it says that no list names what it found."""
    return bool(terms_of(finding)) and terms_of(finding)[0].endswith(".unlisted")


def excess_removed(verify: Mapping[str, Any]) -> float | None:
    """Share of the held-out error above noise that the repair removes; None where there was none to speak of."""
    before = after = 0.0
    for name, channel in (verify.get("channels") or {}).items():
        noise = NOISE.get(name) or channel.get("noise")
        rms = [channel.get(key) for key in ("calibrated", "repaired")]
        if not noise or not all(isinstance(x, (int, float)) and math.isfinite(x) for x in rms):
            return None
        before += max(0.0, (rms[0] / noise) ** 2 - 1)
        after += max(0.0, (rms[1] / noise) ** 2 - 1)
    return 1 - after / before if before > 0.05 else None
