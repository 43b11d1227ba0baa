"""Recordings beside simulations of them: nominal, calibrated, repaired."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.at_once import at_once
from cobot_joint.results.diagnosed import VARIANTS

Simulator = Callable[[Recording], Mapping[str, NDArray[np.float64]]]  # outputs of the system at the recording's time


@dataclass(frozen=True)
class Comparison:
    """One recording, and per variant what the system gives for the same inputs."""

    recording: Recording
    simulated: dict[str, dict[str, NDArray[np.float64]]]  # variant -> channel -> (n,)
    failed: dict[str, str] = field(default_factory=dict)  # variant -> why it could not be simulated: NaN throughout

    def residual(self, variant: str, channel: str) -> NDArray[np.float64]:
        """recording - simulation, NaN where not recorded: (n,)"""
        return self.recording.outputs[channel] - self.simulated[variant][channel]


def compare(recordings: Sequence[Recording], simulators: Mapping[str, Simulator]) -> list[Comparison]:
    """Run every variant on every recording, variants beside each other."""
    runs = at_once(lambda simulate: [_outputs(simulate, recording) for recording in recordings], simulators.values())
    by_recording = [dict(zip(simulators, of_one, strict=True)) for of_one in zip(*runs, strict=True)]
    return [
        Comparison(
            recording,
            {variant: outputs for variant, (outputs, _) in found.items()},
            {variant: why for variant, (_, why) in found.items() if why},
        )
        for recording, found in zip(recordings, by_recording, strict=True)
    ]


def _outputs(simulate: Simulator, recording: Recording) -> tuple[dict[str, NDArray[np.float64]], str]:
    """By channel, (n,) each; NaN, and why, where it cannot be simulated."""
    try:
        outputs, why = simulate(recording), ""
    except SimulationError as error:
        outputs, why = dict.fromkeys(recording.outputs, np.full(len(recording.time), np.nan)), str(error)
    return {channel: np.asarray(outputs[channel], dtype=float) for channel in recording.outputs}, why


def rms(compared: Sequence[Comparison], variant: str, channel: str) -> float | None:
    """Root mean square of recording - simulation over all recordings that have the channel; None where none has, or
    one of them could not be simulated."""
    having = [c for c in compared if channel in c.recording.outputs]
    if any(variant in c.failed for c in having):
        return None
    residuals = [c.residual(variant, channel)[np.isfinite(c.recording.outputs[channel])] for c in having]
    return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))) if residuals else None


def channel_figures(
    compared: Sequence[Comparison], variants: Sequence[str] = VARIANTS
) -> dict[str, dict[str, float | None]]:
    """channel -> variant -> rms"""
    channels = dict.fromkeys(channel for c in compared for channel in c.recording.outputs)
    return {channel: {variant: rms(compared, variant, channel) for variant in variants} for channel in channels}


def table(compared: Sequence[Comparison], variants: Sequence[str] = VARIANTS) -> pa.Table:
    """All signals, so that anyone can recompute the figures: `recording`, `time [s]`, per channel `w.recorded [rad/s]`,
    `w.nominal [rad/s]` ...
    """
    channels = dict.fromkeys(channel for c in compared for channel in c.recording.outputs)
    units = {channel: unit for c in compared for channel, unit in c.recording.units.items()}
    columns: dict[str, list[NDArray[np.float64]]] = {"time [s]": [c.recording.time for c in compared]}
    for channel in channels:
        for source in ("recorded", *variants):
            columns[f"{channel}.{source} [{units[channel]}]"] = [
                (c.recording.outputs if source == "recorded" else c.simulated[source]).get(
                    channel, np.full(len(c.recording.time), np.nan)
                )
                for c in compared
            ]
    names = np.repeat([c.recording.name for c in compared], [len(c.recording.time) for c in compared])
    return pa.table(
        {"recording": pa.array(names).dictionary_encode()}
        | {name: np.concatenate(parts) for name, parts in columns.items()}
    )


def strongest_window(
    c: Comparison, channel: str, seconds: float, before: str = "calibrated", after: str = "repaired"
) -> tuple[float, float]:
    """The stretch in which `after` improves most on `before` (where it does not: in which `before` is worst), s."""
    gain = c.residual(before, channel) ** 2
    if after in c.simulated and np.nansum(gain - c.residual(after, channel) ** 2) > 0:
        gain = gain - c.residual(after, channel) ** 2
    width = max(2, min(len(gain), round(seconds / c.recording.step)))
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(gain))])
    start = int(np.argmax(total[width:] - total[:-width]))
    return float(c.recording.time[start]), float(c.recording.time[min(start + width, len(gain) - 1)])
