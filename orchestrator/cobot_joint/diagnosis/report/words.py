"""The sentences of diagnosis.json, made from its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.repair.gate import calibration_misleads, fails
from cobot_joint.diagnosis.report import localization_words

Json = Mapping[str, Any]
SLIGHT = 2e-5  # s, s per s; a quartz clock is off by as much
LEFT_OUT = {
    "outlier": "far outside and not compared",
    "clipped": "clipped and not compared",
    "frozen": "frozen and not compared",
    "held": "repeated and not compared",
    "bridged": "repeats of a held input and bridged",
}


def spoken(content: Json) -> dict[str, Any]:
    """diagnosis.json with its sentences: of findings and conditions, of `located`, notes, the next experiment."""
    findings = [_finding(f) for f in content["findings"]]
    located = content["located"]
    return {
        **content,
        "findings": findings,
        "located": {**located, "words": localization_words.located(located)} if located else {},
        "next_experiment": remedy(content.get("misreading")) or next_experiment(content["advice"]),
        "notes": notes(content),
    }


def _finding(f: Json) -> dict[str, Any]:
    if not f["where"].get("by_recording"):
        return {**f, "where": {**f["where"], "regime": band(f["where"])}, "words": ""}
    regime, sentence = localization_words.where(f["where"])
    said = [unmodelled(f["shape"], f["onset"]) or load_history(f.get("load_history")), sentence]
    return {**f, "where": {**f["where"], "regime": regime}, "words": "; ".join(filter(None, said))}


def band(where: Json) -> str:
    """Conditions of a finding that are known without its shares by recording."""
    said = [localization_words.condition(r) for r in where.get("by_regime", [])]
    said += ["from {:.1f} to {:.1f} s".format(*where["time"])] if where.get("time") else []
    return ", ".join(said)


def unmodelled(shape: Json | None, onset: float | None) -> str | None:
    """The form of an effect that is on no list."""
    if not shape:
        return None
    form = shape["formula"] or _table(shape)
    since = "" if onset is None else f" from {onset:.4f} s on"
    return f"no listed term explains it; at {shape['port']} it is {form}{since}"


def _table(shape: Json) -> str:
    (signal,) = (name for name in shape["table"] if name != "value")
    return f"a table over {signal}" + (f", times {shape['factor']}" if shape["factor"] else "")


def load_history(history: Json | None) -> str | None:
    """External loads: how often, how large."""
    if not history:
        return None
    values = [np.array(c["value"]) for c in history["recordings"].values()]
    largest = max(float(np.abs(v).max()) for v in values)
    times = sum(len(pulses(v)) for v in values)
    return f"at {history['port']}, {times} external loads, up to {largest:.4g} {history['unit']}"


def pulses(value: np.ndarray[Any, Any]) -> list[np.ndarray[Any, Any]]:
    """Corners of an outline, load by load: between two zeros in a row nothing acts."""
    return np.split(np.arange(len(value)), np.flatnonzero((value[:-1] == 0) & (value[1:] == 0)) + 1)


def misread(m: Json) -> str:
    """A channel's gain and offset, or its stamps, as far as they are any."""
    other = f" (or {m['alike']} is misread, which fits as well)" if m["alike"] else ""
    if m.get("late"):
        return f"{m['column']} is stamped {' and '.join(_stamped(m))}{other}"
    gain, offset = _off(m)
    said = [f"{m['gain']['value']:.4g} times what is there"] if gain else []
    said += [f"{m['offset']['value']:+.4g} {m['offset']['unit']} off"] if offset else []
    return f"{m['column']} is logged {' and '.join(said)}{other}"


def remedy(m: Json | None) -> str | None:
    """What to do about a channel that is misread; None: there is none."""
    if not m:
        return None
    if m.get("late"):
        late = f"{m['late']['value']:.4g}"
        undone = (
            "record it by the clock of the others, or resample it"
            if _drifts(m)
            else f'say late = {{ "{m["column"]}" = {late} }} in each [[recording]]'
        )
        name = m["column"]
        return (
            f"Hold the clock of {name} against that of the other channels. If it is off, {undone}, and diagnose again; "
            f"if it is right, say scale = 1 for {name} in [channels]: the diagnosis then trusts it and looks for the "
            f"cause in the machine."
        )
    gain, offset = _off(m)
    keys = [f"scale = {1 / m['gain']['value']:.5g}"] if gain else []
    shift = -m["offset"]["value"] / m["gain"]["value"]
    keys += [f'offset = "{shift:.5g} {m["offset"]["unit"]}"'] if offset else []
    return (
        f"Hold {m['column']} against another instrument. If its log is wrong, say {', '.join(keys)} for it in "
        f"[channels] and diagnose again; if it is right, say scale = 1: the diagnosis then trusts it and looks for the "
        f"cause in the machine."
    )


def _stamped(m: Json) -> list[str]:
    """How far its stamps are off: at the beginning, and what is added."""
    late, rate = m["late"]["value"], m["rate"]["value"]
    drifts = _drifts(m)
    said = [f"{1e3 * abs(late):.3g} ms {'late' if late > 0 else 'early'}"] if not drifts or abs(late) > SLIGHT else []
    said += [f"{1e3 * abs(rate):.3g} ms per s {'later' if rate > 0 else 'earlier'}"] if drifts else []
    return said


