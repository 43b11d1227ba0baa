"""Parts of a system that recordings alone can drive: each is replayed on the recorded signals at its ports.

A wire whose signal is recorded is cut, and what lies behind it is driven by the recording instead. Where a part's own
channels then are off, something in it is (or the recording that drives it is wrong); where they are not, it is not.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
from scipy.ndimage import gaussian_filter1d

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.least_squares import Precision, fit
from cobot_joint.diagnosis.estimation.problem import BLOCK, Problem, Simulated, Vector
from cobot_joint.diagnosis.estimation.recorded_motion import integral
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.influence import Influences, behind, influences
from cobot_joint.diagnosis.plant.plant import Signals
from cobot_joint.diagnosis.plant.simulator import _variable as variable_of
from cobot_joint.system.model import Connection, Connector, System

SMOOTHED = 1.0  # samples, sigma of what takes noise from a drive; 3 hide the edges of excess backlash from the motor
DRAWS = 3  # of noise, which say how far a healthy part comes off because its driving signal carries noise
MOST_DRIVING = 3  # channels that drive a part in place of wires
REFIT = Precision(settled=5.0, roughly=0.1, steps=4, jacobians=0)  # of a part, from the whole system's parameters


@dataclass(frozen=True)
class Shown:
    """A unit's signal that a recorded channel shows: read from it, equal as long as nothing is off, or its integral."""

    channel: str
    how: Literal["read", "equal", "integral"]


@dataclass(frozen=True)
class Part:
    """Units of one set-up that recordings can drive, and the recorded channels that they then give."""

    setup: str
    signals: frozenset[str]  # outputs of units that these channels are computed from
    driven: tuple[str, ...]  # channels that drive it in place of wires; none: the whole system
    read: frozenset[str]  # outputs of units through which these were read
    channels: tuple[str, ...]
    system: System  # the cut one
    whole: System

    @property
    def units(self) -> tuple[str, ...]:
        """In the system's order."""
        there = {unit_of(s) for s in self.signals}
        return tuple(c.name for c in self.system.components if c.name in there)


@dataclass(frozen=True)
class Replayed:
    """How far a part is off: chi-square above noise per sample, by channel."""

    part: Part
    calibrated: dict[str, float]  # with the parameters that the whole system was fitted with
    refitted: dict[str, float]  # with its own re-fitted inside their tolerances, where it was off without
    healthy: dict[str, float]  # what noise in the signals that drive it would cause
    scatter: dict[str, float]  # 1 sigma

    @property
    def off(self) -> tuple[str, ...]:
        """Channels that are off by more than noise."""
        return tuple(
            c for c in self.refitted if self.refitted[c] - self.healthy[c] > thresholds.STANDS_OUT * self.scatter[c]
        )


def shown_signals(problem: Problem, setup: str, system: System, simulated: Sequence[Signals]) -> dict[str, Shown]:
    """Signals on wires between units that a recorded channel shows in the calibrated run, equal beside its noise.

    simulated: by recording, channels and these signals.
    """
    runs = _of_instants(problem, setup, simulated)
    channels = dict.fromkeys(c for r, _ in runs for c in r.outputs)
    before = influences(system)
    found = {}
    for signal in wire_signals(system):
        for channel in channels:
            sigma = problem.noise[channel].sigma
            having = [(r, s) for r, s in runs if channel in r.outputs and signal in s]
            if not any(np.std(s[channel]) > sigma for _, s in having):
                continue  # a channel that rests looks like anything that rests
            if all(_rms(s[signal] - s[channel]) < thresholds.SHOWS * sigma for _, s in having):
                found[signal] = Shown(channel, "read" if signal in _path(signal, channel, before) else "equal")
            elif all(
                _rms(s[signal] - s[signal][0] - integral(s[channel], r.step))
                < thresholds.SHOWS * sigma * np.sqrt(r.step * (r.time[-1] - r.time[0]))
                for r, s in having
            ):
                found.setdefault(signal, Shown(channel, "integral"))
    return found


def _of_instants(problem: Problem, setup: str, simulated: Sequence[Signals]) -> list[tuple[Recording, Signals]]:
    """A set-up's recordings with what was simulated of each, both at instants."""
    runs = [(r, s) for r, s in zip(problem.recordings, simulated, strict=True) if r.setup == setup]
    centred = [replace(r, outputs={c: s[c] for c in r.outputs}).centred().outputs for r, s in runs]
    known = [{c: np.where(np.isnan(y), s[c], y) for c, y in o.items()} for o, (_, s) in zip(centred, runs, strict=True)]
    return [(r.centred(), {**s, **o}) for o, (r, s) in zip(known, runs, strict=True)]


