"""report.html: one self-contained file that says what was found, where, how sure that is, and how much better the
repaired system fits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from cobot_joint.diagnosis.data.conditioning import ChannelQuality
from cobot_joint.diagnosis.repair.compare import Comparison
from cobot_joint.diagnosis.repair.gate import removed
from cobot_joint.diagnosis.report import pictures
from cobot_joint.diagnosis.report.localization_pictures import located_pictures
from cobot_joint.diagnosis.report.words import pulses
from cobot_joint.files import write_atomically


@dataclass(frozen=True)
class TermText:
    """What a unit's annotation says of a term."""

    title: str
    equation: str = ""
    source: str = ""


@dataclass(frozen=True)
class ReportData:
    """Everything that the report shows. diagnosis: as diagnosis.json."""

    title: str
    diagnosis: Mapping[str, Any]
    compared: Sequence[Comparison]
    quality: Mapping[str, ChannelQuality]
    units: Mapping[str, str]  # channel -> unit
    nominal: Mapping[str, float] = field(default_factory=dict)  # parameter -> value as specified
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # parameter -> tolerance
    terms: Mapping[str, TermText] = field(default_factory=dict)  # component.term -> its texts
    tried: Sequence[tuple[str, float]] = ()  # term, chi-square that it alone would take away; the best first
    provenance: Mapping[str, str] = field(default_factory=dict)


def write_report(path: Path, data: ReportData) -> None:
    """Write the report, whole or not at all."""
    text = render(data)
    write_atomically(path, lambda file: file.write_text(text, encoding="utf-8"))


def render(data: ReportData) -> str:
    """The report as HTML; pictures and their script are inside."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("cobot_joint.diagnosis.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {"number": number, "percent": percent}
    d = data.diagnosis
    return environment.get_template("report.html.jinja").render(
        title=data.title,
        verdict=verdict_sentence(d, data.terms),
        verdict_kind=d["verdict"],
        findings=[_finding(f, data.terms) for f in d["findings"]],
        channels=_channels(d, data.units),
        has_holdout=any("holdout" in c for c in d["channels"].values()),
        improvement=improvement(d),
        parameters=_parameters(d, data),
        tried=[(term, _title(term, data.terms), gain) for term, gain in data.tried],
        next_experiment=d.get("next_experiment"),
        where=_where(d, data.compared),
        pictures=pictures.all_pictures(data.compared, d, data.quality, data.units),
        script=pictures.script(),
        recordings=[_recording(c) for c in data.compared],
        quality=[(name, data.units.get(name, ""), q) for name, q in data.quality.items()],
        provenance=data.provenance,
    )


def verdict_sentence(d: Mapping[str, Any], terms: Mapping[str, TermText]) -> str:
    """The answer in one sentence."""
    findings = d["findings"]
    if d["verdict"] == "nothing_missing" and d.get("discrepancy"):
        return "Nothing is worth a name: what the system leaves is a background that no listed term predicts better."
    if d["verdict"] == "nothing_missing":
        return "Nothing is missing: inside its tolerances the system explains these recordings down to the noise."
    if not findings:
        return "The recordings differ from the system by more than noise and tolerances, and no explanation stands out."
    if d.get("repair") == "withheld":
        return f"Undecided: {_suspects(findings, terms)} fits, but does not predict: the repair is withheld."
    named = [f for f in findings if not f.get("shape")]
    parts = [f"{_title(f['term'], terms)} in {f['component']} ({percent(f.get('confidence'))} sure)" for f in named]
    others = [
        f"an effect that is on no list, at {f['component']} ({percent(f.get('confidence'))} sure)"
        for f in findings
        if f not in named
    ]
    better = improvement(d)
    tail = (
        "" if better is None else f"; modelling it removes {percent(better[0])} of the error above the noise{better[1]}"
    )
    return f"The model lacks {' and '.join(parts + others)}{tail}."


def _suspects(findings: Sequence[Mapping[str, Any]], terms: Mapping[str, TermText]) -> str:
    """Titles and places, without a claim."""
    titles = ["an effect that is on no list" if f.get("shape") else _title(f["term"], terms) for f in findings]
    return " and ".join(f"{title} in {f['component']}" for title, f in zip(titles, findings, strict=True))


def improvement(d: Mapping[str, Any]) -> tuple[float, str] | None:
    """Share of the squared error above noise that the repair removes, and in which runs; None: none to say."""
    found = removed(d["channels"])
    return found and (found[0], {"holdout": ", in runs that it has not seen", "train": ""}[found[1]])


def number(x: float | None, digits: int = 3) -> str:
    """Short, with the digits that matter."""
    if x is None:
        return "–"
    text = f"{x:.{digits}g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa}·10{str(int(exponent)).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"
    return text.replace("-", "−")


def percent(x: float | None) -> str:
    """0.98 -> 98 %; never 100 % for less than all."""
    if x is None:
        return "–"
    return f"{100 * x:.0f} %" if x <= 0.99 or x >= 1 else f"{100 * min(x, 0.999):.1f} %"


def _title(term: str, terms: Mapping[str, TermText]) -> str:
    """A term's title without what follows its colon."""
    return terms[term].title.split(":")[0] if term in terms else _words(term.split(".", 1)[-1])


