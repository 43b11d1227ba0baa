"""The report's first screen in words: what is missing, how large, how sure and on what ground, what to do next."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.repair.gate import fails, horizon, removed, worsened
from cobot_joint.diagnosis.report.localization_words import listed
from cobot_joint.diagnosis.report.words import load_history, misread
from cobot_joint.diagnosis.selection.confidence import COUNTED_BESIDE, counted

Json = Mapping[str, Any]
NOT_COUNTED = {  # what stands behind a confidence -> what is to be said of it
    "background": "by the share that it takes beside a background; short of even odds no count stands behind it",
    "recorded motion": "by what it predicts along the recorded motion; short of even odds no count stands behind it",
    "table": "findings from tables have not been counted",
    "frequency response": "findings from frequency responses have not been counted",
    "term not counted": "findings of this effect have not been counted",
}
UNKNOWN = 20.0  # times a value, from which on its 95 % interval is no knowledge of its size
SEEN = 1e-9  # of what is compared: noise below it is what rounding leaves


@dataclass(frozen=True)
class TermText:
    """What a unit's annotation says of a term. parameters: name within the term -> what it is."""

    title: str
    equation: str = ""
    source: str = ""
    parameters: Mapping[str, str] = field(default_factory=dict)


def verdict_sentence(d: Json, terms: Mapping[str, TermText]) -> str:
    """The answer in one sentence."""
    findings = d["findings"]
    if d["verdict"] == "nothing_missing" and d.get("discrepancy"):
        said = "what remains is diffuse model error that no known effect explains"
        return f"Nothing is worth a name: {said}{_largest(d['discrepancy'])}."
    if d["verdict"] == "nothing_missing":
        return "Nothing is missing: inside its tolerances the system explains these recordings down to the noise."
    if m := d.get("misreading"):
        takes = f"which alone explains {percent(m['takes'])} of the difference"
        others = [f"{_parameter(f)} is outside its tolerance" for f in findings if is_parameter(f["term"], terms)]
        return f"Undecided: {', or '.join([f'{misread(m)}, {takes}', *others])}, or the machine lacks something."
    if not findings and (late := [words.split(";")[0] for words in d.get("mistimed", ())]):
        return f"Undecided: {' and '.join(late)}, or the machine lacks something."
    if not findings:
        said = "The recordings differ from the system by more than noise and tolerances, and no explanation stands out"
        return f"{said}{_farthest_off(d['channels'])}{_largest(d.get('discrepancy') or [])}."
    if d.get("repair") == "withheld":
        together, verb, does = ("together ", "fit", "do") if len(findings) > 1 else ("", "fits", "does")
        no_better, predicts = f"{verb} no better than a re-fit", f"{verb}, but {does} not predict"
        worse = together + (no_better if fails(d["channels"]) == "train" else predicts)
        return f"Undecided: {_suspects(findings, terms)} {worse}: the repair is withheld."
    nothing_claimed = max(f.get("confidence") or 0.0 for f in findings) < thresholds.EVEN
    claims = [f for f in findings if nothing_claimed or (f.get("confidence") or 0.0) >= thresholds.EVEN]
    listed_first = sorted(claims, key=lambda f: bool(f.get("shape")))
    outside = [f for f in claims if is_parameter(f["term"], terms)]
    better = improvement(d)
    how = "a value that fits" if len(outside) == len(claims) else "modelling it"
    tail = "" if better is None else f"; {how} removes {percent(better[0])} of the error above the noise{better[1]}"
    if unsure := [_said(f, terms) for f in findings if f not in claims]:
        them = "it" if len(unsure) == 1 else "them"
        tail += f". No claim, though the repaired system has {them}: {' and '.join(unsure)}"
    if nothing_claimed:
        nearest = " and ".join(_said(f, terms) for f in listed_first)
        cut = "Time was up before everything was tried, so that nothing is claimed" if d.get("left_out") else ""
        return f"{cut or 'No effect reaches 50 % confidence'}; the closest is {nearest}{tail}."
    return f"{_claimed([f for f in listed_first if f not in outside], outside, terms)}{tail}."


def _claimed(lacking: Sequence[Json], outside: Sequence[Json], terms: Mapping[str, TermText]) -> str:
    """Claims, what the model lacks first unless a parameter is surer than all of it."""
    outside = sorted(outside, key=lambda f: -f["confidence"])
    parts = [f"{_parameter(f)} is outside its tolerance ({percent(f['confidence'])} sure)" for f in outside]
    if not lacking:
        return ", and ".join(parts)
    lacks = f"the model lacks {' and '.join(_said(f, terms) for f in lacking)}"
    surest = max(f["confidence"] for f in lacking)
    first = sum(f["confidence"] > surest for f in outside)
    said = ", and ".join([*parts[:first], lacks, *parts[first:]])
    return said if first else said.replace("the", "The", 1)


