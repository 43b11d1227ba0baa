"""From a campaign to the search along its recorded motion, where its units let states be set."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.anchored.search import Progress, Search, Searcher
from cobot_joint.diagnosis.anchored.tracks import Tracker
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.estimation.problem import Run, may_set_in
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import SPEEDS, Plant, TermCandidate
from cobot_joint.diagnosis.state_estimation.noise import noise_of
from cobot_joint.diagnosis.state_estimation.states import states_of

MOTIONS = {*SPEEDS, "rad", "m"}


def can_follow(campaign: Campaign, plant: Plant) -> bool:
    """Whether states can be set, and recordings are runs in time."""
    if not isinstance(plant, FmuPlant) or any(states_of(system) is None for system in plant.systems.values()):
        return False
    return not any(recording.scatter for recording in campaign.train)


def motion_is_given(campaign: Campaign) -> bool:
    """Whether an angle, a way, or a speed drives the system: a free run does not lose its way then."""
    return any(r.units.get(name) in MOTIONS for r in campaign.train for name in r.inputs)


def follow(
    campaign: Campaign, plant: Plant, say: Progress, in_runs: Collection[str], start: Mapping[str, float]
) -> Search | None:
    """None: none of the recordings can be followed. The plant is one that `can_follow`. in_runs: see Searcher. start:
    base parameters as free runs have them re-fitted."""
    known = [term for term in plant.terms if not term.compensated]
    terms = [t for t in known if any(plant.has(t.name, r) for r in campaign.train)]
    with _searcher(campaign, plant, terms, say, in_runs) as searcher:
        try:
            return searcher.search(start)
        except SimulationError as error:
            say(f"the recordings cannot be followed: {error}")
            return None


def where_it_lies(campaign: Campaign, plant: Plant, run: Run, say: Progress) -> list[dict[str, object]]:
    """What the system with a run's values leaves along the recorded motion, by port and variable, as `discrepancy` of
    diagnosis.json; empty: none of the recordings can be followed. The plant is one that `can_follow`."""
    say("asking the recorded motion where the rest lies")
    with _searcher(campaign, plant, [], say, ()) as searcher:
        try:
            return searcher.background(run.values, run.onsets)
        except SimulationError as error:
            say(f"the recordings cannot be followed: {error}")
            return []


@contextmanager
def _searcher(
    campaign: Campaign, plant: Plant, terms: Sequence[TermCandidate], say: Progress, in_runs: Collection[str]
) -> Iterator[Searcher]:
    assert isinstance(plant, FmuPlant)
    seen = replace(campaign, recordings=campaign.train)  # not what is held out
    with Tracker(plant, seen.recordings, noise_of(seen)) as tracker:
        searcher = Searcher(plant, tracker, healthy(campaign, plant), terms, say, in_runs)
        searcher.onsets = campaign.onsets and may_set_in(seen.recordings)
        yield searcher


def healthy(campaign: Campaign, plant: Plant) -> dict[str, tuple[float, float]]:
    """Parameter -> what a healthy one may be, as far as its unit allows it: an efficiency of 1 within 6 % ends at 1."""
    found = {}
    for name, tolerance in campaign.tolerances.items():
        p = plant.parameters[name]
        low, high = tolerance.bounds(p.nominal)
        found[name] = max(low, p.lower), min(high, p.upper)
    return {name: (low, high) for name, (low, high) in found.items() if low < high}
