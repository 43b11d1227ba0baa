"""Where recordings and the re-fitted base model differ, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cobot_joint.diagnosis.localization.change_points import Change
from cobot_joint.diagnosis.localization.conditions import Order, Regime, densest
from cobot_joint.diagnosis.localization.isolability import Isolability
from cobot_joint.diagnosis.localization.replay import Replayed

MOST = 4  # variables and changes that are put into words
TOGETHER = 0.15  # s between changes of two recordings that count as one time


def components(replayed: Sequence[Replayed], suspected: Sequence[str], alone: Mapping[str, Sequence[str]]) -> list[str]:
    """What replaying the parts of the system shows."""
    said = [_replayed(r) for r in replayed]
    if suspected:
        said.append(f"If a single difference causes all of this, it lies in {listed(suspected, 'or')}.")
    elif any(r.off for r in replayed):
        said.append("No single unit explains all of this.")
    for unit, needed in alone.items():
        verb = "is" if len(needed) == 1 else "are"
        said.append(f"{unit} cannot be replayed alone: {listed(needed)} {verb} not recorded.")
    return said


def _replayed(r: Replayed) -> str:
    drive = f"driven by the recorded {listed(r.part.driven)}" if r.part.driven else "as a whole"
    what = f"{listed(r.part.units)} ({r.part.setup}, {drive}):"
    if not r.off:
        return f"{what} {listed(r.part.channels)} as recorded, within noise and tolerances."
    figures = [f"{c} by {r.refitted[c] - r.healthy[c]:.2g}" for c in r.off]
    return f"{what} off in {listed(figures)} (chi-square per sample above noise), whatever its tolerances allow."


def isolability(found: Isolability | str) -> list[str]:
    """What the recorded channels can tell apart at all."""
    if isinstance(found, str):
        return [f"Which units the channels can tell apart at all is not known. {found}"]
    said = [
        f"A difference in {unit} cannot be told from one in {listed(others, 'or')} by structure alone."
        if others
        else f"A difference in {unit} can be told from one in any other unit."
        for unit, others in found.confused.items()
    ]
    hidden = [unit for unit in found.apart if unit not in found.detectable]
    return said + [f"A difference in {listed(hidden, 'or')} does not show in these channels." for _ in hidden[:1]]


def regimes(levels: Mapping[str, Sequence[Regime]], orders: Sequence[Order]) -> list[str]:
    """Where what is above noise is densest, by the variables that matter most."""
    told = [r for found in levels.values() if (r := densest(found))]
    said = [
        f"{_percent(r.share)} of it lies where {condition(r)}, {_percent(r.time)} of "
        f"{'the spectrum' if r.variable == 'frequency' else 'the samples'}."
        for r in told[:MOST]
    ]
    said += [f"{_percent(o.share)} of it has {o.order} periods per turn of {o.angle}." for o in orders[:2]]
    return said or ["It lies evenly over all regimes."]


def condition(r: Regime) -> str:
    """`w_motor is low (17 to 120)`"""
    if r.lower is None or r.upper is None:
        return f"{r.variable} is {r.level}"
    return f"|{r.variable}| is {r.level} ({r.lower:.3g} to {r.upper:.3g})"


def changes(found: Sequence[Change]) -> list[str]:
    """Changes that no input explains, first those that several recordings share; then the largest others."""
    free = sorted((c for c in found if not c.driven), key=lambda c: -c.size)
    said: list[str] = []
    for c in free:
        near = [o for o in free if abs(o.time - c.time) < TOGETHER and o.recording != c.recording]
        if near and not any(f"At {o.time:.1f} s" in words for words in said for o in (c, *near)):
            names = dict.fromkeys(o.recording for o in (c, *near))
            said.append(f"At {c.time:.1f} s it changes in {listed(list(names))}, where no input moves.")
    for c in free[:MOST]:
        said.append(
            f"{c.recording}, {c.channel}: from {c.time:.2f} s on {c.after:.3g} times the noise's variance, "
            f"{c.before:.3g} times before; no input moves there."
        )
    rest = len(found) - len(free)
    if rest:
        said.append(f"{rest} more changes coincide with a change of an input.")
    return said or ["It does not change over time."]


def listed(names: Sequence[str], word: str = "and") -> str:
    """`a, b and c`"""
    return f" {word} ".join([*([", ".join(names[:-1])] if names[1:] else []), *names[-1:]])


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share > 0.01 else f"{100 * share:.1g} %"
