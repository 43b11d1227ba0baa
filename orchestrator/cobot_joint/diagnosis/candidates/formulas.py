"""The dictionary of forms that an unlisted effect may have: functions of a component's own signals and of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.order_spectrum import order_spectrum
from cobot_joint.diagnosis.estimation.problem import Problem, Vector
from cobot_joint.diagnosis.plant.correction import SGN
from cobot_joint.diagnosis.plant.plant import Port, Signals

ORDERS = tuple(float(n) for n in range(1, 49))  # periods per turn that are looked for
FEW, MORE = 2, 4  # waves that are tried at every port, and at those where the residual points
LOADS = ("i", "tau_e", "tau_g", "tau_s", "tau_m", "tau_belt")  # names of a unit's current or torque
WIDTHS = (1e-3, 1e-2, 5e-2)  # of a sign that is smoothed, over the largest speed
DECAYS = (0.03, 0.1, 0.3)  # speeds over which friction falls, over the largest speed
SLOW = (1, 4, 16)  # s
Wave = tuple[str, float]  # angle, periods per turn


@dataclass(frozen=True)
class Local:
    """What a component knows in one run: its signals under their short names, (n,) each, and the time since start."""

    signals: Mapping[str, Vector]
    time: Vector

    def wave(self, name: str, order: float) -> dict[str, Vector]:
        """Sine and cosine of an angle."""
        forms = (("sin", np.sin), ("cos", np.cos))
        return {f"{f}({order:g}*{name})": function(order * self.signals[name]) for f, function in forms}


class Dictionary:
    """Forms at one port on the trajectories of one fit."""

    def __init__(self, problem: Problem, start: Fit, port: Port) -> None:
        self.problem, self.port = problem, port
        self.outputs = problem.outputs(start.run, port.signals)
        self.locals = {
            r.name: Local({n.split(".", 1)[1]: v for n, v in outputs.items() if n in port.signals}, r.time - r.time[0])
            for r, outputs in zip(problem.recordings, self.outputs, strict=True)
            if problem.plant.has(port.name, r)
        }
        names = [n.split(".", 1)[1] for n in port.signals]
        self.angles = [n.split(".", 1)[1] for n in port.angles]
        self.speed = next((w for w in map(speed_of, self.angles) if w in names), None)
        self.loads = [n for n in LOADS if n in names][:2]
        self.voltage = "set_value" if "set_value" in names else None

    def reach(self, name: str) -> float:
        """The signal's largest magnitude in any run, to one digit; 0: it never moves."""
        largest = max((float(np.max(np.abs(k.signals[name]))) for k in self.locals.values()), default=0.0)
        return float(f"{largest:.0e}")

    def waves(self, residual: Vector) -> list[Wave]:
        """Orders of the port's angles that stand out of the residual, clearest first."""
        found: list[tuple[float, Wave]] = []
        for name in self.port.angles:
            power, _ = order_spectrum(self.problem, residual, name, self.outputs, ORDERS)
            found += [(float(p), (name.split(".", 1)[1], n)) for n, p in zip(ORDERS, power, strict=True) if p > 0]
        return [wave for _, wave in sorted(found, reverse=True)]

    def first(self, waves: Sequence[Wave]) -> dict[str, dict[str, Vector]]:
        """Form -> recording -> values, of the few that tell where the residual points."""
        return self._collect(self._first, waves[:FEW])

    def more(self, waves: Sequence[Wave]) -> dict[str, dict[str, Vector]]:
        """The rest."""
        return self._collect(self._more, waves[FEW:MORE])

    def _collect(self, forms, waves: Sequence[Wave]) -> dict[str, dict[str, Vector]]:  # type: ignore[no-untyped-def]
        found: dict[str, dict[str, Vector]] = {}
        for recording, local in self.locals.items():
            for form, values in (forms(local) | self._waves(local, waves)).items():
                found.setdefault(form, {})[recording] = values
        return {form: values for form, values in found.items() if any(np.any(v != 0) for v in values.values())}

    def _waves(self, k: Local, waves: Sequence[Wave]) -> Signals:
        """Sines and cosines, alone and with the direction of the angle's own speed, where the unit has it."""
        found: Signals = {}
        for name, order in waves:
            own = speed_of(name)
            speed = own if own in k.signals else self.speed
            for form, values in k.wave(name, order).items():
                found[form] = values
                if speed is not None:
                    found[f"{form}*sgn({speed})"] = values * sgn(k.signals[speed])
        return found

    def _first(self, k: Local) -> Signals:
        found = {"1": np.ones_like(k.time)}
        for name in self.loads:
            found |= {name: k.signals[name], f"{name}^2": k.signals[name] ** 2}
        if self.speed is not None:
            w, direction = k.signals[self.speed], f"sgn({self.speed})"
            found |= {direction: sgn(w), self.speed: w, f"{self.speed}^3": w**3}
            found[f"{self.speed}*abs({self.speed})"] = w * np.abs(w)
            found |= {f"abs({name})*{direction}": np.abs(k.signals[name]) * sgn(w) for name in self.loads}
        return found

    def _more(self, k: Local) -> Signals:
        found: Signals = {}
        for name in self.loads:
            y = k.signals[name]
            found |= {f"{name}^3": y**3, f"abs({name})": np.abs(y)}
            if self.voltage:
                v = k.signals[self.voltage]
                found |= {f"{name}*{self.voltage}": y * v, f"abs({name})*{self.voltage}": np.abs(y) * v}
        drifting = {"": np.ones_like(k.time)}
        if self.speed is not None:
            w, name = k.signals[self.speed], self.speed
            found |= {f"abs({name})": np.abs(w), f"{name}^2": w**2}
            found |= {f"{load}*{name}": k.signals[load] * w for load in self.loads}
            reach = self.reach(name)
            for p in (width * reach for width in WIDTHS if reach):
                found[f"tanh({name}/{p:g})"] = np.tanh(w / p)
            for p in (decay * reach for decay in DECAYS if reach):
                found[f"exp(-abs({name})/{p:g})*sgn({name})"] = np.exp(-np.abs(w) / p) * sgn(w)
            drifting |= {f"*sgn({name})": sgn(w), f"*{name}": w}
        for T in SLOW:
            found |= {f"exp(-t/{T}){form}": np.exp(-k.time / T) * v for form, v in drifting.items()}
        return found


def speed_of(angle: str) -> str | None:
    """phi_b -> w_b"""
    return angle.replace("phi", "w", 1) if angle.startswith("phi") else None


def sgn(x: Vector) -> Vector:
    """As the correction unit computes it."""
    return np.tanh(x / SGN)
