"""A machine as a chain of parts, `motor,gear,sensor,load`, as a System with its data-sheet values to fill in."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

from lxml import etree

from cobot_joint.diagnosis.data.parameters import with_values
from cobot_joint.errors import UserError, among
from cobot_joint.system.model import Component, Connection, Connector, System, Value
from cobot_joint.system.read import NS
from cobot_joint.system.wiring import CURRENT_MODE, unconnected
from cobot_joint.system.write import describe
from cobot_joint.units import Unit, find_fmu, load_unit


@dataclass(frozen=True)
class Part:
    """An element of a chain: its unit, its flanges, what its data sheet gives, and what can be fed and logged there.

    A flange is (phi, w, tau). `moves` says which side's motion is the part's own: it gives phi and w there and takes
    tau; at the other it takes phi and w and gives tau. Two parts that both bring motion need a shaft between.
    """

    unit: str
    words: str
    before: tuple[str, str, str] | None = None  # flange towards what drives it
    after: tuple[str, str, str] | None = None  # towards what it drives
    moves: tuple[str, ...] = ()  # of "before", "after": where the motion is its own
    data_sheet: tuple[str, ...] = ()  # parameters to fill in
    values: Mapping[str, Value] = field(default_factory=dict)  # that make the unit this part
    feeds: Mapping[str, tuple[str, str]] = field(default_factory=dict)  # input of the system -> (variable, words)
    shows: Mapping[str, tuple[str, str]] = field(default_factory=dict)  # output of the system -> (variable, words)
    fits: Mapping[str, str] = field(default_factory=dict)  # parameter -> how far a healthy part may be off


FRICTION = {"friction.tau_C": "30 %", "friction.d": "30 %"}
ASSUMED = "assumed"  # a damping, which no data sheet has
TEETH = "teeth"  # their stiffness, which few data sheets have
OFFERED = '# "30 %"   # stiffness: let it vary where a data sheet gave it'
RISE = '# "10 %"   # inductance: let it vary where the log is quick enough to show how a current rises'
LOOP = '# "30 %"   # bandwidth of the current loop: let it vary where commanded steps show how fast it is'
GIVEN = '"30 %"   # guess: given beside the base model, so that it is as little known as friction'
MASS = {"body.m": "5 %"}  # of a load that has one
VAGUE = (0.1, 30.0)  # times that, which a real one may be
UNKNOWN = (0.1, 10.0)  # the same of teeth of which nobody said how stiff they are
STICKS: Mapping[str, Value] = {"friction.law": 2}  # as real dry friction does
TURNS: Mapping[str, Value] = {"body.lead": 0.0, **STICKS}  # what it has of a mass hangs on its shaft
UNLIMITED: Mapping[str, Value] = {"drive.v_max": 0.0, "drive.i_peak": 0.0, "drive.w_max": 0.0}  # none that we know of
FORWARD = "drive.decoupling"
SHARPEST = 0.02  # of the assumed w_C: dry friction that holds at rest is as good as met there, and not too stiff yet
BODY = ("body.J", "friction.tau_C", "friction.d")
PARTS: dict[str, Part] = {
    "loop": Part(
        "position_loop", "servo controller of the motor, fed back from its shaft",
        data_sheet=("gains.k_p", "gains.k_v", "integrator.k_i", "integrator.k_iv", "saturation.u_max"),
        feeds={"phi_command": ("phi_ref", "wanted angle of the motor")},
        shows={"v_command": ("u_c", "control voltage")},
    ),
    "motor": Part(
        "motor_bldc", "brushless or DC motor with its drive", after=("phi", "w", "tau"), moves=("after",),
        data_sheet=("winding.R", "winding.L", "winding.k", "rotor.J", "friction.tau_C", "friction.d",
                    "inverter.v_bus", "drive.v_max", "drive.i_peak", "drive.w_max"),
        feeds={"v_command": ("set_value", "set value of the drive")},
        values={**UNLIMITED, **STICKS}, shows={"i_motor": ("i", "motor current"), "w_motor": ("w", "motor speed")},
        fits={"winding.R": "5 %", "winding.L": RISE, "winding.k": "3 %", "rotor.J": "4 %"} | FRICTION,
    ),
    "motion": Part(
        "driven_load", "the motion as it was recorded, whatever torque that takes", after=("phi", "w", "tau"),
        moves=("after",), values={"motion.source": 2, "friction.tau_C": 0.0, "friction.d": 0.0},
        feeds={"w": ("w_imposed", "speed, as it was recorded")},
    ),
    "gear": Part(
        "planetary_gear", "gearhead", before=("phi", "w", "tau"), after=("phi_o", "w_o", "tau_s"), moves=("after",),
        data_sheet=("ratio.N", "mesh.eta", "mesh.c", "mesh.d_g", "mesh.b", "housing.J_coupled", "output.J_o",
                    "friction.tau_C", "friction.d"),
        fits={"mesh.eta": "6 %", "mesh.c": TEETH, "mesh.b": "30 %", "mesh.d_g": ASSUMED} | FRICTION,
    ),
    "harmonic": Part(
        "harmonic_drive", "harmonic drive", before=("phi", "w", "tau"), after=("phi_o", "w_o", "tau_s"),
        moves=("after",),
        data_sheet=("ratio.N", "flex_spline.K_1", "flex_spline.K_2", "flex_spline.K_3", "flex_spline.T_1",
                    "flex_spline.T_2", "wave_generator.J_coupled", "load_friction.mu", "output.J_o",
                    "friction.tau_C", "friction.d"),
        fits={"flex_spline.K_1": "30 %", "load_friction.mu": "30 %", "flex_spline.d_g": ASSUMED} | FRICTION,
    ),
    "cycloidal": Part(
        "cycloidal_drive", "cycloidal drive", before=("phi", "w", "tau"), after=("phi_o", "w_o", "tau_s"),
        moves=("after",),
        data_sheet=("ratio.N", "mesh.K_1", "mesh.K_2", "mesh.T_1", "eccentric.J_coupled", "load_friction.mu",
                    "output.J_o", "friction.tau_C", "friction.d"),
        fits={"mesh.K_2": "30 %", "load_friction.mu": "30 %", "mesh.d_g": ASSUMED} | FRICTION,
    ),
    "elastic": Part(
        "series_elastic", "series elastic element", before=("phi_o", "w_o", "tau_s"), after=("phi_p", "w_p", "tau_s"),
        data_sheet=("spring.c", "spring.d", "stop.e_max", "reading.c_r"),
        shows={"tau_sensor": ("tau_reading", "torque read from the deflection")},
        fits={"spring.c": "10 %", "spring.d": ASSUMED},
    ),
    "sensor": Part(
        "torque_sensor", "torque sensor", before=("phi_o", "w_o", "tau_s"), after=("phi_p", "w_p", "tau_s"),
        data_sheet=("shaft.c_s", "shaft.d_s", "amplifier.tau_rated"),
        shows={"tau_sensor": ("tau_reading", "the torque sensor's reading")},
        fits={"shaft.c_s": OFFERED, "shaft.d_s": ASSUMED},
    ),
    "shaft": Part(
        "torque_sensor", "shaft or coupling", before=("phi_o", "w_o", "tau_s"), after=("phi_p", "w_p", "tau_s"),
        data_sheet=("shaft.c_s", "shaft.d_s"), values={"shaft.c_s": 20.0, "shaft.d_s": 0.01},
        fits={"shaft.c_s": OFFERED, "shaft.d_s": ASSUMED},
    ),
    "load": Part(
        "driven_load", "turning load", before=("phi", "w", "tau"), moves=("before",), data_sheet=BODY,
        values=TURNS, shows={"w_load": ("w", "speed of the load")}, fits={"body.J": "10 %"} | FRICTION,
    ),
    "link": Part(
        "link", "link of a robot", before=("phi_p", "w_p", "tau_s"), moves=("before",),
        data_sheet=("arm.J_l", "arm.m", "arm.r", "friction.tau_C", "friction.d"), values=STICKS,
        shows={"phi_link": ("phi_p", "angle of the link"), "w_link": ("w_p", "speed of the link")},
        fits={"arm.J_l": "10 %", "arm.m": "5 %", "arm.r": "5 %"} | FRICTION,
    ),
    "pendulum": Part(
        "driven_load", "pendulum", before=("phi", "w", "tau"), moves=("before",),
        values={"gravity.g": 9.80665, "body.m": 0.5, "body.r": 0.1, **TURNS},
        data_sheet=("body.m", "body.r", *BODY), shows={"phi_load": ("phi", "angle of the pendulum")},
        fits={"body.m": "5 %", "body.r": "5 %", "body.J": "10 %"} | FRICTION,
    ),
    "screw": Part(
        "driven_load", "carriage on a screw or belt", before=("phi", "w", "tau"), moves=("before",),
        values={"body.lead": 8e-4, "body.m": 5.0, "body.J": 1e-5, **STICKS},
        data_sheet=("body.lead", "body.m", *BODY), shows={"s": ("s", "displacement of the carriage")},
        fits={"body.m": "10 %", "body.J": "10 %"} | FRICTION,
    ),
    "brake": Part(
        "mr_brake_belt", "belt with a magneto-rheological brake", before=("phi_p", "w_p", "tau_s"), moves=("before",),
        data_sheet=("pulley.J_p", "belt.r", "belt.c_b", "brake.J_b", "brake.tau_off", "brake.d_off", "brake.k_b"),
        feeds={"i_brake": ("i_b", "set value of the brake's driver")},
        fits={"brake.k_b": "5 %", "brake.tau_off": "25 %"},
    ),
    "friction": Part(
        "driven_load", "a drive at constant speeds: speed in, friction torque out", values={"motion.source": 2},
        data_sheet=("friction.tau_C", "friction.d", "friction.w_C"), feeds={"w": ("w_imposed", "speed")},
        shows={"tau": ("tau_f", "friction torque")}, fits={"friction.tau_C": "90 %", "friction.d": "90 %"},
    ),
}  # fmt: skip
ALIASES = {  # as data sheets call them
    "terminal_resistance": "winding.R", "terminal_inductance": "winding.L", "torque_constant": "winding.k",
    "resistance": "winding.R", "inductance": "winding.L", "back_emf_constant": "winding.k", "k_e": "winding.k",
    "k_M": "winding.k", "k_t": "winding.k", "rotor_inertia": "rotor.J", "reduction": "ratio.N",
    "gear_ratio": "ratio.N", "ratio": "ratio.N", "i": "ratio.N", "efficiency": "mesh.eta", "backlash": "mesh.b",
    "stiffness": "mesh.c", "rated_torque": "amplifier.tau_rated", "supply_voltage": "inverter.v_bus",
    "pitch": "body.lead", "friction": "friction.tau_C", "friction_torque": "friction.tau_C",
    "coulomb_friction": "friction.tau_C", "viscous_friction": "friction.d", "quadratic": "windage.c",
    "fan": "windage.c", "windage": "windage.c",
}  # fmt: skip
INERTIA = ("rotor.J", "body.J", "arm.J_l", "wave_generator.J_coupled", "eccentric.J_coupled", "housing.J_coupled")
SEVERAL = {"J": INERTIA, "inertia": INERTIA, "input_inertia": INERTIA, "mass": ("body.m", "arm.m")}  # by the unit


@dataclass(frozen=True)
class Chain:
    """A system, and the parts behind its components."""

    system: System
    parts: Mapping[str, Part]


def chain(names: Sequence[str], name: str = "bench") -> Chain:
    """Parts by name, wired in that order. UserError: no such part, or two that do not meet."""
    if unknown := [n for n in names if n not in PARTS]:
        raise UserError(f"--chain {unknown[0]!r}: there is no such part, allowed are {among(PARTS)}")
    if len(set(names)) < len(names):
        raise UserError(f"--chain {','.join(names)}: each part may stand there once")
    names = _with_shafts(list(names))
    parts = {n: PARTS[n] for n in names}
    components = tuple(_component(n, part) for n, part in parts.items())
    units = {c.name: c.unit for c in components}
    wires = [wire for a, b in pairwise(names) for wire in _wires(a, b, units)]
    inputs, outputs = {}, {}
    for n, part in parts.items():
        if n == "loop" and "screw" in names:
            part = replace(part, feeds={"s_command": ("s_ref", "wanted displacement of the carriage")})
        if n == names[0] and part.before is not None and "before" in part.moves:  # no part drives it: a torque does
            part = replace(part, feeds={"tau": (part.before[2], "torque that drives it"), **part.feeds})
        fed = {(w.sink_component, w.sink) for w in wires}
        for connector, (variable, words) in part.feeds.items():
            if (n, variable) in fed:
                continue
            inputs[connector] = Connector(connector, "input", "Real", units[n].unit_of(variable), words)
            wires.append(Connection(None, connector, n, variable))
        for connector, (variable, words) in part.shows.items():
            outputs[connector] = Connector(connector, "output", "Real", units[n].unit_of(variable), words)
            wires.append(Connection(n, variable, None, connector))
    if names[0] == "motion" and len(names) > 1 and not any("tau_sensor" in part.shows for part in parts.values()):
        outputs["tau_drive"], wire = _torque_taken(names[1], units)
        wires.append(wire)
    if not outputs:
        raise UserError(f"--chain {','.join(names)}: nothing of it is logged; add a motor, a sensor or a load")
    return Chain(_with_free_ends(System(name, components, tuple(wires), inputs, outputs)), parts)


def _torque_taken(driven: str, units: Mapping[str, Unit]) -> tuple[Connector, Connection]:
    """What imposed motion takes from the part that it drives, where no sensor reads a torque."""
    torque = (PARTS[driven].before or ("", "", ""))[2]
    words = "torque that the motion takes"
    shown = Connector("tau_drive", "output", "Real", units[driven].unit_of(torque), words)
    return shown, Connection(driven, torque, None, shown.name)


def _with_free_ends(system: System) -> System:
    """What nothing gives stands in the system as what it is: no torque at a free end, a supply of so many volts."""
    stays: dict[str, dict[str, float]] = {c.name: {} for c in system.components}
    for name, value, _ in unconnected(system):
        component, variable = name.split(".", 1)
        stays[component][variable] = value
    components = (replace(c, parameters={**c.parameters, **stays[c.name]}) for c in system.components)
    return replace(system, components=tuple(components))


def _with_shafts(names: list[str]) -> list[str]:
    """A shaft between two parts that both bring motion."""
    whole: list[str] = []
    for name in names:
        if whole and "after" in PARTS[whole[-1]].moves and "before" in PARTS[name].moves:
            if "shaft" in names or "shaft" in whole:
                raise UserError(f"--chain: {whole[-1]} and {name} both bring motion, put a sensor between them")
            whole.append("shaft")
        whole.append(name)
    return whole


def _component(name: str, part: Part) -> Component:
    unit = load_unit(find_fmu(f"{part.unit}.fmu"))
    filled = {p: float(unit.variables[p].start or 0.0) for p in part.data_sheet}
    return Component(name, f"resources/{part.unit}.fmu", unit, {**filled, **part.values})


def _wires(a: str, b: str, units: Mapping[str, Unit]) -> list[Connection]:
    driving, driven = PARTS[a], PARTS[b]
    if a == "loop":
        if b != "motor":
            raise UserError(f"--chain {a},{b}: a loop commands a motor, put one behind it")
        return [Connection(a, "u_c", b, "set_value"), Connection(b, "phi", a, "phi"), Connection(b, "w", a, "w")]
    if driving.after is None or driven.before is None:
        raise UserError(f"--chain {a},{b}: {a} has nothing behind it that could drive a {b}" if driving.after is None
                        else f"--chain {a},{b}: {b} is driven by nothing, it stands first")  # fmt: skip
    (phi, w, tau), (phi_in, w_in, tau_in) = driving.after, driven.before
    if "after" in driving.moves:
        wires = [Connection(a, phi, b, phi_in), Connection(a, w, b, w_in), Connection(b, tau_in, a, tau)]
    elif "before" in driven.moves:
        wires = [Connection(b, phi_in, a, phi), Connection(b, w_in, a, w), Connection(a, tau, b, tau_in)]
    else:
        raise UserError(f"--chain {a},{b}: neither of them brings motion, put a gear or a load between them")
    if "J_coupled" in units[a].variables and units[b].variables.get("J_coupled") is not None:
        wires.append(Connection(b, "J_coupled", a, "J_coupled"))
    return wires


def with_data_sheet(made: Chain, given: Mapping[str, str]) -> Chain:
    """`motor.R` or `motor.torque_constant` -> "38.5 mN.m/A": values in any unit that converts. UserError: no such.

    A drive in current mode gets a loop that loses nothing to the back-EMF, unless its feedforward is given: with a
    resistance that no data sheet of such a drive has, the loss acts as an inertia k^2/(R w_c) of any size.
    """
    components = {c.name: c for c in made.system.components}
    values = {}
    for key, text in given.items():
        name, _, wanted = key.partition(".")
        if name not in components:
            raise UserError(f"--set {key}: there is no such part, the chain has {among(components)}")
        values[f"{name}.{_parameter(key, wanted, components[name].unit)}"] = text
    system = with_values({"": made.system}, values, "--set")[""]
    drives = [c.name for c in system.components if c.parameters.get("drive.mode") == CURRENT_MODE]
    forward = {f"{name}.{FORWARD}": 1.0 for name in drives if f"{name}.{FORWARD}" not in values}
    return replace(made, system=with_values({"": system}, {**_lead(system), **values, **forward}, "--set")[""])


def _lead(system: System) -> dict[str, float]:
    """What a servo controller that is asked for a carriage's displacement knows of the way there: the screw's lead over
    the ratios of gears before it. Nothing: it is asked for an angle."""
    if "s_command" not in system.inputs:
        return {}
    ratios = [float(c.parameters["ratio.N"]) for c in system.components if "ratio.N" in c.parameters]
    return {"loop.gains.lead": float(system.component("screw").parameters["body.lead"]) / abs(math.prod(ratios))}


def kept_in_words(made: Chain, given: Iterable[str]) -> list[str]:
    """What of the parts' data sheets was not given, a line each: the values of the bench, not of this machine. The
    shaft has words of its own. given: names as --set takes them."""
    units = {c.name: c.unit for c in made.system.components}
    named = [key.partition(".") for key in given]
    whole = {f"{name}.{_parameter(f'{name}.{wanted}', wanted, units[name])}" for name, _, wanted in named}
    lines = []
    for c in (c for c in made.system.components if c.name in made.parts and c.name != "shaft"):
        names = [n for n in made.parts[c.name].data_sheet if f"{c.name}.{n}" not in whole]
        values = {n: float(c.parameters.get(n, c.unit.variables[n].start) or 0.0) for n in names}
        units_of = {n: unit if (unit := c.unit.unit_of(n)) != "1" else "" for n in names}
        told = [f"{n} = {x:g} {units_of[n] or ''}".rstrip() for n, x in values.items() if x]
        if told:
            lines.append(f"{c.name}: not given, the bench's values are kept: {', '.join(told)}\n")
    return lines


def _parameter(key: str, wanted: str, unit: Unit) -> str:
    """The parameter of that path, data-sheet name, or only one whose path ends so."""
    every = [n for n, v in unit.variables.items() if v.causality == "parameter"]  # with choices, by their names
    real = [n for n in every if unit.variables[n].type == "Real"]
    aliases = SEVERAL.get(wanted, (ALIASES.get(wanted, wanted),))
    found = [n for n in aliases if n in every][:1] or [n for n in real if n.endswith(f".{wanted}")]
    found = found or [n for n in every if n.endswith(f".{wanted}")]
    base = [n for n in found if n in {p for part in PARTS.values() for p in part.data_sheet}]
    found = base or found
    if len(found) != 1:
        if found:
            raise UserError(f"--set {key}: which of {among(found, 20)}")
        sheet = [n for n in real if n in {p for part in PARTS.values() for p in part.data_sheet}]
        like = [n for n in every if n not in sheet and {*wanted.lower().split(".")} & {*n.lower().split(".")}]
        near = difflib.get_close_matches(wanted, every, 5, 0.6)
        others = among(list(dict.fromkeys([*near, *like])) or [n for n in every if n not in sheet], 5)
        raise UserError(
            f"--set {key}: there is no such parameter; its data sheet has {among(sheet, 20)}; any other of the unit "
            f"is allowed too, as {others}; --list shows all"
        )
    return found[0]


def tolerances(component: Component, fits: Mapping[str, str]) -> dict[str, str]:
    """Parameter -> how far off, as TOML; also of w_C, where dry friction changes its sign over it: no data sheet has
    that. "" where the parameter is 0: only whoever knows the machine can give a range. After #, what is only offered:
    damping, which the recordings of a machine without a resonance do not tell. Of teeth that are as stiff as the unit
    assumes, both: with 3000 N.m/rad within 30 % for a gear that hardly gave, ringing was a stiffness that grows, 95 %.
    """
    starts = {n: float(component.unit.variables[n].start or 0.0) for n in fits}
    nominal = {n: float(component.parameters.get(n, start) or 0.0) for n, start in starts.items()}
    unknown = [n for n, off in fits.items() if off == TEETH and nominal[n] == starts[n]]
    damping = "damping of these" if unknown else "damping, on no data sheet: let it vary if a resonance shows"
    lines = {}
    for n, off in fits.items():
        if off in (OFFERED, RISE):
            lines[n] = off
        elif nominal[n] == 0.0:
            lines[n] = ""
        elif off == ASSUMED:
            lines[n] = f"{'' if unknown else '# '}{_times(VAGUE, nominal[n])}   # {damping}"
        elif n in unknown:
            why = f"guess: {nominal[n]:g} is assumed where nobody says; '30 %' where a data sheet does"
            lines[n] = f"{_times(UNKNOWN, nominal[n])}   # {why}"
        else:
            lines[n] = '"30 %"' if off == TEETH else f'"{off}"'
    there = component.parameters
    lines |= {n: f'"{off}"' for n, off in MASS.items() if n not in fits and float(there.get(n, 0.0) or 0.0)}
    has = {term.amplitude: term.neutral for term in component.unit.terms if term.amplitude is not None}
    lines |= {n: GIVEN for n, none in has.items() if float(component.parameters.get(n, none)) != none}
    if component.parameters.get("drive.mode") == CURRENT_MODE:  # its loop gives whatever voltage the current takes
        lines = {n: line for n, line in lines.items() if n not in ("winding.R", "winding.L")}
        lines["drive.w_c"] = LOOP
    if lines.get("friction.tau_C") and component.parameters.get("friction.law") != STICKS["friction.law"]:
        w_C = float(component.parameters.get("friction.w_C", component.unit.variables["friction.w_C"].start) or 0.0)
        why = "guess: the unit smooths dry friction below w_C, which no data sheet gives"
        lines["friction.w_C"] = f"[{SHARPEST * w_C:g}, {w_C:g}]   # {why}"
    return lines


def _times(factors: tuple[float, float], value: float) -> str:
    """A range, as TOML."""
    low, high = (k * value for k in factors)
    return f"[{low:g}, {high:g}]"


def write_readable(made: System, parts: Iterable[tuple[str, str]], path: Path) -> Path:
    """An .ssd with a comment at every component and every value: what it is, and its unit."""
    root = etree.fromstring(describe(made, {c.name: c.source for c in made.components}))
    words = dict(parts)
    for node in root.iter(f"{{{NS['ssd']}}}Component"):
        component = made.component(node.get("name"))
        if text := words.get(component.name):
            node.addprevious(etree.Comment(f" {text} "))
        for parameter in node.iter(f"{{{NS['ssv']}}}Parameter"):
            variable = component.unit.variables[parameter.get("name")]
            unit = component.unit.unit_of(variable.name) or "1"
            text = f" {variable.description or variable.name} [{unit}] ".replace("--", "-")
            parameter.addprevious(etree.Comment(text))
    etree.indent(root)
    path.write_bytes(etree.tostring(root, pretty_print=True, xml_declaration=True, encoding="UTF-8"))
    return path
