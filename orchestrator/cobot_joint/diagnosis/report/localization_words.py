"""Where recordings and the re-fitted base model differ, in sentences. Arguments are parts of diagnosis.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

MOST = 4  # variables and changes that are put into words
NAMED = 3  # conditions that a finding's sentence names
TOGETHER = 0.15  # s between changes of two recordings that count as one time

Json = Mapping[str, Any]


def located(found: Json) -> dict[str, list[str]]:
    """Sentences on "components", "isolability", "regimes" and "time". found: `located` of diagnosis.json."""
    nothing = ["Nothing is above noise."]
    return {
        "components": components(found["components"]),
        "isolability": isolability(found["isolability"], found["no_isolability"]),
        "regimes": conditions(found) if found["above_noise"] else nothing,
        "time": changes(found["change_points"]) if found["above_noise"] else nothing,
    }


def components(found: Json) -> list[str]:
    """What replaying the parts of the system shows."""
    said = [_replayed(part) for part in found["parts"]]
    if found["suspects"]:
        said.append(f"If a single difference causes all of this, it lies in {listed(found['suspects'], 'or')}.")
    elif any(c["off"] for part in found["parts"] for c in part["channels"].values()):
        said.append("No single unit explains all of this.")
    for unit, needed in found["not_alone"].items():
        verb = "is" if len(needed) == 1 else "are"
        said.append(f"{unit} cannot be replayed alone: {listed(needed)} {verb} not recorded.")
    return said


def _replayed(part: Json) -> str:
    drive = f"driven by the recorded {listed(part['driven_by'])}" if part["driven_by"] else "as a whole"
    what = f"{listed(part['units'])} ({part['setup']}, {drive}):"
    off = {name: c for name, c in part["channels"].items() if c["off"]}
    if not off:
        return f"{what} {listed(list(part['channels']))} as recorded, within noise and tolerances."
    figures = [f"{name} by {_above(c)}" for name, c in off.items()]
    return f"{what} off in {listed(figures)} (chi-square per sample above noise), whatever its tolerances allow."


def _above(channel: Json) -> str:
    above, healthy = channel["refitted"], channel["healthy"]
    return "any amount: the part diverges" if above is None else f"{above - healthy:.2g}"


def isolability(found: Json | None, why: str) -> list[str]:
    """What the recorded channels can tell apart at all; why: it is not known."""
    if found is None:
        return [f"Which units the channels can tell apart at all is not known: {why}."]
    said = [
        f"A difference in {unit} cannot be told from one in {listed(others, 'or')} by structure alone."
        if others
        else f"A difference in {unit} can be told from one in any other unit."
        for unit, others in found["confused"].items()
    ]
    hidden = found["hidden"]
    return said + [f"A difference in {listed(hidden, 'or')} does not show in these channels." for _ in hidden[:1]]


def conditions(found: Json) -> list[str]:
    """Where what is above noise is densest, by the variables that matter most. Where less than noise is left elsewhere,
    a share is more than all, and said as all."""
    told = found["densest"]
    said = [
        f"{_percent(min(r['share'], 1.0))} of it lies where {condition(r)}, {_percent(r['time'])} of "
        f"{'the spectrum' if r['variable'] == 'frequency' else 'the samples'}."
        for r in told[:MOST]
    ]
    turning = found["orders"][:2]
    said += [f"{_percent(o['share'])} of it has {o['order']} periods per turn of {o['angle']}." for o in turning]
    return said or ["It lies evenly over all operating conditions."]


def condition(r: Json) -> str:
    """`w_motor is low (17 to 120)`"""
    if "between" not in r:
        return f"{r['variable']} is {r['level']}"
    lower, upper = r["between"]
    return f"|{r['variable']}| is {r['level']} ({lower:.3g} to {upper:.3g})"


def where(found: Json) -> tuple[str, str]:
    """(the condition, a sentence) of a finding's `where`."""
    regime = ", ".join(condition(r) for r in found["by_regime"][:NAMED]) or "under all conditions"
    start, stop = found["time"]
    recording = found["recording"]
    return regime, (
        f"{_percent(found['by_recording'][recording])} of the evidence is in {recording}, most of it in "
        f"{found['channel']}, where {regime}, densest from {start:.1f} to {stop:.1f} s"
    )


def changes(found: Sequence[Json]) -> list[str]:
    """Changes that no input explains, first those that several recordings share; then the largest others."""
    free = sorted((c for c in found if not c["driven"]), key=lambda c: -_ratio(c))
    said: list[str] = []
    told: list[float] = []
    for c in free:
        near = [o for o in free if abs(o["time"] - c["time"]) < TOGETHER and o["recording"] != c["recording"]]
        if near and not any(abs(c["time"] - t) < TOGETHER for t in told):
            names = dict.fromkeys(o["recording"] for o in (c, *near))
            told.append(c["time"])
            said.append(f"At {c['time']:.1f} s it changes in {listed(list(names))}, where no input moves.")
    for c in free[:MOST]:
        said.append(
            f"{c['recording']}, {c['channel']}: from {c['time']:.2f} s on {c['after']:.3g} times the noise's variance, "
            f"{c['before']:.3g} times before; no input moves there."
        )
    rest = len(found) - len(free)
    if rest:
        said.append(f"{rest} more changes coincide with a change of an input.")
    return said or ["It does not change over time."]


def _ratio(c: Json) -> float:
    return float(max(c["before"], c["after"]) / max(min(c["before"], c["after"]), 1e-3))


def listed(names: Sequence[str], word: str = "and") -> str:
    """`a, b and c`"""
    return f" {word} ".join([*([", ".join(names[:-1])] if names[1:] else []), *names[-1:]])


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share > 0.01 else f"{100 * share:.1g} %"
