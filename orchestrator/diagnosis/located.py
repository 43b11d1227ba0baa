"""Where recordings and the re-fitted base model differ, before anything is named: by component, by regime, by time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from orchestrator.diagnosis.fit import Fit
from orchestrator.diagnosis.fmus import FmuPlant
from orchestrator.diagnosis.plant import Signals
from orchestrator.diagnosis.problem import Problem
from orchestrator.diagnosis.replay import Replayed, not_alone, parts, replay, shown_signals, suspects, wire_signals
from orchestrator.diagnosis.store import plain
from orchestrator.system.model import System


@dataclass(frozen=True)
class Located:
    """The answer to "where". `words`: the same in sentences."""

    replayed: tuple[Replayed, ...]
    suspects: tuple[str, ...]  # units in which one difference could lie, as far as replaying tells
    not_alone: Mapping[str, Sequence[str]]  # unit -> signals that would have to be recorded to replay it by itself
    words: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        return plain(
            {
                "components": {
                    "parts": [_part(r) for r in self.replayed],
                    "suspects": self.suspects,
                    "not_alone": dict(self.not_alone),
                },
                "words": self.words,
            }
        )


def locate_difference(problem: Problem, calibrated: Fit) -> Located:
    """What the calibrated residual says of where the difference lies. Raises SimulationError."""
    systems = problem.plant.systems if isinstance(problem.plant, FmuPlant) else {}
    systems = {setup: s for setup, s in systems.items() if any(r.setup == setup for r in problem.recordings)}
    signals = dict.fromkeys(s for system in systems.values() for s in wire_signals(system))
    simulated = problem.outputs(calibrated.run, list(signals))
    replayed, alone = _replayed(problem, calibrated, systems, simulated)
    suspected = suspects(replayed)
    return Located(replayed, suspected, alone, tuple(_component_words(replayed, suspected, alone)))


def _replayed(
    problem: Problem, calibrated: Fit, systems: Mapping[str, System], simulated: Sequence[Signals]
) -> tuple[tuple[Replayed, ...], dict[str, tuple[str, ...]]]:
    """Every part of every set-up, and what keeps units from being replayed alone."""
    found: list[Replayed] = []
    alone: dict[str, tuple[str, ...]] = {}
    for setup, system in systems.items():
        shown = shown_signals(problem, setup, system, simulated)
        recorded = list(dict.fromkeys(c for r in problem.recordings if r.setup == setup for c in r.outputs))
        whole, *smaller = parts(setup, system, recorded, shown)
        found += [replay(problem, calibrated, part, shown, simulated) for part in (whole, *smaller)]
        alone = not_alone(whole, shown) | alone
    return tuple(found), alone


def _component_words(
    replayed: Sequence[Replayed], suspected: Sequence[str], alone: Mapping[str, Sequence[str]]
) -> list[str]:
    said = [_said(r) for r in replayed]
    if suspected:
        said.append(f"If a single difference causes all of this, it lies in {_list(suspected, 'or')}.")
    elif any(r.off for r in replayed):
        said.append("No single unit explains all of this.")
    for unit, needed in alone.items():
        said.append(
            f"{unit} cannot be replayed alone: {_list(needed)} {'is' if len(needed) == 1 else 'are'} not recorded."
        )
    return said


def _said(r: Replayed) -> str:
    what = f"{_list(r.part.units)} ({r.part.setup})"
    drive = f"driven by the recorded {_list(r.part.driven)}" if r.part.driven else "as a whole"
    if not r.off:
        return f"{what}, {drive}: {_list(r.part.channels)} as recorded, within noise and tolerances."
    figures = [f"{c} (chi-square per sample {r.refitted[c] - r.healthy[c]:.2g} above noise)" for c in r.off]
    return f"{what}, {drive}: {_list(figures)} off, whatever the parameters inside their tolerances."


def _list(names: Sequence[str], word: str = "and") -> str:
    return f" {word} ".join([*([", ".join(names[:-1])] if names[1:] else []), *names[-1:]])


def _part(r: Replayed) -> dict[str, Any]:
    return {
        "setup": r.part.setup,
        "units": r.part.units,
        "driven_by": r.part.driven,
        "read_through": sorted(r.part.read),
        "channels": {
            c: {
                "off": c in r.off,
                "calibrated": r.calibrated[c],
                "refitted": r.refitted[c],
                "healthy": r.healthy[c],
                "scatter": r.scatter[c],
            }
            for c in r.part.channels
        },
    }
