"""Structural isolability: which units a difference in the recorded channels can point to at all.

Only which signal depends on which others counts, no numbers: what holds here holds for every experiment. The analysis
is that of Krysander and Frisk, 2008, as faultdiagnosistoolbox has it, which only this module knows.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import ModuleType

from cobot_joint.diagnosis.localization.replay import Shown, unit_of
from cobot_joint.diagnosis.plant.influence import behind, influences
from cobot_joint.system.model import Connection, System

NOBODY = "nobody"  # a fault in no equation: what can be told apart from it can be detected


class NoToolbox(ImportError):
    """faultdiagnosistoolbox is not there or does not import."""


@dataclass(frozen=True)
class Equation:
    """A relation between signals; `unit`: a difference in that unit breaks it (None: it always holds)."""

    unit: str | None
    names: frozenset[str]


@dataclass(frozen=True)
class Isolability:
    """detectable: units whose difference shows in the channels. apart: unit -> units from which it can then be told."""

    detectable: tuple[str, ...]
    apart: Mapping[str, tuple[str, ...]]

    @property
    def confused(self) -> dict[str, tuple[str, ...]]:
        """Detectable unit -> units that would explain its difference as well, at best."""
        return {u: tuple(o for o in self.detectable if o != u and o not in self.apart[u]) for u in self.detectable}

    @property
    def hidden(self) -> tuple[str, ...]:
        """Units whose difference does not show."""
        return tuple(unit for unit in self.apart if unit not in self.detectable)

    @property
    def classes(self) -> tuple[tuple[str, ...], ...]:
        """Detectable units; of any two of a class, neither can be told from the other."""
        found: list[list[str]] = []
        for unit in self.detectable:
            alike = [c for c in found if all(o in self.confused[unit] and unit in self.confused[o] for o in c)]
            if alike:
                alike[0].append(unit)
            else:
                found.append([unit])
        return tuple(map(tuple, found))


def together(found: Sequence[Isolability]) -> Isolability:
    """What several set-ups of the same bench tell between them; a unit that one lacks is told from what shows there."""
    units = dict.fromkeys(u for i in found for u in i.apart)
    apart = {
        u: tuple(
            o for o in units
            if o != u and any(u in i.detectable and (o in i.apart[u] or o not in i.apart) for i in found)
        )
        for u in units
    }  # fmt: skip
    return Isolability(tuple(u for u in units if any(u in i.detectable for i in found)), apart)


def prefetch() -> None:
    """Import the toolbox beside other work: it takes seconds. Whoever needs it is told where that fails."""
    pool = ThreadPoolExecutor(1)
    pool.submit(_toolbox)
    pool.shutdown(wait=False)


def _toolbox() -> ModuleType:
    try:
        import faultdiagnosistoolbox
    except (ImportError, AttributeError, ValueError) as error:  # an older one meets a newer numpy
        raise NoToolbox(f"{error}; pip install 'cobot-joint[structural]' brings it") from error
    return faultdiagnosistoolbox


def isolability(system: System, channels: Collection[str], shown: Mapping[str, Shown]) -> Isolability:
    """What the channels can tell apart, one fault per unit. shown: which signals they show when nothing is missing.

    Raises NoToolbox.
    """
    toolbox = _toolbox()
    model = equations(system, channels, shown)
    units = [c.name for c in system.components if any(e.unit == c.name for e in model)]
    known = {*system.inputs, *channels}
    unknown = sorted({name for e in model for name in e.names} - known)
    faults = [*units, NOBODY]
    definition = {
        "type": "MatrixStruc",
        "x": unknown,
        "X": [[int(name in e.names) for name in unknown] for e in model],
        "f": faults,
        "F": [[int(e.unit == unit) for unit in faults] for e in model],
        "Z": [],
    }
    blurred = toolbox.DiagnosisModel(definition).IsolabilityAnalysis()  # 0: row can be told from column
    apart = {
        unit: tuple(other for j, other in enumerate(units) if j != i and blurred[i, j] == 0)
        for i, unit in enumerate(units)
    }
    return Isolability(tuple(unit for i, unit in enumerate(units) if blurred[i, -1] == 0), apart)


def equations(system: System, channels: Collection[str], shown: Mapping[str, Shown]) -> list[Equation]:
    """Per output behind the channels how its unit computes it, as its ModelStructure says, and what channels show.

    An output that depends on no input is a state of its unit: it depends on all states and inputs, through their past.
    """
    before = influences(system)
    needed = behind(channels, before)
    found = [Equation(None, frozenset({name, *before[name]})) for name in channels]
    for component in system.components:
        outputs = {f"{component.name}.{u.variable.name}": u for u in component.unit.description.outputs}
        states = {name for name, u in outputs.items() if not u.dependencies} & needed
        sources = {c.sink: _source(c) for c in system.connections if c.sink_component == component.name}
        for name in [n for n in outputs if n in needed]:
            direct = {sources[v.name] for v in outputs[name].dependencies or () if v.name in sources}
            found.append(
                _shown(name, shown) or Equation(component.name, frozenset({name, *states, *(direct or before[name])}))
            )
    return found


def _shown(signal: str, shown: Mapping[str, Shown]) -> Equation | None:
    """A signal that equals one which a channel reads, as long as its unit is as it was, or is its integral: always."""
    s = shown.get(signal)
    read = [t for t, other in shown.items() if s and other == Shown(s.channel, "read")]
    if s is None or s.how == "read" or not read:
        return None
    return Equation(None if s.how == "integral" else unit_of(signal), frozenset({signal, read[0]}))


def _source(connection: Connection) -> str:
    return f"{connection.source_component}.{connection.source}" if connection.source_component else connection.source
