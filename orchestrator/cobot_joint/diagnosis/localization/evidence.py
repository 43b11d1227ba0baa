"""Where in the recordings the evidence for a finding lies: by recording, channel, time and operating condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.localization.conditions import conditions, densest
from cobot_joint.diagnosis.localization.localize import labelled, systems_of, variables

Where = dict[str, Any]  # as diagnosis.json has it
WINDOWS = 40  # of a run, of which the densest stretch is made
HALF = 0.5  # of the gain, that it holds


def where_it_shows(problem: Problem, fit: Fit, active: ActiveTerm) -> Where:
    """What the residual loses to one term of a fit; empty where it cannot be simulated without."""
    off = fit.run.with_values({active.term.amplitude: active.term.neutral})
    without = problem.simulate([off])[0]
    if without is None:
        return {}
    names, _ = variables(problem, systems_of(problem))
    signals = labelled(problem, problem.outputs(fit.run, list(names)), names)
    return where_it_gains(problem, (problem.recorded - without.white) ** 2 - fit.residual**2, signals)


def where_it_gains(problem: Problem, gain: Vector, signals: Sequence[Mapping[str, Vector]] | None = None) -> Where:
    """The same from the gain per row, (rows,). signals: by recording what conditions are of; None: what was logged."""
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
    levels = conditions(problem, gain, signals or labelled(problem, [r.outputs for r in problem.recordings], {}))
    dense = [r for name, found in levels.items() if name not in ("recording", "channel") and (r := densest(found))]
    return {
        "recording": recording,
        "channel": max(by_channel, key=lambda name: by_channel[name]),
        "time": list(_stretch(np.asarray(rows), problem.recordings[number].time)),
        "by_recording": {name: round(share, 3) for name, share in by_recording.items()},
        "by_channel": {name: round(share, 3) for name, share in by_channel.items()},
        "by_regime": [r.to_json() for r in dense],
    }


def _stretch(gain: Vector, time: Vector) -> tuple[float, float]:
    """The shortest stretch, in whole windows of the run, that holds half of the gain."""
    edges = np.linspace(0, len(gain), WINDOWS + 1).astype(int)
    sums = np.array([np.maximum(gain[a:b], 0).sum() for a, b in pairwise(edges)])
    target, best = HALF * sums.sum(), (0, len(sums))
    for first in range(len(sums)):
        reach = np.searchsorted(np.cumsum(sums[first:]), target) + first + 1
        if reach <= len(sums) and reach - first < best[1] - best[0]:
            best = (first, int(reach))
    return float(time[edges[best[0]]]), float(time[min(edges[best[1]], len(time) - 1)])
