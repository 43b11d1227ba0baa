"""What a log holds: its clock, its columns with their ranges and noise, and what looks wrong. No system is needed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from cobot_joint.diagnosis.checks.suspicions import suspicions
from cobot_joint.diagnosis.data.clock import SLOWEST
from cobot_joint.diagnosis.data.conditioning import ChannelQuality, assess, quantisation_step
from cobot_joint.diagnosis.data.delimited import Layout
from cobot_joint.diagnosis.data.formats import Log, NoClock, read_log
from cobot_joint.diagnosis.data.quantity import is_position
from cobot_joint.diagnosis.data.recording import LARGEST, Connector, Reading, Recording, read_recording
from cobot_joint.diagnosis.drafts.campaign_text import is_command
from cobot_joint.errors import UserError

TABLE = (
    "no column is a clock: each row is taken for a steady state; if they are samples of a run, say how far they are "
    "apart, time = '10 ms'"
)
AS_ASKED = ("clipped", "frozen", "held")  # what a set value may be


@dataclass(frozen=True)
class Inspection:
    """One log: as it is on its regular clock, every column of it, in the file's own units."""

    log: Log
    recording: Recording
    quality: dict[str, ChannelQuality]
    words: list[str] = field(default_factory=list)  # of the clock, of columns that cannot be used, suspicions
    table: bool = False  # its rows are steady states


def inspect_log(path: Path, time: str | None = None, layout: Layout | None = None) -> Inspection:
    """Read a log without a system; one without a clock as a table of steady states. UserError: it cannot be read."""
    try:
        log, rows = read_log(path, time, layout), False
    except NoClock:
        log, rows = read_log(path, time, layout, table=True), True
    usable = [c for c in log.channels if np.isfinite(c.values).any() and np.nanmax(np.abs(c.values)) < LARGEST]
    if not usable:
        raise UserError(f"{path}: none of its {len(log.channels)} columns has a value")
    connectors = {c.name: Connector(c.name, "output", c.unit) for c in usable}
    # as a campaign that names its clock: a slow one is no error for who only looks
    clock = None if rows else time or log.clock
    reading = Reading(time=clock, layout=layout or Layout(), table="rows" if rows else None)
    recording = read_recording(path, connectors, {name: name for name in connectors}, reading)
    words = [TABLE] if rows else [*recording.notes]
    words += [f"{name} {why}" for name, why in log.unusable.items()]
    words += [f"{c.name} has no value, or values that no instrument gives" for c in log.channels if c not in usable]
    if not rows:
        if recording.step > SLOWEST:
            words.append(f"the clock steps by {recording.step:g} s: if it counts ms, say time = '{log.clock} [ms]'")
        found = [s for s in suspicions([recording]) if not (s.kind in AS_ASKED and is_command(s.channel))]
        words += [f"{s.channel}: {s.evidence}" for s in found]
    quality = {n: assess(x) for n, x in recording.outputs.items()}
    steps = {c.name: quantisation_step(c.values[np.isfinite(c.values)]) for c in usable}  # interpolated, none is left
    quality = {n: replace(q, step=q.step or steps.get(n, 0.0)) for n, q in quality.items()}
    at_rest = {n for n in quality if is_position(recording.units.get(n))}  # at the end of its way it is no less sound
    quality = {n: replace(q, saturated=0) if n in at_rest else q for n, q in quality.items()}
    if rows:  # they follow one another in no time: what differs from one to the next is no noise
        quality = {n: replace(q, noise=float("nan"), saturated=0) for n, q in quality.items()}
    return Inspection(log, recording, quality, words, rows)
