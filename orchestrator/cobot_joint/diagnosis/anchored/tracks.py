"""Recordings followed with a system and values; the latent forces' sizes are kept from one time to the next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType

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
        why: list[SimulationError] = []

        def one(recording: Recording) -> Tracking | None:
            try:
                return self._follow(recording, values, onsets or {})
            except SimulationError as error:
                why.append(error)
                return None

        found = [tracking for tracking in at_once(one, self.recordings) if tracking is not None]
        if not found and why:
            raise why[0]
        return found

    def _follow(self, recording: Recording, values: Mapping[str, Value], onsets: Mapping[str, float]) -> Tracking:
        system = self.plant.systems[recording.setup]
        own = {name: value for name, value in values.items() if self.plant.has(name, recording)}
        late = {name: t for name, t in onsets.items() if name in own}
        sampled = self._systems.enter_context(SampledSystem(system, list(recording.outputs), own, late))
        if recording.setup not in self._structures:
            ports = [port.name for port in self.plant.ports if port.name in system.inputs]
            self._structures[recording.setup] = structure(sampled, sampled.free(recording), ports, self.noise)
        known, before = self._structures[recording.setup], self._latents.get(recording.name)
        both = (*known.latents, *(replace(latent, tau=SLOW) for latent in known.latents))
        estimator = StateEstimator(sampled, self.noise, before or both, known.followed)
        tracked = estimator.track(recording)
        estimator = _likely(estimator, tracked, AGAIN if before else FIRST)
        if not before:  # the first sizes are a guess: so was where it led
            tracked = estimator.track(recording)
            estimator = _likely(estimator, tracked, 1)
        self._latents[recording.name] = estimator.latents
        return Tracking(estimator, estimator.refilter(tracked))


def _likely(estimator: StateEstimator, tracked: Tracked, rounds: int) -> StateEstimator:
    """With the sizes as the recording shows them that this filter has tracked."""
    found: Filtered | None = tracked.filtered
    for _ in range(rounds):
        estimator, found = estimator.resized(tracked, found=found), None
    return estimator
