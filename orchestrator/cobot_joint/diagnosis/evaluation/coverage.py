"""Whether the intervals of base parameters hold the values that a set of campaigns was simulated with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cobot_joint.diagnosis.evaluation.score import accepted, in_form, rate
from cobot_joint.diagnosis.store import read_object

PUBLISHED = {  # symbol of `true_parameters` in answers.json -> parameter of the joint
    "R": "motor_bldc.winding.R",
    "L": "motor_bldc.winding.L",
    "kt": "motor_bldc.winding.k",
    "Jm": "motor_bldc.rotor.J",
    "Tcm": "motor_bldc.friction.tau_C",
    "Bm": "motor_bldc.friction.d",
    "eta": "planetary_gear.mesh.eta",
    "Kg": "planetary_gear.mesh.c",
    "backlash": "planetary_gear.mesh.b",
    "TcG": "planetary_gear.friction.tau_C",
    "BG": "planetary_gear.friction.d",
    "Jp": "mr_brake_belt.pulley.J_p",
    "Kb": "mr_brake_belt.belt.c_b",
    "Db": "mr_brake_belt.belt.d_b",
    "Jb": "mr_brake_belt.brake.J_b",
    "Toff": "mr_brake_belt.brake.tau_off",
    "Boff": "mr_brake_belt.brake.d_off",
    "kbr": "mr_brake_belt.brake.k_b",
    "wbr": "mr_brake_belt.brake.omega_m",
}


def coverage(answers: Mapping[str, Mapping[str, Any]], out: Path) -> dict[str, Any] | None:
    """How many 95 % intervals of `repaired` in OUT/<case>/diagnosis.json hold the true value, as `rate` counts.

    None: the answers tell no true values. A parameter that is itself what was concealed is not among them.
    """
    with in_form():
        inside = [held for case, answer in answers.items() for held in _inside(answer, out / case)]
    return rate(sum(inside), len(inside)) if inside else None


def _inside(answer: Mapping[str, Any], folder: Path) -> list[bool]:
    diagnosis, _ = read_object(folder / "diagnosis.json")
    repaired = (diagnosis or {}).get("repaired") or {}
    concealed = {name for effect in answer["effects"] for name in accepted(effect)}
    told = [
        (value, repaired[name]["ci95"])
        for symbol, value in answer.get("true_parameters", {}).items()
        if (name := PUBLISHED.get(symbol)) in repaired and name not in concealed and repaired[name].get("ci95")
    ]
    return [bool(low <= value <= high) for value, (low, high) in told]
