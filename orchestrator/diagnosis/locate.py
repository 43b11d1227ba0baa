"""Where in the recordings the evidence for a finding lies, as numbers and in words."""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.diagnosis.fit import Active, Fit
from orchestrator.diagnosis.problem import Problem, Run, Vector

REGIMES = 4  # by size of a channel: standstill, low, middle, high
NAMES = ("near zero", "low", "middle", "high")


def locate(problem: Problem, fit: Fit, active: Active) -> tuple[dict[str, Any], str]:
    """(diagnosis.json's `where`, a sentence): what the residual loses to it, by recording, channel, time, regime."""
    off = {**fit.run.values, active.term.amplitude: active.term.neutral}
    without = problem.simulate([Run(off, fit.run.onsets, fit.run.added)], None)[0]
    if without is None:
        return {}, ""
    return locate_gain(problem, (problem.recorded - without.white) ** 2 - fit.residual**2)


def locate_gain(problem: Problem, gain: Vector) -> tuple[dict[str, Any], str]:
    """The same from the gain per row, (rows,)."""
    total = float(gain.sum()) or 1.0
    by_recording: dict[str, float] = {}
    by_channel: dict[str, float] = {}
    for block in problem.blocks:
        name = problem.recordings[block.recording].name
        share = float(gain[block.rows].sum()) / total
        by_recording[name] = by_recording.get(name, 0.0) + share
        by_channel[block.channel] = by_channel.get(block.channel, 0.0) + share
    recording = max(by_recording, key=lambda name: by_recording[name])
    number = next(n for n, r in enumerate(problem.recordings) if r.name == recording)
    rows = sum(gain[b.rows] for b in problem.blocks if b.recording == number)
    start, stop = _stretch(np.asarray(rows), problem.recordings[number].time)
    regime = _regime(problem, number, np.asarray(rows))
    channel = max(by_channel, key=lambda name: by_channel[name])
    where = {
        "recording": recording,
        "channel": channel,
        "regime": regime,
        "time": [start, stop],
        "by_recording": {name: round(share, 3) for name, share in by_recording.items()},
        "by_channel": {name: round(share, 3) for name, share in by_channel.items()},
    }
    words = (
        f"{100 * by_recording[recording]:.0f} % of the evidence is in {recording}, most of it in {channel}, "
        f"{regime}, densest from {start:.1f} to {stop:.1f} s"
    )
    return where, words


def _stretch(gain: Vector, time: Vector, share: float = 0.5) -> tuple[float, float]:
    """The shortest stretch, in whole windows of a fortieth of the run, that holds half of the gain."""
    edges = np.linspace(0, len(gain), 41).astype(int)
    sums = np.add.reduceat(np.maximum(gain, 0), edges[:-1])
    target, best = share * sums.sum(), (0, len(sums))
    for first in range(len(sums)):
        reach = np.searchsorted(np.cumsum(sums[first:]), target) + first + 1
        if reach <= len(sums) and reach - first < best[1] - best[0]:
            best = (first, int(reach))
    return float(time[edges[best[0]]]), float(time[min(edges[best[1]], len(time) - 1)])


def _regime(problem: Problem, number: int, gain: Vector) -> str:
    """Where the gain per sample is densest: each channel's size and direction, in words."""
    recording, said = problem.recordings[number], []
    for channel, y in recording.outputs.items():
        size = np.abs(np.nan_to_num(y)) / (np.nanmax(np.abs(y)) + 1e-12)
        level = np.minimum(np.searchsorted([0.05, 0.35, 0.7], size), REGIMES - 1)
        counts = np.bincount(level, minlength=REGIMES)
        density = np.bincount(level, weights=gain, minlength=REGIMES) / np.maximum(counts, 1)
        density[counts < 0.01 * len(y)] = 0.0
        said.append(f"{channel} {NAMES[int(np.argmax(density))]}")
        if channel == next(iter(recording.outputs)):
            forward, back = (float(gain[s].sum()) for s in (y > 0, y < 0))
            ratio = forward / max(forward + back, 1e-9)
            said.append("forwards" if ratio > 0.75 else "backwards" if ratio < 0.25 else "both directions")
    return ", ".join(said)