def wire_signals(system: System) -> list[str]:
    """Sources of wires between two units, in the system's order."""
    wires = [c for c in system.connections if c.source_component is not None and c.sink_component is not None]
    return list(dict.fromkeys(f"{c.source_component}.{c.source}" for c in wires))


def parts(setup: str, system: System, recorded: Sequence[str], shown: Mapping[str, Shown]) -> list[Part]:
    """The whole system, then for each channel the smaller parts, with the fewest driving channels that suffice."""
    before = influences(system)
    found = [_part(setup, system, recorded, (), before, shown)]
    least = {channel: [found[0].signals & behind([channel], before)] for channel in recorded}
    smaller: dict[tuple[tuple[str, ...], frozenset[str]], list[str]] = {}
    usable = list(dict.fromkeys(s.channel for s in shown.values()))
    for driven in (some for k in range(1, MOST_DRIVING + 1) for some in combinations(usable, k)):
        for channel in (c for c in recorded if c not in driven):
            part = _part(setup, system, [channel], driven, before, shown)
            units = {unit_of(s) for s in part.signals}
            if not any({unit_of(s) for s in known} <= units for known in least[channel]):
                least[channel].append(part.signals)
                smaller.setdefault((driven, frozenset(units)), []).append(channel)
    return found + [_part(setup, system, channels, driven, before, shown) for (driven, _), channels in smaller.items()]


def unit_of(signal: str) -> str:
    """`motor.phi` -> `motor`"""
    return signal.split(".")[0]


def _part(
    setup: str,
    system: System,
    channels: Sequence[str],
    driven: Sequence[str],
    before: Influences,
    shown: Mapping[str, Shown],
) -> Part:
    cut = {signal for signal, s in shown.items() if s.channel in driven}
    needed = {s for s in behind(channels, before, cut) if "." in s and s in before}
    read = {s for signal in needed & cut for s in _read(signal, shown[signal], before)}
    units = {unit_of(s) for s in needed - cut}
    return Part(
        setup,
        frozenset(needed - cut),
        tuple(driven),
        frozenset(read),
        tuple(channels),
        _cut_system(system, units, cut, channels) if driven else system,
        system,
    )


def _read(signal: str, shown: Shown, before: Influences) -> set[str]:
    """Outputs of units between a signal and the channel that shows it."""
    path = _path(signal, shown.channel, before)
    return path if shown.how == "equal" else {s for s in path if unit_of(s) != unit_of(signal)}


def _path(signal: str, channel: str, before: Influences) -> set[str]:
    """Outputs of units behind a channel, back to the first ones of the signal's unit."""
    own = [s for s in before if unit_of(s) == unit_of(signal)]
    return {s for s in behind([channel], before, own) if "." in s and s in before}


def _cut_system(system: System, units: Collection[str], cut: Collection[str], channels: Collection[str]) -> System:
    """The part alone; a cut signal becomes an input of the system, under the signal's name."""
    inputs: dict[str, Connector] = {}
    connections: list[Connection] = []
    for c in system.connections:
        signal = f"{c.source_component}.{c.source}"
        if (c.sink_component not in units) if c.sink_component else (c.sink not in channels):
            continue
        if c.source_component is None:
            inputs[c.source] = system.inputs[c.source]
            connections.append(c)
        elif signal in cut and c.sink_component is not None:
            unit = system.component(c.source_component).unit.unit_of(c.source)
            inputs[signal] = Connector(signal, "input", unit=unit)
            connections.append(replace(c, source_component=None, source=signal))
        elif c.source_component in units:
            connections.append(c)
    return replace(
        system,
        components=tuple(c for c in system.components if c.name in units),
        connections=tuple(connections),
        inputs=inputs,
        outputs={name: connector for name, connector in system.outputs.items() if name in channels},
    )


def replay(
    problem: Problem, fitted: Fit, part: Part, shown: Mapping[str, Shown], simulated: Sequence[Signals]
) -> Replayed:
    """The part with the calibrated parameters, driven by what was recorded. simulated: channels and shown signals."""
    runs = _of_instants(problem, part.setup, simulated)
    recorded = [{c: y - s[c] for c, y in r.outputs.items()} for r, s in runs]
    rng = np.random.default_rng(0)
    draws = [
        [{c: np.where(np.isfinite(e), problem.noise[c].on(np.zeros(len(e)), rng), np.nan) for c, e in of_run.items()}
         for of_run in recorded]
        for _ in range(DRAWS if part.driven else 0)
    ]  # fmt: skip
    with FmuPlant({part.setup: part.system}) as plant:
        problems = [
            Problem(plant, _driven(part, shown, runs, residual), problem.noise, 1) for residual in (recorded, *draws)
        ]
        with ThreadPoolExecutor(problem.jobs) as pool:
            first, *drawn = pool.map(lambda p: _excess(p, p.simulate([fitted.run])[0]), problems)
        healthy = {c: float(np.mean([d[c] for d in drawn])) if drawn else 0.0 for c in part.channels}
        varied = {c: float(np.std([d[c] for d in drawn], ddof=1)) if drawn else 0.0 for c in part.channels}
        expected = np.sqrt(2 / BLOCK / sum(len(r.time) for r, _ in runs))
        found = Replayed(
            part,
            first,
            first,
            healthy,
            {c: _hypot(expected, varied[c], thresholds.NOISE_KNOWN * healthy[c]) for c in part.channels},
        )
        if not found.off:
            return found
        alone = Problem(plant, problems[0].recordings, problem.noise, problem.jobs)  # its recordings beside each other
        return replace(found, refitted=_refitted(problem, alone, fitted, part))