def _said(f: Json, terms: Mapping[str, TermText]) -> str:
    """A finding with its place and confidence."""
    sure = f"({percent(f.get('confidence'))} sure)"
    if f.get("shape"):
        return f"an effect that is on no list, at {_units(f)} {sure}"
    places = [term.split(".")[0] for term in f.get("equivalent") or () if is_unlisted(term)]
    rival = f", or an effect that is on no list at {listed(places, 'or')}" if places else ""
    return f"{title_of(f['term'], terms)} in {_units(f)}{rival} {sure}"


def _farthest_off(channels: Mapping[str, Json]) -> str:
    """The channel of which the re-fitted system is farthest off in training runs; "": its noise is not known."""
    known = {n: (c["train"]["calibrated"], c["noise"]) for n, c in channels.items() if c.get("noise") and "train" in c}
    times = {name: off / noise for name, (off, noise) in known.items() if off is not None and noise > SEEN * off}
    if not times:
        return ""
    name = max(times, key=times.__getitem__)
    return f"; farthest off is {name}, {number(times[name])} times its noise (rms)"


def _parameter(f: Json) -> str:
    """name of component"""
    return f"{f['term'].split('.', 1)[1]} of {_units(f)}"


def _units(f: Json) -> str:
    """The unit that has it, or those of which each may."""
    own, name = f["term"].split(".", 1)
    others = [term.split(".", 1) for term in f.get("equivalent") or ()]
    return listed([own, *(unit for unit, same in others if same == name)], "or")


def _largest(discrepancy: Sequence[Json]) -> str:
    """Where most of a background lies, as far as it repeats; "": it is spread."""
    row = max(discrepancy, key=lambda row: row.get("share", 0.0), default={})
    if row.get("share", 0.0) < thresholds.HOLDS:
        return ""
    component, port = row["port"].split(".", 1)
    place = listed([component, *row.get("alike", ())], "or")
    over = {"w": "speed", "phi": "angle"}.get(row["variable"], row["variable"])
    size = f"{number(row['rms'])} {pretty_unit(row['unit'])} rms at {port}"
    return f"; {percent(row['share'])} of what repeats over speed and load lies in {place}, over its {over} ({size})"


def _suspects(findings: Sequence[Json], terms: Mapping[str, TermText]) -> str:
    """Titles and places, without a claim."""
    titles = ["an effect that is on no list" if f.get("shape") else title_of(f["term"], terms) for f in findings]
    return " and ".join(f"{title} in {f['component']}" for title, f in zip(titles, findings, strict=True))


def improvement(d: Json) -> tuple[float, str] | None:
    """Share of the squared error above noise that the repair removes, and in which runs; None: none to say."""
    found = removed(d["channels"])
    if found is None:
        return None
    over = horizon(d["channels"], found[1])
    runs = {"holdout": ", in runs that it has not seen", "train": ""}[found[1]]
    worse = [f"{name} errs {number(times, 2)} times as much" for name, times in worsened(d["channels"], found[1])]
    but = f", though {' and '.join(worse)}" if worse else ""
    return found[0], f"{f' of predictions over {over:g} s' if over else ''}{runs}{but}"


def how_large(f: Json, terms: Mapping[str, TermText]) -> list[str]:
    """Its parameters in words, with units and intervals."""
    known = terms.get(f["term"], TermText("")).parameters
    said = []
    for name, p in f.get("parameters", {}).items():
        unit = "" if p["unit"] in ("", "1") else f" {pretty_unit(p['unit'])}"
        said.append(f"{known.get(name) or name}: {number(p['value'])}{unit}{_interval(p)}")
    if history := load_history(f.get("load_history")):
        said.append(history)
    if shape := f.get("shape"):
        table = shape.get("table")
        size = (
            f"up to {number(max(map(abs, table['value'])))} {pretty_unit(shape['unit'])}" if table else shape["formula"]
        )
        said.append(
            f"{size} at {shape['port']}; explains {percent(min(shape.get('explains') or 0.0, 1.0))} of what was left"
        )
    return said


def _interval(p: Json) -> str:
    """Of a parameter, in brackets; "": it has none."""
    said = interval(p)
    return f" ({said})" if said else ""


def interval(p: Json) -> str:
    """Of a parameter in words; one that is many times as wide as the value says that nothing is known of it."""
    if not p.get("ci95") or None in p["ci95"]:
        return ""
    low, high = p["ci95"]
    if high - low > UNKNOWN * abs(p["value"]) > 0:
        return "not determined by these recordings"
    return "{} to {}".format(*interval_of(low, high))


