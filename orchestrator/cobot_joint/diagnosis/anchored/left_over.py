"""How large what was given no name is along the recorded motion, and where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cobot_joint.diagnosis.anchored.beside import Beside
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import SPEEDS


def left_over(at: Beside, plant: FmuPlant, alike: Mapping[str, Sequence[str]]) -> list[dict[str, object]]:
    """At each port: over the unit's own speed and load, and over time.

    share: of what repeats over speed and load, by the chi-square that it takes from the innovations. alike: port ->
    other components in which the same would do the same.
    """
    units = {port.name: (port.unit, {s: _variable(plant, s) for s in port.signals}) for port in plant.ports}
    thetas = [at.regression.theta[place] for place in at.regression.places]
    chi2 = [float(t @ at.regression.gram[p, p] @ t) for t, p in zip(thetas, at.regression.places, strict=True)]
    found: list[dict[str, object]] = []
    for group, theta, taken in zip(at.background, thetas, chi2, strict=True):
        rms = float(np.sqrt(np.mean((group.signals @ theta) ** 2)))
        unit, variables = units[group.port]
        row = {"port": group.port, "variable": variables.get(group.variable, "load"), "rms": rms, "unit": unit}
        row |= {"alike": list(alike[group.port])} if alike.get(group.port) else {}
        found.append({**row, "share": round(taken / max(sum(chi2), 1.0), 3)})
    for port in dict.fromkeys(name for t in at.trackings for name in t.estimator.ports):
        sizes = [[latent.sigma for latent in t.estimator.latents if latent.port == port] for t in at.trackings]
        rms = float(np.sqrt(np.mean([np.sum(np.square(s)) for s in sizes if s])))
        found.append({"port": port, "variable": "time", "rms": rms, "unit": units[port][0]})
    return found


def _variable(plant: FmuPlant, signal: str) -> str:
    component, variable = signal.split(".", 1)
    unit = next(c.unit for s in plant.systems.values() for c in s.components if c.name == component)
    return "w" if unit.unit_of(variable) in SPEEDS else "load"
