"""How well a system predicts a recording from short distances: free runs that begin where the recording has led to.

A free run over minutes adds up whatever is wrong, and angles are lost, so that a right term in the wrong phase is worse
than none. Here a run is free for a horizon only, and begins at the state that a filter has estimated from the samples
before it (multi-step prediction errors: Ljung 1999, System Identification, 16.5). Where no filter can follow, as where
a gear rattles in its gap, the free run is the better prediction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.data.quantity import is_position
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.at_once import at_once
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.simulator import differences
from cobot_joint.diagnosis.state_estimation.estimator import StateEstimator
from cobot_joint.diagnosis.state_estimation.latents import structure, with_sizes
from cobot_joint.diagnosis.state_estimation.native.restart import LostError
from cobot_joint.diagnosis.state_estimation.noise import ChannelNoise
from cobot_joint.diagnosis.state_estimation.sampled import Piece, SampledSystem
from cobot_joint.diagnosis.state_estimation.states import states_of
from cobot_joint.system.model import System, Value
from cobot_joint.system.shafts import position_behind

Array = NDArray[np.float64]
HORIZON = 0.2  # s
LOST = 4.0  # times the mean square of the free run's error: below it a wrong model may be anchored as well


@dataclass(frozen=True)
class Variant:
    """Systems by set-up, and `component.variable` -> value over their own, or from an onset on, s."""

    systems: Mapping[str, System]
    values: Mapping[str, Value] = field(default_factory=dict)
    onsets: Mapping[str, float] = field(default_factory=dict)


def predicted_figures(
    recordings: Sequence[Recording],
    variants: Mapping[str, Variant],
    noise: Mapping[str, ChannelNoise],
    horizon: float = HORIZON,
) -> dict[str, dict[str, Any] | None]:
    """channel -> {"horizon": s, variant -> rms of recording - prediction over all samples}; None where a unit of a
    system allows no state to be set.

    Of a recording in which a filter loses its way the free run from its beginning counts, of all variants, and "free"
    lists it.
    """
    channels = dict.fromkeys(channel for r in recordings for channel in r.outputs)
    if any(states_of(system) is None for v in variants.values() for system in v.systems.values()):
        return dict.fromkeys(channels)
    errors: dict[str, dict[str, list[Array]]] = {channel: {name: [] for name in variants} for channel in channels}
    every = [(recording, variant) for recording in recordings for variant in variants.values()]
    one = partial(predict, noise=noise, horizon=horizon)
    free: list[str] = []
    done = iter(at_once(one, *zip(*every, strict=True)) if every else [])
    for recording in recordings:
        of_each = {name: next(done) for name in variants}
        lost = any(predicted.lost(recording, noise) for predicted in of_each.values())
        free += [recording.name] * lost
        for name, predicted in of_each.items():
            for channel, series in (predicted.free if lost else predicted.anchored).items():
                error = recording.outputs[channel] - series
                errors[channel][name].append(error[np.isfinite(error)])
    return {
        channel: {"horizon": horizon, **({"free": free} if free else {})}
        | {name: float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) for name, parts in of_channel.items()}
        for channel, of_channel in errors.items()
    }


@dataclass(frozen=True)
class Predicted:
    """Channel -> (n,): free runs over each horizon of unbroken data, NaN where nothing is recorded; and one free run
    from the recording's beginning on, its positions where the recording has them as each horizon begins: what they
    drifted off before says nothing of it."""

    anchored: dict[str, Array]
    free: dict[str, Array]

    def lost(self, recording: Recording, noise: Mapping[str, ChannelNoise]) -> bool:
        """Whether the filter lost its way, so that runs begun there are far worse than one that never was anchored: as
        where a gear rattles in its gap."""

        def above(series: Mapping[str, Array]) -> float:
            return sum(
                float(np.nanmean((recording.outputs[channel] - y) ** 2)) / noise[channel].sigma ** 2
                for channel, y in series.items()
            )

        return above(self.anchored) > LOST * above(self.free)


def predict(
    recording: Recording, variant: Variant, noise: Mapping[str, ChannelNoise], horizon: float = HORIZON
) -> Predicted:
    """One recording. SimulationError (of cosim): a unit fails."""
    plant = FmuPlant({recording.setup: variant.systems[recording.setup]})  # with the additive ports as inputs
    system = plant.systems[recording.setup]
    ports = [port.name for port in plant.ports]
    there = {n: v for n, v in variant.values.items() if n.split(".")[0] in {c.name for c in system.components}}
    late = {n: t for n, t in variant.onsets.items() if n in there}
    with SampledSystem(system, list(recording.outputs), there, late) as sampled:
        time = recording.time - recording.time[0]
        whole = sampled.free(recording)
        known = structure(sampled, whole, ports, noise)
        y = np.full((len(time), len(sampled.channels)), np.nan)
        parts = pieces(recording, horizon)
        try:
            estimator = StateEstimator(sampled, noise, known.latents, known.followed, known.reached)
            tracked = estimator.track(recording)
            tracked = with_sizes(estimator, tracked).refilter(tracked)
            assert tracked.filtered.predicted is not None
            with sampled.along(time, recording.inputs, known.reached, held=recording.held) as runs:
                for first, end in parts:
                    x = tracked.x[first].copy()
                    if first:  # else it is where the run begins
                        z = tracked.reference[first] + tracked.filtered.predicted[first]
                        x[estimator.followed] = z[estimator.x]
                    y[first:end] = _as_recorded(sampled, recording, runs.run(x, slice(first, end)))
        except LostError:
            for first, end in parts:
                y[first:end] = np.inf
        free = np.where(np.isnan(y), np.nan, _as_recorded(sampled, recording, whole))
        channels = list(enumerate(sampled.channels))
        for j, name in channels:
            if is_position(recording.units.get(name)):
                free[:, j] -= _off_at_begin(free[:, j] - recording.outputs[name], parts)
        return Predicted({name: y[:, j] for j, name in channels}, {name: free[:, j] for j, name in channels})


def _as_recorded(sampled: SampledSystem, recording: Recording, piece: Piece) -> Array:
    """(n, channels): those that were made of a position's samples from the piece's own; NaN where that begins."""
    y = piece.y.copy()
    for j, name in enumerate(sampled.channels):
        place, times = position_behind(sampled.system, name) or ("", 1.0)
        if name in recording.differences and place in piece.signals:
            y[:, j] = times * differences(piece.signals[place], recording.step, recording.differences[name])
    return y


def _off_at_begin(off: Array, parts: Sequence[tuple[int, int]]) -> Array:
    """Of every sample, how far off the first one was that its piece has: (n,)"""
    found = np.zeros_like(off)
    for first, end in parts:
        known = off[first:end][np.isfinite(off[first:end])]
        found[first:end] = known[0] if len(known) else 0.0
    return found


def pieces(recording: Recording, horizon: float) -> list[tuple[int, int]]:
    """(first sample, behind the last) of every horizon of unbroken data; what is left over joins the piece before."""
    every = max(2, round(horizon / recording.step))
    recorded = np.any([np.isfinite(series) for series in recording.outputs.values()], axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], recorded, [False]]).astype(int)))
    found = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        starts = list(range(int(begin), int(end), every))
        if len(starts) > 1 and end - starts[-1] < every // 2:
            starts.pop()
        stops = [*starts[1:], int(end)]
        found += [(a, b) if b - a > 1 else (max(a - 1, 0), max(b, 2)) for a, b in zip(starts, stops, strict=True)]
    return found