def _refitted(problem: Problem, inner: Problem, fitted: Fit, part: Part) -> dict[str, float]:
    """`_excess` with the part's own parameters re-fitted inside their tolerances to its own channels."""
    own = [k for k, f in enumerate(fitted.hypothesis.base) if f.parameter.name.split(".")[0] in part.units]
    here = [b for b in problem.blocks if problem.recordings[b.recording].setup == part.setup]
    rows = np.concatenate([np.arange(b.rows.start, b.rows.stop) for b in here if b.channel in part.channels])
    jacobian = fitted.jacobian[rows][:, own]  # the whole system's: near enough to begin with
    hypothesis = Hypothesis(tuple(fitted.hypothesis.base[k] for k in own))
    again = fit(inner, hypothesis, fitted.x[own], jacobian, REFIT)
    return _excess(inner, again.simulated if again else None)


def suspects(replayed: Sequence[Replayed]) -> tuple[str, ...]:
    """Units in which a single difference could lie: part of all that is off, by an output that nothing clears.

    A part that is not off clears the outputs it is computed from, in its set-up: another one asks other things of them.
    Empty: nothing is off, or no single unit explains it.
    """
    left: list[set[str]] = []
    for part in (r.part for r in replayed if r.off):
        clear = {s for r in replayed if not r.off and r.part.setup == part.setup for s in r.part.signals}
        left.append({unit_of(s) for s in (part.signals | part.read) - clear})
    order = dict.fromkeys(name for r in replayed for name in r.part.units)
    return tuple(name for name in order if left and all(name in units for units in left))


def not_alone(part: Part, shown: Mapping[str, Shown]) -> dict[str, tuple[str, ...]]:
    """Unit -> what keeps it from being replayed alone: signals at its inputs that no channel shows."""
    before, wires = influences(part.system), set(wire_signals(part.system))
    needed: dict[str, set[str]] = {}
    for signal in part.signals:
        needed.setdefault(unit_of(signal), set()).update(s for s in before[signal] if s in wires and s not in shown)
    return {name: tuple(sorted(needed[name])) for name in part.units if needed[name]}


def _driven(
    part: Part,
    shown: Mapping[str, Shown],
    runs: Sequence[tuple[Recording, Signals]],
    residual: Sequence[Mapping[str, Vector]],
) -> list[Recording]:
    """Recordings of the part: the calibrated runs, and `residual` on top; smoothed where that drives, so edges stay."""
    found = []
    for (recording, simulated), besides in zip(runs, residual, strict=True):
        inputs = {name: x for name, x in recording.inputs.items() if name in part.system.inputs}
        for signal in (n for n in part.system.inputs if n in shown and shown[n].channel in besides):
            smooth = gaussian_filter1d(np.nan_to_num(besides[shown[signal].channel]), SMOOTHED)
            smooth = integral(smooth, recording.step) if shown[signal].how == "integral" else smooth
            inputs[signal] = simulated[signal] + smooth
        outputs = {c: simulated[c] + besides[c] for c in part.channels if c in besides}
        start = {variable_of(part.whole, name): value for name, value in recording.initial.items()}
        initial = {name: value for name, value in start.items() if unit_of(name) in part.units}
        found.append(replace(recording, inputs=inputs, outputs=outputs, initial=initial))
    return found


def _excess(problem: Problem, simulated: Simulated | None) -> dict[str, float]:
    """Chi-square above noise per sample, by channel; infinite where the part diverges."""
    channels = dict.fromkeys(b.channel for b in problem.blocks)
    if simulated is None:
        return dict.fromkeys(channels, float("inf"))
    above = list(zip(problem.blocks, problem.excess_by_block(problem.recorded - simulated.white), strict=True))
    return {
        c: float(sum(x.sum() for b, x in above if b.channel == c))
        / float(sum(b.weight.sum() for b, _ in above if b.channel == c))
        for c in channels
    }


def _hypot(*sides: float) -> float:
    return float(np.linalg.norm(sides))


def _rms(x: Vector) -> float:
    return float(np.sqrt(np.mean(x**2)))
