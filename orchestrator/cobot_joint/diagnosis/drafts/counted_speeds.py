"""What an encoder counts: an angle in counts, and speeds counted from sample to sample, means that are half a sample
behind the instant."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.conditioning import quantisation_step
from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.quantity import convert
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import Guess, Rated, converts, header_of, is_command
from cobot_joint.system.model import System
from cobot_joint.system.shafts import position_behind

MANTISSAS = (1.0, 1.2, 1.25, 1.44, 1.5, 1.8, 2.0, 2.4, 2.5, 3.0, 3.6, 4.0, 5.0, 6.0, 7.2, 8.0)  # of encoders' counts
COUNTS = sorted([*(2.0**k for k in range(5, 25)), *(m * 10.0**k for k in range(1, 7) for m in MANTISSAS)])
NEAR = 1e-3  # by which a count per turn may be off one of these: by chance one speed in sixty has such a step
SHARPER = 0.3  # times what central differences of the angle leave, that those since the sample before leave at most
FEWEST = 10  # samples, of which that can be told
COUNTED = re.compile(
    r"(?:^|_)(?:enc(?:oder)?|ticks?|counts?|cnts?|pulses?|inc(?:r(?:ement)?)?s?|inkremente)(?:_|$)", re.I
)
ELECTRICAL = re.compile(r"(?:^|_)e_?rpm(?:_|$)", re.I)
RATES = {"rad/s": "rad", "m/s": "m"}  # units of speeds, and of their positions


def in_counts(channels: Iterable[Channel], guesses: Sequence[Guess], offered: Iterable[Connector]) -> dict[str, Rated]:
    """Column of whole numbers whose name or unit says that they were counted -> the first angle that it could be:
    `enc_ticks`, `position [inc]`; of a motor's electrical turns a minute, `erpm` -> the first speed."""
    used = {g.column.name for g in guesses} | {g.connector for g in guesses}
    free = [c for c in channels if c.name not in used and not is_command(c.name)]
    bare = [c for c in free if c.unit in (None, "1")]
    named = [c for c in free if COUNTED.search(c.name if c in bare else c.unit or "")]
    counted = [c for c in named if np.all(c.values[np.isfinite(c.values)] % 1 == 0)]
    electrical = [c for c in bare if ELECTRICAL.search(c.name)]
    ends = {c.unit: c for c in reversed(list(offered)) if c.causality == "output" and c.name not in used}
    of_count = "what one count is: 6.283185 over the counts per turn, edges of both tracks counted"
    of_turn = "what 1 is: 0.1047198 over the motor's pole pairs"
    found = {header_of(c): Rated(ends["rad"], whole=of_count) for c in counted if "rad" in ends}
    return found | {header_of(c): Rated(ends["rad/s"], whole=of_turn) for c in electrical if "rad/s" in ends}


def with_counted_speeds(
    system: System, guesses: Sequence[Guess], connectors: Mapping[str, Connector], logs: Sequence[Sequence[Channel]]
) -> list[Guess]:
    """Guesses, in which speeds that are such means are said to be. logs: the columns of each."""
    found = []
    for g in guesses:
        connector = connectors.get(g.connector)
        is_speed = connector is not None and connector.causality == "output" and connector.unit in RATES
        why = ""
        if is_speed and not g.scale and position_behind(system, g.connector):
            why = next((words for log in logs for c in log if (words := _difference(g.column, c))), "")
            why = why or next((words for log in logs for c in log if (words := _counted(g.column, c))), "")
        found.append(replace(g, mean=True, why=f"{g.why}; {why}" if g.why else why) if why else g)
    return found


def _difference(speed: Channel, angle: Channel) -> str:
    """In words, where the speed is what the angle went since the sample before, clearer than what it goes around it."""
    w, phi = (_in_base_units(c.values, c.unit) for c in (speed, angle))
    time = speed.time
    if w is None or phi is None or len(w) != len(phi) or len(w) < FEWEST or not (np.diff(time) > 0).all():
        return ""
    backward, central = np.diff(phi)[:-1] / np.diff(time)[:-1], (phi[2:] - phi[:-2]) / (time[2:] - time[:-2])
    left = [np.nanmean((w[1:-1] - rate) ** 2) if np.isfinite(w[1:-1] - rate).any() else np.inf
            for rate in (backward, central)]  # fmt: skip
    sharper = left[0] < SHARPER**2 * left[1] and left[0] < SHARPER**2 * np.nanvar(w)
    return f"it is what {angle.name!r} went since the sample before" if sharper else ""


def _counted(speed: Channel, column: Channel) -> str:
    """In words, where the steps of the speed's column in a log are whole counts of an encoder per sample."""
    if column.name != speed.name or len(column.time) < FEWEST:
        return ""
    raw = column.values[np.isfinite(column.values)]
    w = _in_base_units(raw, speed.unit)
    step = quantisation_step(w) * float(np.median(np.diff(column.time))) if w is not None else 0.0
    if step <= 0 or _is_round(quantisation_step(raw)):
        return ""
    count = min(COUNTS, key=lambda n: abs(n * step - 2 * np.pi))
    near = abs(count * step - 2 * np.pi) < NEAR * 2 * np.pi
    return f"its steps are counts of an encoder, {count:.0f} per turn, from sample to sample" if near else ""


def _is_round(step: float) -> bool:
    """Whether it is 1, 2 or 5 times a power of ten: the file's own rounding, whatever was counted."""
    return any(abs(step / m / 10.0 ** round(float(np.log10(step / m))) - 1) < NEAR for m in (1, 2, 5))


def _in_base_units(values: NDArray[np.float64], given: str | None) -> NDArray[np.float64] | None:
    """In rad, rad/s, m or m/s; None: they have another unit, or none."""
    for unit in (*RATES, *RATES.values()):
        if given and converts(given, unit):
            return convert(values, given, unit, "column")[0]
    return None
