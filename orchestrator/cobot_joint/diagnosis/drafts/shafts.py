"""The shaft between two parts that both bring motion: how stiff it is where nobody said, and what is said of it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace

from cobot_joint.diagnosis.drafts.chain import Chain
from cobot_joint.system.model import Component

RIGID = 100.0  # Hz, above what a drive's loop follows
HARDLY = 50.0  # times a shaft's stiffness, of a mesh that takes a fiftieth of it away
MESH = {"gear.c", "gear.mesh.c", "gear.stiffness"}  # names of its stiffness that --set takes
STIFFNESS, DAMPING = "shaft.c_s", "shaft.d_s"


def with_stiff_parts(made: Chain, given: Collection[str]) -> Chain:
    """With a shaft, and beside a series elastic element a gear's mesh, that hardly give where nobody said how stiff."""
    return _with_stiff_mesh(_with_stiff_shaft(made, given), given)


def _with_stiff_mesh(made: Chain, given: Collection[str]) -> Chain:
    """The bench's gear took a tenth of a robot's spring of 320 N.m/rad away: more than that may be off."""
    if not {"gear", "elastic"} <= made.parts.keys() or MESH & {*given}:
        return made
    mesh, spring = (made.system.component(name).parameters for name in ("gear", "elastic"))
    times = HARDLY * float(spring["spring.c"]) / float(mesh["mesh.c"])
    own = {name: float(f"{times * float(mesh[name]):.3g}") for name in ("mesh.c", "mesh.d_g") if name in mesh}
    return _with(made, "gear", own) if times > 1 else made


def _with(made: Chain, name: str, values: Mapping[str, float]) -> Chain:
    """With other values of a component."""
    changed = [
        replace(c, parameters={**c.parameters, **values}) if c.name == name else c for c in made.system.components
    ]
    return replace(made, system=replace(made.system, components=tuple(changed)))


def _with_stiff_shaft(made: Chain, given: Collection[str]) -> Chain:
    """With a coupling that hardly gives, as most do, where nobody gave its stiffness and the inertias beside it are
    known. A leg's drive on a shaft of 20 N.m/rad had no answer in nine minutes, and on this one the right one."""
    if "shaft" not in made.parts or STIFFNESS in given or min(inertias := _beside(made)) <= 0:
        return made
    c, d = (float(f"{x:.3g}") for x in _as_good_as_rigid(*inertias))
    return _with(made, "shaft", {STIFFNESS: c} if DAMPING in given else {STIFFNESS: c, DAMPING: d})


def shaft_in_words(made: Chain, given: Collection[str]) -> list[str]:
    """What stands between two parts that both bring motion, as far as its stiffness and damping were not given;
    nothing: no shaft does, or both were."""
    if "shaft" not in made.parts or {STIFFNESS, DAMPING} <= {*given}:
        return []
    names, spring, inertias = list(made.parts), made.system.component("shaft").parameters, _beside(made)
    k, c_s, d_s = names.index("shaft"), float(spring[STIFFNESS]), float(spring[DAMPING])
    if STIFFNESS in given:
        critical = _critical(c_s, *inertias) if min(inertias) > 0 else math.nan
        little = (
            f", {100 * d_s / critical:.2g} % of critical; 5 % would be {0.05 * critical:.3g}" if critical > 0 else ""
        )
        return [f"the shaft's damping of {d_s:g} N.m.s/rad is assumed{little}: --set 'shaft.d_s=VALUE'\n"]
    stiff = " that hardly gives" if min(inertias) > 0 else ""
    between = f"a shaft{stiff}, of {c_s:g} N.m/rad, stands between {names[k - 1]} and {names[k + 1]}"
    return [f"{between}; that stiffness is assumed: set the real one with --set 'shaft.c_s=VALUE'\n"]


def mesh_in_words(made: Chain, given: Collection[str]) -> list[str]:
    """A gear's stiffness that nobody gave, beside a spring, or what it makes of a shaft's that was given; nothing: it
    hardly gives."""
    if MESH & {*given} or "gear" not in made.parts:
        return []
    mesh = made.system.component("gear").parameters["mesh.c"]
    if "elastic" in made.parts:
        return [f"the gear's mesh of {mesh:g} N.m/rad is assumed, beside the spring: --set 'gear.mesh.c=VALUE'\n"]
    if "shaft.c_s" not in given:
        return []
    shaft = made.system.component("shaft").parameters["shaft.c_s"]
    if mesh > HARDLY * shaft:
        return []
    return [
        f"the gear's mesh of {mesh:g} N.m/rad is assumed, and makes {1 / (1 / mesh + 1 / shaft):.3g} of the shaft's "
        f"{shaft:g}: --set 'gear.mesh.c=VALUE'; of teeth that hardly give: --set gear.mesh.c={HARDLY * shaft:g}\n"
    ]


def _beside(made: Chain) -> tuple[float, float]:
    """Inertias before and behind the shaft, kg.m2; 0: no parameter says; infinite: recorded motion."""
    names = list(made.parts)
    before, behind = (names[names.index("shaft") + step] for step in (-1, 1))
    first, second = (math.inf if n == "motion" else _inertia(made.system.component(n)) for n in (before, behind))
    return first, second


def _inertia(component: Component) -> float:
    """What of it turns with the shaft beside it, kg.m2; 0: no parameter says."""
    of = component.parameters
    named = (of.get(name) for name in ("rotor.J", "output.J_o", "arm.J_l", "pulley.J_p", "body.J"))
    hung = sum(of.get(f"{part}.m", 0.0) * of.get(f"{part}.r", 0.0) ** 2 for part in ("arm", "body"))
    return next((float(J) for J in named if J is not None), 0.0) + hung


def _as_good_as_rigid(a: float, b: float) -> tuple[float, float]:
    """Stiffness and damping of a shaft on which the larger of two inertias would ring at RIGID, and the two against
    each other with 0.7 of critical damping."""
    c = max(filter(math.isfinite, (a, b))) * (2 * math.pi * RIGID) ** 2
    return c, 0.7 * _critical(c, a, b)


def _critical(c: float, a: float, b: float) -> float:
    """Critical damping of two inertias against each other, 2 sqrt(c J); one may be infinite, recorded motion."""
    return 2 * math.sqrt(c / (1 / a + 1 / b))
