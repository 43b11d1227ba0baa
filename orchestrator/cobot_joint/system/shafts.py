"""What turns together: positions that follow from one another where every spring is relaxed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from cobot_joint.system.model import Component, System

RATIO, MODE = "ratio.N", "ratio.from"  # of a gear, phi = N phi_o; where it comes from, 1: that value
RATES = {"phi": "w", "phi_o": "w_o", "phi_p": "w_p", "s": "v"}  # of a unit's positions
BASE = {("rad", "rad/s"), ("m", "m/s")}  # units of a position and its rate, without a factor between them
LEAD = "body.lead"  # of a screw, s = lead phi


class Link(NamedTuple):
    """Two positions of which, with every spring relaxed, the second is so many times the first."""

    a: str  # component.variable
    b: str
    times: float


def turning_with(system: System, place: str) -> dict[str, float]:
    """Positions, `component.variable`, that go with one, itself among them -> how many times as far: through wires,
    gears and springs, and screws."""
    links = [*_wires(system), *(link for c in system.components for link in _inside(c))]
    reached, left = {place: 1.0}, [place]
    while left:
        here = left.pop()
        for a, b, times in (*links, *(Link(b, a, 1 / times) for a, b, times in links)):
            if a == here and b not in reached:
                reached[b] = reached[here] * times
                left.append(b)
    return reached


def position_behind(system: System, name: str) -> tuple[str, float] | None:
    """The position, `component.variable`, whose rate an output or `component.variable` is, and how many times it. None:
    its unit shows none, or not in rad and rad/s, or m and m/s."""
    wire = next((w for w in system.connections if w.sink_component is None and w.sink == name), None)
    place, factor = (f"{wire.source_component}.{wire.source}", wire.factor) if wire else (name, 1.0)
    own, _, variable = place.partition(".")
    position = next((p for p, rate in RATES.items() if rate == variable), None)
    there = [c.unit for c in system.components if c.name == own and {position, variable} <= c.unit.variables.keys()]
    known = position and any((u.unit_of(position), u.unit_of(variable)) in BASE for u in there)
    return (f"{own}.{position}", factor) if known else None


def speeds_with(system: System, name: str) -> dict[str, float]:
    """States, `component.variable`, that are speeds of shafts which turn with an output or `component.variable` that is
    one -> how many times it. Empty: it is no speed."""
    behind = position_behind(system, name)
    units = {c.name: c.unit for c in system.components}
    found = {}
    for position, times in turning_with(system, behind[0]).items() if behind else ():
        component, _, variable = position.partition(".")
        rate = RATES.get(variable)
        state = next((s for s in (rate, f"x_{rate}") if s in units[component].states), None)
        if state and behind:
            found[f"{component}.{state}"] = times / behind[1]
    return found


def angles_with(system: System, place: str) -> dict[str, float]:
    """States of shafts that turn with an angle, itself among them -> how many times as far; of a way it alone."""
    units = {c.name: c.unit for c in system.components}
    states = {f"{name}.{state}" for name, unit in units.items() for state in unit.states}
    angles = {n for n in states if units[n.split(".")[0]].unit_of(n.split(".", 1)[1]) == "rad"}
    if place not in angles:
        return {place: 1.0}
    return {name: times for name, times in turning_with(system, place).items() if name in angles}


def _wires(system: System) -> Iterator[Link]:
    for w in system.connections:
        if w.source_component is None or w.sink_component is None or w.factor == 0 or w.offset != 0:
            continue
        if system.component(w.source_component).unit.unit_of(w.source) == "rad":
            yield Link(f"{w.source_component}.{w.source}", f"{w.sink_component}.{w.sink}", w.factor)


def _inside(c: Component) -> Iterator[Link]:
    variables = c.unit.variables
    if RATIO in variables and {"phi", "phi_o"} <= variables.keys():
        N = _value(c, RATIO)
        if c.parameters.get(MODE, 1) in (1, "value") and N:
            yield Link(f"{c.name}.phi_o", f"{c.name}.phi", N)
    elif {"phi_o", "phi_p"} <= variables.keys():  # either side of a spring that is relaxed
        yield Link(f"{c.name}.phi_o", f"{c.name}.phi_p", 1.0)
    elif LEAD in variables and {"phi", "s"} <= variables.keys() and (lead := _value(c, LEAD)):
        yield Link(f"{c.name}.phi", f"{c.name}.s", lead)


def _value(c: Component, parameter: str) -> float:
    return float(c.parameters.get(parameter, c.unit.variables[parameter].start) or 0.0)
