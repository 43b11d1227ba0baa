"""Where in the recordings the evidence for a finding lies, as numbers and in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cobot_joint.diagnosis.estimation.fit import Active, Fit
from cobot_joint.diagnosis.estimation.problem import Problem, Run, Vector
from cobot_joint.diagnosis.localization.conditions import densest, regimes
from cobot_joint.diagnosis.localization.localize import labelled, variables
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.report.localization_words import condition

NAMED = 3  # regimes that the words name


def locate(problem: Problem, fit: Fit, active: Active) -> tuple[dict[str, Any], str]:
    """(diagnosis.json's `where`, a sentence): what the residual loses to it, by recording, channel, time, regime."""
    off = {**fit.run.values, active.term.amplitude: active.term.neutral}
    without = problem.simulate([Run(off, fit.run.onsets, fit.run.added)], None)[0]
    if without is None:
        return {}, ""
    names, _ = variables(problem, problem.plant.systems if isinstance(problem.plant, FmuPlant) else {})
    signals = labelled(problem, problem.outputs(fit.run, list(names)), names)
    return locate_gain(problem, (problem.recorded - without.white) ** 2 - fit.residual**2, signals)


def locate_gain(
    problem: Problem, gain: Vector, signals: Sequence[Mapping[str, Vector]] | None = None
) -> tuple[dict[str, Any], str]:
    """The same from the gain per row, (rows,). signals: by recording what regimes are of; None: what was recorded."""
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
    levels = regimes(problem, gain, signals or labelled(problem, [r.outputs for r in problem.recordings], {}))
    told = [r for name, found in levels.items() if name not in ("recording", "channel") and (r := densest(found))]
    regime = ", ".join(condition(r) for r in told[:NAMED]) or "anything goes on"
    channel = max(by_channel, key=lambda name: by_channel[name])
    where = {
        "recording": recording,
        "channel": channel,
        "regime": regime,
        "time": [start, stop],
        "by_recording": {name: round(share, 3) for name, share in by_recording.items()},
        "by_channel": {name: round(share, 3) for name, share in by_channel.items()},
        "by_regime": [r.to_json() for r in told],
    }
    words = (
        f"{100 * by_recording[recording]:.0f} % of the evidence is in {recording}, most of it in {channel}, "
        f"where {regime}, densest from {start:.1f} to {stop:.1f} s"
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
