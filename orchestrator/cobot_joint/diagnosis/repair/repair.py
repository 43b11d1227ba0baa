"""The repaired system of a diagnosis, from diagnosis.json alone: whoever has that file can build the system again."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cobot_joint.diagnosis.plant.correction import formula_parameters, table_parameters
from cobot_joint.diagnosis.repair.export import Correction, write_repair
from cobot_joint.errors import UserError
from cobot_joint.system.model import System


def repair(diagnosis: Mapping[str, Any], systems: Mapping[str, System], out: Path) -> dict[str, Path]:
    """Set-up -> SSP in `out`, with its FMUs in OUT/fmus. UserError: the diagnosis does not fit the systems."""
    values = {name: estimate["value"] for name, estimate in diagnosis["repaired"].items()}
    findings = diagnosis["findings"]
    corrections = tuple(correction(k, f) for k, f in enumerate(findings, 1) if f.get("shape"))
    return write_repair(systems, values, out, onsets=onsets(findings, systems), corrections=corrections)


def onsets(findings: list[Mapping[str, Any]], systems: Mapping[str, System]) -> dict[str, float]:
    """Amplitudes of the terms that set in during a run -> when, s."""
    found = {}
    for component in {c.name: c for system in systems.values() for c in system.components}.values():
        for term in component.unit.terms:
            for finding in findings:
                named = f"{component.name}.{term.name}" in (finding["term"], *finding.get("equivalent", ()))
                if named and finding.get("onset") and term.amplitude:
                    found[f"{component.name}.{term.amplitude}"] = float(finding["onset"])
    return found


def correction(number: int, finding: Mapping[str, Any]) -> Correction:
    """The unit that adds an unlisted effect at its port: its formula where one holds up, else its table."""
    shape, component, onset = finding["shape"], finding["component"], finding.get("onset")
    if shape.get("formula") and shape.get("features"):
        terms = [(feature["coefficient"]["value"], feature["form"]) for feature in shape["features"]]
        parameters, signals = formula_parameters(terms, onset)
    elif shape.get("table"):
        (signal,) = (name for name in shape["table"] if name != "value")
        x, y = (np.array(shape["table"][name], dtype=float) for name in (signal, "value"))
        period, factor = shape.get("period", 0.0), shape.get("factor", "")
        parameters, signals = table_parameters(signal, x, y, onset, period=period, factor=factor)
    else:
        raise UserError(f"{finding['term']}: a shape is given without formula and without table, one is needed")
    own = tuple(signal if "." in signal else f"{component}.{signal}" for signal in signals)
    name = f"{component}_correction" + (f"_{number}" if number > 1 else "")
    return Correction(name, shape["port"], own, parameters)