def errors(d: Json, units: Mapping[str, str]) -> list[str]:
    """Per channel the error before and after, on held-out runs where there are some."""
    role = "holdout" if any("holdout" in c for c in d["channels"].values()) else "train"
    said = []
    for name, c in d["channels"].items():
        if role not in c or c[role]["calibrated"] is None:
            continue
        before, after, unit = c[role]["calibrated"], c[role]["repaired"], units.get(name) or ""
        change = f"{number(before)} → {number(after)}" if d["findings"] else number(before)
        noise = f", noise {number(c['noise'])}" if (c["noise"] or 0.0) > SEEN * max(before, after or 0.0) else ""
        said.append(f"{name}: {change} {'' if unit == '1' else pretty_unit(unit)}{noise}")
    return said


def how_sure(f: Json, d: Json) -> str:
    """The confidence, and what it was counted on; where nothing was counted, that."""
    given = f.get("confidence")
    if given is None:
        return "not known"
    said = percent(given)
    if d.get("repair") == "withheld":
        return f"{said}: less than even, since its repair is withheld"
    if f.get("limited_by"):
        return f"{said}: {'less than even' if given < thresholds.EVEN else 'no more'}, since {f['limited_by']}"
    ground = f.get("confidence_from")
    if ground in ("background", "recorded motion") and given >= thresholds.EVEN:
        claims, true = COUNTED_BESIDE
        return f"{said}; of {claims} findings given 50 % and more on drawn machines with backgrounds {true} were right"
    if ground != "drawn machines":
        return f"{said}; {NOT_COUNTED.get(ground or '', 'what stands behind it is not on record')}"
    (low, high), findings, right = counted(given)
    if not findings:
        return f"{said}; no finding as sure as this has been counted"
    return (
        f"{said}; of {findings} findings given {100 * low:.0f} to {100 * min(high, 1):.0f} % on drawn machines with "
        f"known answers {right} {'was' if right == 1 else 'were'} right"
    )


def next_step(d: Json) -> str:
    """What to do now."""
    if d.get("next_experiment"):
        return str(d["next_experiment"])
    if d["verdict"] == "nothing_missing":
        return "Nothing has to be added. The calibrated values fit best; repaired.ssp has them."
    if d.get("repair") == "withheld":
        return (
            "Do not use the repair. Look in report.html where the difference lies, and record a longer run with more "
            "movement."
        )
    if not d["findings"]:
        return "Look in report.html where the difference lies: by component, condition and time."
    tested = any("holdout" in c for c in d["channels"].values())
    if max(f.get("confidence") or 0.0 for f in d["findings"]) < thresholds.EVEN:
        return (
            "Do not rely on the name: look in report.html where the difference lies. repaired.ssp has the nearest one "
            "modelled."
        )
    use = "repaired.ssp has it modelled, and opens in other simulators."
    return use if tested else f'{use} Record one more run and give it role = "holdout": the repair is untested.'


def title_of(term: str, terms: Mapping[str, TermText]) -> str:
    """A term's title without what follows its colon; of a base parameter its name."""
    if term in terms:
        return terms[term].title.split(":")[0]
    if is_unlisted(term):
        return "effect on no list"
    name = term.split(".", 1)[-1]
    return f"{name} outside its tolerance" if is_parameter(term, terms) else name.replace("_", " ")


def is_unlisted(term: str) -> bool:
    """Whether it stands for an effect that is on no list."""
    return term.endswith(".unlisted")


def is_parameter(term: str, terms: Mapping[str, TermText]) -> bool:
    """Whether it is a base parameter, `component.part.name`, and no term."""
    return term not in terms and term.count(".") > 1


def first_clause(description: str | None) -> str:
    """`time constant` of `time constant, 1/(2 pi f_c); 0: no filter`"""
    return re.split(r"[,;:(]", description or "")[0].strip()


def interval_of(lower: float, upper: float) -> tuple[str, str]:
    """Both ends, with as many digits as it takes to tell them apart, up to six."""
    digits = next((n for n in range(3, 6) if number(lower, n) != number(upper, n)), 6)
    return number(lower, digits), number(upper, digits)


def pretty_unit(unit: str) -> str:
    """`kg.m2` as kg.m²"""
    return re.sub(r"(?<=[A-Za-z])\d", lambda digit: "⁰¹²³⁴⁵⁶⁷⁸⁹"[int(digit[0])], unit)


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
    """0.98 -> 98 %; never 100 % for less than all, nor 50 % for less than even."""
    if x is None:
        return "–"
    if thresholds.EVEN - 0.005 <= x < thresholds.EVEN:
        return f"{100 * min(x, thresholds.EVEN - 1e-3):.1f} %"
    return f"{100 * x:.0f} %" if x <= 0.99 or x >= 1 else f"{100 * min(x, 0.999):.1f} %"
