"""Speeds that a logger counted from sample to sample, by an encoder: means, half a sample behind the instant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.conditioning import quantisation_step
from cobot_joint.diagnosis.data.formats import Channel
from cobot_joint.diagnosis.data.quantity import convert
from cobot_joint.diagnosis.data.recording import Connector
from cobot_joint.diagnosis.drafts.campaign_text import Guess, converts
from cobot_joint.system.model import System
from cobot_joint.system.shafts import position_behind
from cobot_joint.system.wiring import shown_by

MANTISSAS = (1.0, 1.2, 1.25, 1.44, 1.5, 1.8, 2.0, 2.4, 2.5, 3.0, 3.6, 4.0, 5.0, 6.0, 7.2, 8.0)  # of encoders' counts
COUNTS = sorted([*(2.0**k for k in range(5, 25)), *(m * 10.0**k for k in range(1, 7) for m in MANTISSAS)])
NEAR = 1e-3  # by which a count per turn may be off one of these: by chance one speed in thirty has such a step
SHARPER = 0.3  # times what central differences of the angle leave, that those since the sample before leave at most
RATES = {"rad/s": "rad", "m/s": "m"}


def with_counted_speeds(
    system: System,
    guesses: Sequence[Guess],
    connectors: Mapping[str, Connector],
    logs: Sequence[Sequence[Channel]],
) -> list[Guess]:
    """Guesses, in which speeds that are such means are said to be. logs: the columns of each."""
    shown = {g.connector: shown_by(system).get(g.connector, g.connector) for g in guesses}
    found = []
    for g in guesses:
        place = position_behind(system, g.connector) if g.connector in connectors else None
        why = ""
        if place and connectors[g.connector].causality == "output" and connectors[g.connector].unit in RATES:
            angle = next((h for h in guesses if shown[h.connector] == place[0]), None)
            why = _difference(g, angle) if angle else ""
            why = why or next((words for log in logs if (words := _counted(g, log))), "")
        found.append(replace(g, mean=True, why=f"{g.why}; {why}" if g.why else why) if why else g)
    return found


def _difference(speed: Guess, angle: Guess) -> str:
    """In words, where the speed is what the angle went since the sample before, clearer than what it goes around it."""
    w, phi = (_in_base_units(g.column, g.column) for g in (speed, angle))
    if w is None or phi is None or speed.scale or angle.scale or len(w) != len(phi) or len(w) < 4:
        return ""
    time = speed.column.time
    backward, central = np.diff(phi)[:-1] / np.diff(time)[:-1], (phi[2:] - phi[:-2]) / (time[2:] - time[:-2])
    left = [float(np.nanmean((w[1:-1] - rate) ** 2)) for rate in (backward, central)]
    sharper = left[0] < SHARPER**2 * left[1] and left[0] < SHARPER**2 * float(np.nanvar(w))
    return f"it is what {angle.column.name!r} went since the sample before" if sharper else ""


def _counted(speed: Guess, log: Sequence[Channel]) -> str:
    """In words, where its converter's steps are a whole count of an encoder per sample."""
    column = next((c for c in log if c.name == speed.column.name), None)
    w = _in_base_units(column, speed.column) if column is not None and not speed.scale else None
    if column is None or w is None or len(column.time) < 2:
        return ""
    step = quantisation_step(w[np.isfinite(w)]) * float(np.median(np.diff(column.time)))
    per_turn = 2 * np.pi / step if step > 0 else 0.0
    count = min(COUNTS, key=lambda n: abs(n - per_turn))
    near = abs(count - per_turn) < NEAR * count and not _is_round(
        quantisation_step(column.values[np.isfinite(column.values)])
    )
    return f"its steps are counts of an encoder, {count:.0f} per turn, from sample to sample" if near else ""


def _is_round(step: float) -> bool:
    """Whether it is 1, 2 or 5 times a power of ten: the file's own rounding, whatever was counted."""
    return any(abs(step / m / 10.0 ** round(float(np.log10(step / m))) - 1) < NEAR for m in (1, 2, 5))


def _in_base_units(column: Channel, like: Channel) -> NDArray[np.float64] | None:
    """In rad, rad/s, m or m/s. like: the same column with the unit that was guessed."""
    for unit in (*RATES, *RATES.values()):
        if like.unit and converts(like.unit, unit):
            return convert(column.values, like.unit, unit, column.name)[0]
    return None