def _words(name: str) -> str:
    return name.replace("_", " ")


def _finding(f: Mapping[str, Any], terms: Mapping[str, TermText]) -> dict[str, Any]:
    text = terms.get(f["term"], TermText(_title(f["term"], terms)))
    where = f.get("where") or {}
    shown = [f["words"]] if f.get("words") else [str(where[k]) for k in ("recording", "regime") if where.get(k)]
    return {
        "term": f["term"],
        "title": "an unmodelled effect" if f.get("shape") else text.title,
        "component": f["component"],
        "equation": text.equation,
        "source": text.source,
        "confidence": f.get("confidence"),
        "onset": f.get("onset"),
        "at_times": bool(f.get("load_history")),
        "where": shown,
        "parameters": f.get("parameters") or {},
        "equivalent": [(term, _title(term, terms)) for term in f.get("equivalent") or []],
        "shape": _shape(f.get("shape")) or _loads(f.get("load_history")),
    }


def _where(d: Mapping[str, Any], compared: Sequence[Comparison]) -> list[dict[str, Any]]:
    """Headings, sentences and pictures of where the difference lies; empty where that was not asked."""
    located = d.get("located")
    if not located:
        return []
    noise = {name: c["noise"] for name, c in d["channels"].items()}
    drawn = located_pictures(located, compared, noise)
    headings = {"components": "By component", "isolability": "", "regimes": "By operating condition", "time": "By time"}
    return [
        {"heading": heading, "words": located["words"][key], "pictures": drawn[key]}
        for key, heading in headings.items()
    ]


def _shape(shape: Mapping[str, Any] | None) -> str | None:
    """An unlisted effect's form in words."""
    if not shape:
        return None
    form = f"{shape['port']} = {shape['formula']}" if shape.get("formula") else f"a table at {shape['port']}"
    on = f", of {', '.join(shape['signals'])}" if shape.get("signals") else ""
    return f"{form}{on}; takes away {percent(min(shape.get('explains') or 0.0, 1.0))} of the structure"


def _loads(history: Mapping[str, Any] | None) -> str | None:
    """External loads while recordings were made, in words: when, how much."""
    if not history:
        return None
    said = []
    for name, c in history["recordings"].items():
        t, value = np.array(c["t"]), np.array(c["value"])
        times = [
            f"{t[k[0]]:.2f} to {t[k[-1]]:.2f} s {value[k][np.argmax(np.abs(value[k]))]:.3g}" for k in pulses(value)
        ]
        said.append(f"in {name} from {', '.join(times)} {history['unit']}")
    return f"at {history['port']}: {'; '.join(said)}"


def _channels(d: Mapping[str, Any], units: Mapping[str, str]) -> list[dict[str, Any]]:
    return [{"name": name, "unit": units.get(name, ""), **c} for name, c in d["channels"].items()]


def _parameters(d: Mapping[str, Any], data: ReportData) -> list[dict[str, Any]]:
    """The repaired system's base parameters beside what was specified and what was calibrated with nothing added, and
    where in the tolerance each lies: 0 at its lower, 1 at its upper bound.
    """
    rows = []
    for name, before in d["calibrated"].items():
        p = d["repaired"].get(name, before)
        lower, upper = data.bounds.get(name, (None, None))
        inside = None if lower is None or upper is None or upper <= lower else (p["value"] - lower) / (upper - lower)
        rows.append(
            {
                "name": name,
                "nominal": data.nominal.get(name),
                "calibrated": before["value"],
                "lower": lower,
                "upper": upper,
                "inside": inside,
                "bound": p.get("at"),
                **p,
            }
        )
    return rows


def _recording(c: Comparison) -> dict[str, Any]:
    r = c.recording
    return {
        "name": r.name,
        "role": r.role,
        "setup": r.setup,
        "seconds": float(r.time[-1] - r.time[0]),
        "step": r.step,
        "notes": r.notes,
    }
