"""Recordings followed with a system and values; the latent forces' sizes are kept from one time to the next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.at_once import at_once
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.state_estimation.estimator import Latent, StateEstimator, Tracked
from cobot_joint.diagnosis.state_estimation.evidence import Tracking
from cobot_joint.diagnosis.state_estimation.latents import Structure, structure
from cobot_joint.diagnosis.state_estimation.native.kalman import Filtered
from cobot_joint.diagnosis.state_estimation.noise import ChannelNoise
from cobot_joint.diagnosis.state_estimation.sampled import SampledSystem
from cobot_joint.system.model import Value

SLOW = 2.0  # s that a second latent force at each port lives: supplies, temperatures
FIRST, AGAIN = 8, 3  # rounds of estimating the latent forces' sizes; where they are known about


class Tracker:
    """Follows recordings. A context manager: what it found is of use inside only."""

    def __init__(self, plant: FmuPlant, recordings: Sequence[Recording], noise: Mapping[str, ChannelNoise]) -> None:
        self.plant, self.recordings, self.noise = plant, list(recordings), noise
        self._structures: dict[str, Structure] = {}  # by set-up
        self._latents: dict[str, tuple[Latent, ...]] = {}  # by recording
        self._reached: dict[str, NDArray[np.float64]] = {}  # by recording: Structure has that of one
        self._systems, self._before = ExitStack(), ExitStack()

    def __enter__(self) -> Tracker:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _value: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._systems.close()
        self._before.close()

    @property
    def alike(self) -> dict[str, list[str]]:
        """Port -> other components in which a force would do the same, in every set-up that has it."""
        found: dict[str, list[str]] = {}
        for known in self._structures.values():
            for port, others in known.alike.items():
                names = [name.split(".")[0] for name in others]
                names = [n for n in dict.fromkeys(names) if n != port.split(".")[0]]
                found[port] = [n for n in found.get(port, names) if n in names]
        return found

    def follow(self, values: Mapping[str, Value], onsets: Mapping[str, float] | None = None) -> list[Tracking]:
        """With `component.variable` values, of which some hold from an onset on, s. What was found the time before last
        is closed.

        SimulationError: a unit fails in every recording. One that fails in some is left out there.
        """
        self._before.close()
        self._before, self._systems = self._systems, ExitStack()
        why: dict[str, SimulationError] = {}  # by recording

        def one(recording: Recording) -> Tracking | None:
            if recording.setup not in self._structures:
                return None
            try:
                return self._follow(recording, values, onsets or {})
            except SimulationError as error:
                why[recording.name] = error
                return None

        self._learn_structures(values, onsets or {}, why)
        found = [tracking for tracking in at_once(one, self.recordings) if tracking is not None]
        if not found and why:
            raise next(why[r.name] for r in self.recordings if r.name in why)
        return found

    def _learn_structures(
        self, values: Mapping[str, Value], onsets: Mapping[str, float], why: dict[str, SimulationError]
    ) -> None:
        """Of every set-up by its first recording that runs, before recordings are followed beside each other: which of
        them comes first must not depend on the machine's load."""
        for recording in self.recordings:
            if recording.setup in self._structures:
                continue
            try:
                with self._sampled(recording, values, onsets) as sampled:
                    ports = [port.name for port in self.plant.ports if port.name in sampled.system.inputs]
                    known = structure(sampled, sampled.free(recording), ports, self.noise)
                    self._structures[recording.setup] = known
            except SimulationError as error:
                why[recording.name] = error

    def _sampled(self, recording: Recording, values: Mapping[str, Value], onsets: Mapping[str, float]) -> SampledSystem:
        own = {name: value for name, value in values.items() if self.plant.has(name, recording)}
        late = {name: t for name, t in onsets.items() if name in own}
        return SampledSystem(self.plant.systems[recording.setup], list(recording.outputs), own, late)

    def _follow(self, recording: Recording, values: Mapping[str, Value], onsets: Mapping[str, float]) -> Tracking:
        sampled = self._systems.enter_context(self._sampled(recording, values, onsets))
        known, before = self._structures[recording.setup], self._latents.get(recording.name)
        both = (*known.latents, *(replace(latent, tau=SLOW) for latent in known.latents))
        reached = self._own_reach(recording, sampled, known)
        estimator = StateEstimator(sampled, self.noise, before or both, known.followed, reached)
        tracked = estimator.track(recording)
        estimator = _likely(estimator, tracked, AGAIN if before else FIRST)
        if not before:  # the first sizes are a guess: so was where it led
            tracked = estimator.track(recording)
            estimator = _likely(estimator, tracked, 1)
        self._latents[recording.name] = estimator.latents
        return Tracking(estimator, estimator.refilter(tracked))

    def _own_reach(self, recording: Recording, sampled: SampledSystem, known: Structure) -> NDArray[np.float64]:
        """What its free run reaches, or the set-up's first recording does: a machine that stands in one run turns a
        thousand times in another. Where it has no free run, it may be followed piece by piece all the same."""
        if recording.name not in self._reached:
            try:
                own = np.abs(sampled.free(recording).x).max(axis=0)
            except SimulationError:
                own = np.zeros_like(known.reached)
            self._reached[recording.name] = np.maximum(known.reached, own)
        return self._reached[recording.name]


def _likely(estimator: StateEstimator, tracked: Tracked, rounds: int) -> StateEstimator:
    """With the sizes as the recording shows them that this filter has tracked."""
    found: Filtered | None = tracked.filtered
    for _ in range(rounds):
        estimator, found = estimator.resized(tracked, found=found), None
    return estimator
