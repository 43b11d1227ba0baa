"""report.html: one self-contained file that says what was found, where, how sure that is, and how much better the
repaired system fits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup, escape

from cobot_joint.diagnosis.data.conditioning import ChannelQuality
from cobot_joint.diagnosis.repair.compare import Comparison
from cobot_joint.diagnosis.report import explained, headline, overlays, pictures
from cobot_joint.diagnosis.report.chain import chain_of, marked
from cobot_joint.diagnosis.report.headline import TermText, interval, number, percent, pretty_unit
from cobot_joint.diagnosis.report.localization_pictures import located_pictures
from cobot_joint.diagnosis.report.pictures import Picture
from cobot_joint.diagnosis.report.words import pulses
from cobot_joint.files import write_atomically
from cobot_joint.mathml import typeset
from cobot_joint.system.model import System


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
    created: date | None = None
    system: System | None = None  # that of the fullest set-up, to be drawn
    own_pictures: Sequence[Picture] = ()  # of what is no run over time; the first says most


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
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "percent": percent, "unit": pretty_unit, "interval": interval}
    d = data.diagnosis
    noise = {name: c["noise"] or 0.0 for name, c in d["channels"].items()}
    first = overlays.held_out_first(data.compared, noise)
    shown = [overlays.before_after(first, noise, data.units, bool(d["findings"]))] if first else []
    return environment.get_template("report.html.jinja").render(
        title=data.title,
        verdict=headline.verdict_sentence(d, data.terms),
        verdict_kind="undecided" if d.get("repair") == "withheld" else d["verdict"],
        repaired="withheld" if d.get("repair") == "withheld" else "repaired",
        chains=_chains(data),
        findings=[_finding(f, d, data.terms) for f in d["findings"]],
        errors=headline.errors(d, data.units),
        held_out=any("holdout" in c for c in d["channels"].values()),
        next_step=headline.next_step(d),
        overlay=next(iter([*shown, *data.own_pictures]), None),
        channels=[{"name": name, "unit": data.units.get(name, ""), **c} for name, c in d["channels"].items()],
        fit_pictures=[pictures.before_and_after(d), *data.own_pictures[0 if shown else 1 :]],
        finding_pictures=pictures.of_findings(d["findings"]),
        recorded=[overlays.whole(c, data.quality, data.units) for c in data.compared],
        dependence=_dependence(data, noise),
        readings=d.get("readings", ()),
        discrepancy=d.get("discrepancy", ()),
        notes=d.get("notes", ()),
        parameters=_parameters(d, data),
        tried=[(term, headline.title_of(term, data.terms), gain) for term, gain in data.tried],
        where=_where(d, data.compared),
        script=pictures.script(),
        recordings=[_recording(c) for c in data.compared],
        quality=[(name, data.units.get(name, ""), q) for name, q in data.quality.items()],
        provenance=data.provenance,
        glossary=explained.glossary,
        made=" · ".join(filter(None, (data.created.isoformat() if data.created else "", data.provenance.get("tool")))),
    )


def _dependence(data: ReportData, noise: Mapping[str, float]) -> list[Picture]:
    """What is left over every recorded signal; of tables there are too few rows."""
    runs = [c for c in data.compared if not c.recording.scatter]
    return [overlays.over_signals(runs, noise, data.units)] if runs else []


def _chains(data: ReportData) -> list[dict[str, Any]]:
    """The chain of units in a row and upright; none where the system is not known."""
    if data.system is None:
        return []
    d = data.diagnosis
    found: dict[str, list[str]] = {}
    for n, f in enumerate(d["findings"], 1):
        title = headline.title_of(f["term"], data.terms)
        found.setdefault(f["component"], []).append(f"{n}. {title.partition(' (')[0]}")
    possible = {term.split(".")[0] for f in d["findings"] for term in f.get("equivalent") or []}
    if not found and d["verdict"] == "undecided":
        possible = set((d.get("located") or {}).get("components", {}).get("suspects", ()))
    places = chain_of(data.system, list(d["channels"]))
    return [marked(places, found, possible, upright) for upright in (False, True)]


def _finding(f: Mapping[str, Any], d: Mapping[str, Any], terms: Mapping[str, TermText]) -> dict[str, Any]:
    text = terms.get(f["term"], TermText(headline.title_of(f["term"], terms)))
    where = f.get("where") or {}
    shown = [f["words"]] if f.get("words") else [str(where[k]) for k in ("recording", "regime") if where.get(k)]
    return {
        "term": f["term"],
        "title": "an unmodelled effect" if f.get("shape") else text.title,
        "component": f["component"],
        "equation": Markup(typeset(text.equation)),
        "source": explained.cited(text.source),
        "large": headline.how_large(f, terms),
        "sure": headline.how_sure(f, d),
        "onset": f.get("onset"),
        "at_times": bool(f.get("load_history")),
        "where": shown,
        "parameters": f.get("parameters") or {},
        "equivalent": [*((term, headline.title_of(term, terms)) for term in f.get("equivalent") or []), *_misread(d)],
        "shape": _shape(f.get("shape")) or _loads(f.get("load_history")),
    }


def _misread(d: Mapping[str, Any]) -> list[tuple[str, str]]:
    """A channel that is misread explains as much as a finding beside it."""
    return [(d["misreading"]["column"], "a log that is wrong, of")] if d.get("misreading") else []


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
    """An unlisted effect's form: its formula typeset, or in words."""
    if not shape:
        return None
    port, formula = escape(shape["port"]), shape.get("formula")
    form = Markup("{} = {}").format(port, Markup(typeset(formula))) if formula else Markup("a table at {}").format(port)
    on = f", of {', '.join(shape['signals'])}" if shape.get("signals") else ""
    return form + f"{on}; takes away {percent(min(shape.get('explains') or 0.0, 1.0))} of the structure"


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
        "role": overlays.ROLES[r.role],
        "setup": r.setup,
        "seconds": float(r.time[-1] - r.time[0]),
        "step": r.step,
        "notes": [*r.notes, *(f"{out.channel}: {out.words}" for out in r.left_out)],
    }
