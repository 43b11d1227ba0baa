"""Logs at one speed each, of friction alone: rows of a table, a quarter of them held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cobot_joint.diagnosis.data.formats import Log
from cobot_joint.diagnosis.data.recording import ROWS
from cobot_joint.diagnosis.drafts.campaign_text import Entry, Guess
from cobot_joint.diagnosis.drafts.chain import PARTS
from cobot_joint.system.model import System

STEADY = 0.1  # of how far its mean goes from log to log, that an input may go about it within one


def as_table(system: System, guesses: Sequence[Guess], logs: Sequence[Log], entry: Entry) -> list[Entry] | None:
    """Every log as its mean, every fourth by its input held out where enough are left on both sides. None: the system
    is more than friction, there are few logs, or an input moves within one.

    entry: one for all of the files, in the order of `logs`.
    """
    inputs = [g.column.name for g in guesses if g.connector in system.inputs]
    units = [(c.unit.name, c.parameters.get("motion.source")) for c in system.components]
    friction = PARTS["friction"]
    if units != [(friction.unit, friction.values["motion.source"])] or len(logs) < ROWS or not inputs:
        return None
    series = [[channel.values for channel in log.channels if channel.name == inputs[0]] for log in logs]
    if any(len(own) != 1 for own in series):
        return None
    means = np.array([np.nanmean(x) for (x,) in series])
    within = np.sqrt(np.mean([np.nanvar(x) for (x,) in series]))
    if within > STEADY * np.std(means):
        return None
    by_speed, table = np.argsort(means), replace(entry, given={**entry.given, "table": "mean"})
    held_out = sorted(by_speed[2::4]) if len(logs) >= 4 * ROWS else []
    fitted = [file for k, file in enumerate(entry.files) if k not in held_out]
    parts = [replace(table, files=fitted, why="guess: each log is at one speed, and its mean a row")]
    if held_out:
        tested = [entry.files[k] for k in held_out]
        parts.append(replace(table, files=tested, role="holdout", why="guess: every fourth speed is held out"))
    return parts
