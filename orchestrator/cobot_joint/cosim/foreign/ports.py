"""Do the ports of another FMU fit where a component's wires are: names, causality, types, units of measure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from cobot_joint.errors import UserError
from cobot_joint.system.model import Component, System
from cobot_joint.system.swap import Replacement, wired_ports
from cobot_joint.system.wiring import conversion, port_type, unit_endpoint
from cobot_joint.units import Unit


@dataclass(frozen=True)
class Finding:
    """What was looked at, and what follows. `verdict`: ok; lacks: the unit can be used, with less; no: it cannot."""

    what: str
    verdict: str
    detail: str = ""


def port_findings(system: System, old: Component, new: Replacement, unit: Unit) -> Iterator[Finding]:
    """One per wired port of the component."""
    for port in wired_ports(system, old.name):
        own = new.name(port)
        what = f"port {port}" if own == port else f"port {port} = {own or 'left out'}"
        if not own:
            yield Finding(what, "lacks", "its wires are left out")
        elif own not in unit.variables:
            yield Finding(what, "no", f"there is none of that name{_alike(old.unit, port, unit)}")
        else:
            yield _fitting(what, old, port, unit, own)


def _fitting(what: str, old: Component, port: str, unit: Unit, own: str) -> Finding:
    was, is_ = old.unit.variables[port], unit.variables[own]
    if was.causality != is_.causality:
        return Finding(what, "no", f"{is_.causality} is given, {was.causality} is needed")
    if port_type(was.type) != port_type(is_.type):
        return Finding(what, "no", f"{is_.type} is given, {was.type} is needed")
    if unit.unit_of(own) is None and was.type == "Real":
        return Finding(what, "lacks", f"no unit of measure is given, it is taken as [{old.unit.unit_of(port)}]")
    ends = unit_endpoint(old.name, old.unit, port, what), unit_endpoint(old.name, unit, own, what)
    try:
        factor, offset = conversion(*ends, what)
    except UserError:
        return Finding(what, "no", f"[{ends[1].unit}] is given, what converts to [{ends[0].unit}] is needed")
    scaled = "" if (factor, offset) == (1.0, 0.0) else f", converted to [{ends[0].unit}]"
    return Finding(what, "ok", f"[{ends[1].unit}]{scaled}" if ends[1].unit else "")


def _alike(old: Unit, port: str, unit: Unit) -> str:
    """`; of its outputs in [N.m] there are ...`"""
    causality, measure = old.variables[port].causality, old.unit_of(port)
    alike = [v.name for v in unit.variables.values() if v.causality == causality and unit.unit_of(v.name) == measure]
    return f"; its {causality}s in [{measure}] are {', '.join(alike)}" if alike else ""