def _drifts(m: Json) -> bool:
    return _excludes(m["rate"], 0.0) and abs(m["rate"]["value"]) > SLIGHT


def _off(m: Json) -> tuple[bool, bool]:
    """Whether gain and offset are off beyond their intervals; both, where it takes both of them together."""
    found = _excludes(m["gain"], 1.0), _excludes(m["offset"], 0.0)
    return found if any(found) else (True, True)


def _excludes(estimate: Json, value: float) -> bool:
    low, high = estimate["ci95"]
    return None not in (low, high) and bool(not low <= value <= high)


def next_experiment(advice: Sequence[Json]) -> str | None:
    """What to record next; None where every finding stands alone."""
    return " ".join(dict.fromkeys(_advice(a) for a in advice)) or None


def _advice(a: Json) -> str:
    if a["uncouple"]:
        units = [t.split(".")[0] for t in a["terms"]]
        name = a["terms"][0].split(".")[1]
        shared = f"{name}: {' and '.join(units)} share a shaft that the channels see as one"
        return f"{shared}; run {a['uncouple']} uncoupled, driven as before, and compare."
    pair, what = " or ".join(a["terms"]), f"{a['experiment']}"
    none = f"{pair}: no experiment with these channels separates them"
    if a["chi2"] < thresholds.SEPARATES:
        return f"{none}, nor would another output of the units."
    if a["channel"]:
        return f"{none}; {a['channel']} logged as well, {what} would, by a chi-square of {a['chi2']:.0f}."
    return f"{pair}: {what}, {a['seconds']:.0f} s, would differ by a chi-square of {a['chi2']:.0f} after a re-fit."


def notes(content: Json) -> list[str]:
    """What has to be said beside the verdict."""
    said = []
    if calibration_misleads(content["channels"]):
        said.append("the re-fitted base model predicts held-out runs worse than the system as specified")
    if content["repair"] == "withheld":
        said.append(
            "what was found fits the training runs worse than the re-fitted base model"
            if fails(content["channels"]) == "train"
            else "what was found does not predict held-out runs better than the system without it"
        )
    if strained := content.get("strained"):
        said.append(
            f"{len(strained)} of the {len(content['calibrated'])} parameters that may move end at the ends of their "
            f"tolerances ({', '.join(strained)}): one that may not move is wrong, or tolerances are too narrow; give a "
            "range in [tolerances] to what is not certain"
        )
    if refuted := content.get("refuted"):
        one = "outside its tolerance improves the training runs, not the held-out ones: rejected"
        several = "outside their tolerances improve the training runs, not the held-out ones: rejected"
        said.append(f"{' and '.join(refuted)} {one if len(refuted) == 1 else several}")
    said += [
        f"{name} is one value while these loads act, and moves before: an input that froze in the log looks like this"
        for f in content["findings"]
        if (name := f.get("load_history", {}).get("frozen"))
    ]
    said += [
        f"{f['component']}: a torque that repeats once per turn may be a weight or an imbalance that turns with it: "
        "slots and magnets repeat more often"
        for f in content["findings"]
        if f["term"].endswith(".cogging") and f["parameters"].get("n", {}).get("value") == 1
    ]
    said += [
        f"{f['recording']}: the {f['variant']} system cannot be simulated ({f['why']})"
        for f in content.get("not_simulated", ())
    ]
    if why := content.get("not_predicted"):
        said.append(f"no prediction from short distances can be had ({why})")
    said += [*content.get("mistimed", ()), *content.get("held", ())]
    if time_was_up := left_out(content):
        said.append(time_was_up)
    return said + not_compared(content) + _unexplained(content)


def not_compared(content: Json) -> list[str]:
    """Samples that are no measurements, channel by channel."""
    found: dict[tuple[str, str], list[Json]] = {}
    for out in content.get("not_compared", ()):
        found.setdefault((out["channel"], out["why"]), []).append(out)
    return [
        f"{channel}: {sum(o['samples'] for o in outs)} of {sum(o['of'] for o in outs)} samples are "
        f"{LEFT_OUT[why]}, in {' and '.join(o['recording'] for o in outs)}"
        for (channel, why), outs in found.items()
    ]


def left_out(content: Json) -> str | None:
    """What a limit in time left out; None: nothing."""
    if not (names := content.get("left_out")):
        return None
    return f"time was up: not looked at are {', '.join(names)}; diagnose again without --within, it goes on from here"


def _unexplained(content: Json) -> list[str]:
    structure = content["structure"]
    if content.get("misreading"):
        return []
    if content["verdict"] == "undecided" and not content["findings"]:
        return ["the recordings differ from the re-fitted base model, and nothing that was tried explains how"]
    left, before = structure.get("repaired", 0.0), max(structure.get("calibrated", 0.0), structure.get("repaired", 0.0))
    if content["findings"] and structure.get("scatter") and left > thresholds.CLEARLY_LEFT * structure["scatter"]:
        return [f"{100 * left / before:.1f} % of the slow structure in the residual is left unexplained"]
    return []
