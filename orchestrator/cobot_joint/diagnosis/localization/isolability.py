"""Structural isolability: which units a difference in the recorded channels can point to at all.

Only which signal depends on which others counts, no numbers: what holds here holds for every experiment. The analysis
is that of Krysander, M. and Frisk, E. (2008), Sensor placement for fault diagnosis, IEEE Trans. Systems, Man, and
Cybernetics A 38(6), on the decomposition of Dulmage, A. L. and Mendelsohn, N. S. (1958), Coverings of bipartite graphs,
Canadian J. Math. 10.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from cobot_joint.diagnosis.localization.replay import Shown, unit_of
from cobot_joint.diagnosis.plant.influence import behind, influences
from cobot_joint.system.model import Connection, System


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


def isolability(system: System, channels: Collection[str], shown: Mapping[str, Shown]) -> Isolability:
    """What the channels can tell apart, one fault per unit. shown: which signals they show when nothing is missing."""
    model = equations(system, channels, shown)
    known = {*system.inputs, *channels}
    units = [c.name for c in system.components if any(e.unit == c.name for e in model)]

    def broken(fine: str | None) -> set[str | None]:
        """Units whose difference contradicts the equations that hold whatever unit `fine` does."""
        return {e.unit for e in redundant([e for e in model if fine is None or e.unit != fine], known)}

    beside = {unit: broken(unit) for unit in units}
    apart = {unit: tuple(other for other in units if other != unit and unit in beside[other]) for unit in units}
    detectable = broken(None)
    return Isolability(tuple(unit for unit in units if unit in detectable), apart)


def redundant(model: Sequence[Equation], known: Collection[str]) -> list[Equation]:
    """The equations that can be checked: those of the part that has more of them than unknown signals.

    These are the ones that alternating paths reach from equations which a maximum matching leaves over (Dulmage and
    Mendelsohn 1958).
    """
    unknown = {name: k for k, name in enumerate(sorted({n for e in model for n in e.names} - {*known}))}
    incidence = [[unknown[n] for n in e.names if n in unknown] for e in model]
    # 32-bit indices are all that SciPy 1.13's matching takes
    edges = np.array([(i, k) for i, names in enumerate(incidence) for k in names], dtype=np.int32).reshape(-1, 2)
    graph = csr_array((np.ones(len(edges)), edges.T), shape=(len(model), len(unknown)))
    matched = maximum_bipartite_matching(graph, perm_type="column").tolist()  # equation -> its unknown, -1: left over
    of = {k: i for i, k in enumerate(matched) if k >= 0}
    reached = {i for i, k in enumerate(matched) if k < 0}
    waiting = list(reached)
    while waiting:
        further = {of[k] for k in incidence[waiting.pop()]} - reached
        reached |= further
        waiting += further
    return [e for i, e in enumerate(model) if i in reached]


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
